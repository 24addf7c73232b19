"""Traits of simulated instruments: behaviour that no source settles, drawn from the run's seed so that no driver relies on it.

What real instruments were seen to do is not drawn: each model has it, with its source in one line.
"""

import random
import re
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Trait:
    """One behaviour of some models.

    Args:
        name: of the trait, in parameters and test names.
        options: what is possible; the first is the kindest.
        models: how the names of the models begin that have it, as regular expressions.
        why: what is not known, and what is.
    """

    name: str
    options: tuple[str, ...]
    models: tuple[str, ...]
    why: str


KEYSIGHT = ("33", "EDU", "FG", "G51")

TRAITS = (
    Trait(
        "selection",
        ("keeps-levels", "restores-levels"),
        ("SDG1", "SDG6"),
        "whether selecting a waveform restores the levels it was stored with: sources differ between firmwares",
    ),
    Trait(
        "silence",
        ("brief", "long"),
        ("SDG",),
        "how long it answers nothing after a waveform arrived: 0.5 s on an SDG1032X, above 5 s in 15 of 86 cases on an SDG2122X",
    ),
    Trait(
        "stale",
        ("never", "often"),
        ("SDG",),
        "whether a selection may not take until it is sent again: 19 of 233 on an SDG2122X",
    ),
    Trait(
        "inversion",
        ("one-switch", "two-switches"),
        ("SDG",),
        "whether INVT and the polarity of OUTP are one switch or two: both exist",
    ),
    Trait(
        "unknown-header",
        ("rest-of-message", "whole-message"),
        (*KEYSIGHT, "DG", "AFG"),
        "whether an unknown header leaves the rest of its message unread",
    ),
    Trait(
        "polarity",
        ("present", "absent"),
        ("AFG1",),
        "whether it has OUTPut:POLarity: no public driver uses it",
    ),
    Trait(
        "recall",
        ("works", "ignored"),
        ("SDG6",),
        "whether a waveform is selected by its name: not with firmware 6.01.01.37R6, but with 38R3, on an SDG6022X",
    ),
    Trait(
        "rate-mode",
        ("present", "absent"),
        ("SDG6",),
        "whether it has SRATE: an SDG6022X with firmware 6.01.01.38R3 has not",
    ),
    Trait(
        "idle-setting",
        ("START", "DC", "END"),
        (r"AFG31\d{3}",),
        "where a burst waits after a reset: its setting exists, its factory value is in no source",
    ),
    Trait(
        "sequencer",
        ("present", "absent"),
        (r"AFG31\d{3}",),
        "whether it knows SEQControl without the option",
    ),
    Trait(
        "noise",
        ("present", "absent"),
        ("DG4",),
        "whether it has OUTPut:NOISe: seen on a DG4202 (firmware 00.01.14), in no guide of the other models",
    ),
    Trait(
        "trigger-source",
        ("kept", "lost-after-burst"),
        ("DG",),
        "whether the trigger source must be set anew after a burst: seen on a DG1000Z by Menlo Systems, not by others",
    ),
    Trait(
        "retime",
        ("continues", "at-next-burst", "restarts"),
        ("SDG", "AFG", "DG", "T3AFG"),
        "what a change of frequency does to a running burst: no guide and no public driver says",
    ),
)


