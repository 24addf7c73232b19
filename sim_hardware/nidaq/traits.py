"""Traits of the simulated card: behaviour that no source settles, drawn from the run's seed, and deviations for commissioning."""

from sim_hardware.generators import Trait, draw_options

SETTLING_SHARE = 0.02
"""Share of the volts converted before it that an input shows which settles too slowly."""

CARD_TRAITS = (
    Trait(
        "start-route",
        ("present", "absent"),
        "whether ai/SampleClock can be routed to the start of the output: NI's tables of routes differ by model (MAX, Device Routes)",
    ),
)

CARD_DEVIATIONS = (
    Trait(
        "skew",
        ("as-reported", "together", "double"),
        "time between two conversions of a scan: NI-DAQmx reports AI.ConvRate, 10 us above the fastest by default (X Series manual ch. 4)",
    ),
    Trait(
        "settling",
        ("settled", "slow"),
        "share of the channel converted before it: NI asks for sources below 1 kohm (USB-6001 guide, Multichannel Scanning Considerations)",
    ),
    Trait(
        "start-edge",
        ("on-scan", "at-once"),
        "whether an output that is to start at a scan does",
    ),
    Trait(
        "rewrite",
        ("prompt", "waits", "blocks"),
        "whether NI's protection against glitches holds a rewrite back until the caller's time-out (NI-DAQmx help, Glitching: in "
        "continuous tasks), or whatever that is for 10 s",
    ),
    Trait(
        "queue",
        ("as-reported", "longer"),
        "samples on their way to the converter, beyond those that the card reports (README of NIDAQ.jl: 4 requests of 32 768 bytes)",
    ),
)
"""What a card may do otherwise than the drivers assume. Never drawn: `card.traits` chooses it, to try a commissioning."""


def draw_card_traits(seed: int, chosen: str = "") -> dict[str, str]:
    """Return the option of each trait of the card: as chosen (`skew=double`), or else drawn from the seed.

    Raises:
        ValueError: an unknown trait or option is chosen.
    """
    return draw_options("card.traits", "card", f"card {seed}", CARD_TRAITS, CARD_DEVIATIONS, chosen)
