"""Traits of simulated instruments: behaviour that no source settles, drawn from the run's seed so that no driver relies on it.

What real instruments were seen to do is not drawn: each model has it, with its source in one line.
"""

import random
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Trait:
    """One behaviour of some models.

    Args:
        name: of the trait, in parameters and test names.
        options: what is possible; the first is the kindest.
        models: how the names of the models begin that have it.
        why: what is not known, and what is.
    """

    name: str
    options: tuple[str, ...]
    models: tuple[str, ...]
    why: str


TRAITS = (
    Trait(
        "selection",
        ("keeps-levels", "restores-levels"),
        ("SDG1",),
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
        ("33", "DG", "AFG"),
        "whether an unknown header leaves the rest of its message unread",
    ),
    Trait(
        "polarity",
        ("present", "absent"),
        ("AFG1",),
        "whether it has OUTPut:POLarity: no public driver uses it",
    ),
    Trait(
        "gate",
        ("present", "absent"),
        ("DG8",),
        "whether it has OUTPut:MODE: the DG1000Z guide lists it",
    ),
    Trait(
        "trigger-source",
        ("kept", "lost-after-burst"),
        ("DG",),
        "whether the trigger source must be set anew after a burst: seen on a DG1000Z by Menlo Systems, not by others",
    ),
)


def traits_of(model: str) -> tuple[Trait, ...]:
    """Return the traits of a model."""
    return tuple(t for t in TRAITS if model.upper().startswith(t.models))


def draw_traits(model: str, seed: int, chosen: str = "") -> dict[str, str]:
    """Return the option of each trait of a model: as chosen (`silence=long stale=often`), or else drawn from the seed.

    Raises:
        ValueError: an unknown trait or option is chosen.
    """
    draw, drawn = random.Random(f"{model} {seed}"), {}
    for trait in traits_of(model):
        drawn[trait.name] = draw.choice(trait.options)
    for pair in chosen.split():
        name, _, option = pair.partition("=")
        known = {t.name: t.options for t in traits_of(model)}
        if option not in known.get(name, ()):
            choices = ", ".join(f"{n}={'|'.join(o)}" for n, o in known.items()) or "none"
            raise ValueError(f"generator.traits: {pair!r} is no trait of a {model}; it has {choices}")
        drawn[name] = option
    return drawn
