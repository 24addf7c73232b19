"""Traits of simulated instruments: undocumented behaviour, drawn from the run's seed so that no driver relies on it.

Behaviour observed on real instruments is not drawn: each model has it, with its source in one line.
"""

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class Trait:
    """One behaviour of some models of a family.

    Args:
        name: name of the trait, in parameters and test names.
        options: possible options, the kindest first.
        why: open question, and known facts.
        models: regular expression for the begin of the affected models; default: all models of the family.
    """

    name: str
    options: tuple[str, ...]
    why: str
    models: str = ""


UNKNOWN_HEADER = Trait(
    "unknown-header",
    ("rest-of-message", "whole-message"),
    "whether an unknown header leaves the rest of its message unread",
)
RETIME = Trait(
    "retime",
    ("continues", "at-next-burst", "restarts"),
    "what a change of frequency does to a running burst: no guide and no public driver says",
)

NO_MODEL = "(?!)"
"""Regular expression that matches no model."""

DEVIATIONS = (
    Trait("idle", ("first-point", "bottom"), "level between bursts: below the offset by the peak of the amplitude"),
    Trait("after", ("as-between-bursts", "zero"), "level after a burst: 0 V until the next setting"),
    Trait("output-polarity", ("as-replied", "inverted"), "an inverted output that replies normal polarity"),
    Trait("upload", ("quiet", "drops"), "a relay opens whenever another waveform is played"),
    Trait("range", ("held", "switches"), "a held range that follows the amplitude nevertheless", NO_MODEL),
    Trait("abort", ("quiet", "drops"), "a relay opens when a burst is aborted", NO_MODEL),
    Trait("scale", ("nominal", "quarter", "fourfold"), "amplitude of all waveforms"),
    Trait(
        "uneven",
        ("as-documented", "otherwise"),
        "whether the amplitude is the span of the points or of the converter",
        NO_MODEL,
    ),
    Trait("offset", ("nominal", "low"), "volts of the offset: 6 % low"),
    Trait("filter", ("smooth", "rings"), "the filter between the points of a waveform overshoots", NO_MODEL),
    Trait("surge", ("none", "at-start"), "a pulse when a burst begins (seen by Menlo Systems, with an offset)"),
    Trait("droop", ("steady", "sags"), "a level within one long waveform: sags by 10 % per second"),
    Trait("start", ("triggered", "sometimes-lost"), "every second trigger starts nothing"),
    Trait(
        "combining", ("as-replied", "stays"), "another channel is added to the output although the setting replies off"
    ),
)
"""Departures of an instrument from the assumptions of its driver. Never drawn: `generator.traits` chooses one, to try the
commissioning of an instrument."""


def deviations(**models: str) -> tuple[Trait, ...]:
    """Return the deviations of a family; `models` has regular expressions for deviations of some models only."""
    return tuple(replace(each, models=models.get(each.name, each.models)) for each in DEVIATIONS)


def draw_options(
    key: str, owner: str, seed: str, traits: Sequence[Trait], deviations: Sequence[Trait], chosen: str
) -> dict[str, str]:
    """Return the options of an instrument: each trait chosen or drawn, and the chosen deviations.

    Args:
        key: parameter that holds the choice, for messages.
        owner: kind of instrument, for messages.
        seed: seed of the draw.
        traits: traits, each drawn unless chosen.
        deviations: deviations, never drawn.
        chosen: `name=option`, separated by blanks.

    Raises:
        ValueError: an unknown trait or option is chosen.
    """
    draw = random.Random(seed)
    drawn = {trait.name: draw.choice(trait.options) for trait in traits}
    options = {t.name: t.options for t in (*traits, *deviations)}
    for pair in chosen.split():
        name, _, option = pair.partition("=")
        if option not in options.get(name, ()):
            choices = ", ".join(f"{n}={'|'.join(o)}" for n, o in options.items()) or "none"
            raise ValueError(f"{key}: {pair!r} is no trait of a {owner}; it has {choices}")
        drawn[name] = option
    return drawn
