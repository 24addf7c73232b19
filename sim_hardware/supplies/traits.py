"""Deviations of a simulated DC supply from what its driver assumes, which commissioning finds."""

import re

from sim_hardware.generators import Trait, draw_options

SUPPLY_DEVIATIONS = (
    Trait(
        "level",
        ("nominal", "low"),
        "volts of the loaded output: 6 % below the setting, which its voltmeter shows nevertheless",
    ),
    Trait(
        "step",
        ("between", "overshoots", "drops"),
        "output at a change of the level: 0.3 V too high, or 0 V, for 5 ms",
    ),
    Trait(
        "series",
        ("as-replied", "stays"),
        "outputs that stay in series although the instrument replies that they are not",
        "E3631[123]|SPD",
    ),
    Trait(
        "fall",
        ("as-measured", "slow"),
        "a falling output that is above what its voltmeter shows: time constant of 2 s",
    ),
)
"""Never drawn: `supply.traits` chooses it, to try a commissioning."""

GLITCH_S, OVERSHOOT_V, LOW_RATIO, SLOW_FALL_TAU_S = 5e-3, 0.3, 0.94, 2.0


def supply_deviations_of(model: str) -> tuple[Trait, ...]:
    """Return the deviations that a model can be given."""
    return tuple(t for t in SUPPLY_DEVIATIONS if re.match(t.models, model.upper()))


def draw_supply_traits(model: str, chosen: str = "") -> dict[str, str]:
    """Return the chosen deviations of a supply, e.g. `level=low step=drops`.

    Raises:
        ValueError: an unknown deviation or option is chosen.
    """
    return draw_options("supply.traits", model, model, (), supply_deviations_of(model), chosen)
