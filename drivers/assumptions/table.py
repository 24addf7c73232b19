"""All assumptions of the drivers of sources and cards: what safety or a number depends on, with its evidence.

The table of docs/generators.md is written from here. The values come from the drivers where they have them. An assumption
without evidence is unproven: `tactor-bench commission` measures those that show at the output, before high voltage is on.
"""

from collections.abc import Iterator

from drivers.assumptions.assumption import Assumption
from drivers.assumptions.cards import CARD_INPUT, CARD_INPUTS, CARD_OUTPUT, CARD_OUTPUTS
from drivers.assumptions.every_generator import every_generator
from drivers.assumptions.keysight import KEYSIGHT_33200, KEYSIGHT_33500
from drivers.assumptions.rigol import RIGOL
from drivers.assumptions.siglent import SIGLENT
from drivers.assumptions.supplies import SUPPLIES
from drivers.assumptions.tektronix import TEKTRONIX

SUPPLY_MODELS = ("E36", "DP8", "SPD")
"""How the names of the supplies of drivers.supplies.dialects begin."""


def assumptions_about(model: str) -> tuple[Assumption, ...]:
    """Return the assumptions about a model of a function generator or supply; none about one without a driver of this package."""
    is_supply = model.upper().startswith(SUPPLY_MODELS)
    return tuple(
        each
        for each in assumptions()
        if each.driver not in (CARD_INPUT, CARD_OUTPUT)
        and (each.driver == "dc-supply") == is_supply
        and each.is_about(model)
    )


def assumptions_about_card(*, plays: bool) -> tuple[Assumption, ...]:
    """Return the assumptions about the card that measures, and about its output if that plays the drives."""
    return (*CARD_INPUTS, *CARD_OUTPUTS) if plays else CARD_INPUTS


def assumptions() -> Iterator[Assumption]:
    """Yield the assumptions of all generators and supplies, by driver."""
    yield from every_generator()
    yield from KEYSIGHT_33500
    yield from KEYSIGHT_33200
    yield from RIGOL
    yield from SIGLENT
    yield from TEKTRONIX
    yield from SUPPLIES
    yield from CARD_INPUTS
    yield from CARD_OUTPUTS