DEVIATIONS = (
    Trait(
        "idle",
        ("first-point", "bottom"),
        (*KEYSIGHT, "DG", "SDG", "AFG"),
        "level between bursts: below the offset by the peak of the amplitude",
    ),
    Trait(
        "after",
        ("as-between-bursts", "zero"),
        (*KEYSIGHT, "DG", "SDG", "AFG"),
        "level after a burst: 0 V until the next setting",
    ),
    Trait(
        "output-polarity",
        ("as-replied", "inverted"),
        (*KEYSIGHT, "DG", "SDG", "AFG"),
        "an inverted output that replies normal polarity",
    ),
    Trait(
        "upload",
        ("quiet", "drops"),
        (*KEYSIGHT, "DG", "SDG", "AFG"),
        "a relay opens whenever another waveform is played",
    ),
    Trait(
        "range",
        ("held", "switches"),
        (*KEYSIGHT, "DG10"),
        "a held range that follows the amplitude nevertheless",
    ),
    Trait(
        "abort",
        ("quiet", "drops"),
        (*KEYSIGHT, "DG10"),
        "a relay opens when a burst is aborted",
    ),
    Trait(
        "scale",
        ("nominal", "quarter", "fourfold"),
        (*KEYSIGHT, "DG", "SDG", "AFG"),
        "amplitude of all waveforms",
    ),
    Trait(
        "uneven",
        ("as-documented", "otherwise"),
        (*KEYSIGHT, "DG10"),
        "whether the amplitude is the span of the points or of the converter",
    ),
    Trait(
        "offset",
        ("nominal", "low"),
        (*KEYSIGHT, "DG", "SDG", "AFG"),
        "volts of the offset: 6 % low",
    ),
    Trait(
        "filter",
        ("smooth", "rings"),
        ("335", "336", "EDU", "FG"),
        "the filter between the points of a waveform overshoots",
    ),
    Trait(
        "surge",
        ("none", "at-start"),
        (*KEYSIGHT, "DG", "SDG", "AFG"),
        "a pulse when a burst begins (Menlo Systems: DG1000Z with an offset)",
    ),
    Trait(
        "droop",
        ("steady", "sags"),
        (*KEYSIGHT, "DG", "SDG", "AFG"),
        "a level within one long waveform: sags by 10 % per second",
    ),
    Trait(
        "start",
        ("triggered", "sometimes-lost"),
        (*KEYSIGHT, "DG", "SDG", "AFG"),
        "every second trigger starts nothing",
    ),
    Trait(
        "combining",
        ("as-replied", "stays"),
        (*KEYSIGHT, "DG", "SDG", "AFG3"),
        "another channel is added to the output although the setting replies off",
    ),
)
"""What an instrument may do otherwise than its driver assumes. Never drawn: `generator.traits` chooses it, to try the
commissioning of an instrument."""


def _has(trait: Trait, model: str) -> bool:
    return any(re.match(begin, model.upper()) for begin in trait.models)


def deviations_of(model: str) -> tuple[Trait, ...]:
    """Return the deviations that a model can be given."""
    return tuple(t for t in DEVIATIONS if _has(t, model))


def traits_of(model: str) -> tuple[Trait, ...]:
    """Return the traits of a model."""
    return tuple(t for t in TRAITS if _has(t, model))


def draw_traits(model: str, seed: int, chosen: str = "") -> dict[str, str]:
    """Return the option of each trait of a model: as chosen (`silence=long stale=often`), or else drawn from the seed.

    Raises:
        ValueError: an unknown trait or option is chosen.
    """
    return draw_options("generator.traits", model, f"{model} {seed}", traits_of(model), deviations_of(model), chosen)


def draw_options(
    key: str, owner: str, seed: str, traits: Sequence[Trait], deviations: Sequence[Trait], chosen: str
) -> dict[str, str]:
    """Return the options of an instrument: of each trait as chosen, or else drawn; of the deviations those that are chosen.

    Args:
        key: parameter that holds the choice, for messages.
        owner: whose traits they are, for messages.
        seed: of the draw.
        traits: of which each is drawn that is not chosen.
        deviations: which are only chosen.
        chosen: `name=option`, separated by blanks.

    Raises:
        ValueError: an unknown trait or option is chosen.
    """
    draw = random.Random(seed)
    drawn = {trait.name: draw.choice(trait.options) for trait in traits}
    known = {t.name: t.options for t in (*traits, *deviations)}
    for pair in chosen.split():
        name, _, option = pair.partition("=")
        if option not in known.get(name, ()):
            choices = ", ".join(f"{n}={'|'.join(o)}" for n, o in known.items()) or "none"
            raise ValueError(f"{key}: {pair!r} is no trait of a {owner}; it has {choices}")
        drawn[name] = option
    return drawn
