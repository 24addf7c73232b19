"""Evidence tables: assumptions of all drivers of sources and cards, and the families of function generators.

A table `drivers.<name>` has its `models` and its `assumptions`: the fields of `Assumption`, with the models if they differ. A quote
is a list of a key of `sources`, a place and a line. In a family of function generators it also has the `makers`, the maker in the reply to `*IDN?` by the begin
of the model's name, and, for a held range of the attenuator, `idle_mv`, the largest deviation of the idle level in mV. The
assumptions of all such drivers are in `every_generator.toml`: a family's row of the same quantity replaces them, and
`not_assumed` lists quantities to leave out. `{name}` is replaced by a text under `sources`, or by `idle_mv`.

The table of docs/generators.md is generated from these files. An assumption that is neither quoted nor checked at every arming is
unproven: `tactor-bench commission` measures the ones visible at the output, before high voltage is on.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drivers.evidence.assumption import Assumption

CARD_INPUT, LABJACK, CARD_OUTPUT, INTERLOCK, SUPPLY = "card", "labjack-t7", "card-output", "interlock", "dc-supply"
"""Drivers of the tables: the card's inputs, those of a LabJack, the card's analogue output, the interlock at its digital lines, and
the DC supplies. A LabJack that plays the drives has a table of its model, like a generator."""

SUPPLY_MODELS = ("E36", "DP8", "SPD")
"""Prefixes of the names of the supplies of drivers.supplies.dialects."""


@dataclass(frozen=True, slots=True)
class GeneratorFamily:
    """A family of function generators; one name leads to all its modules.

    Args:
        driver: name of the driver in a bench file.
        module: name of the driver's module in `drivers.generators`, of the simulated instruments' module in
            `sim_hardware.generators`, and of the evidence file.
        makers: maker in the reply to `*IDN?`, by the begin of the model's name.
    """

    driver: str
    module: str
    makers: Mapping[str, str]


@cache
def generator_families() -> dict[str, GeneratorFamily]:
    """Return the families of function generators that have an evidence file, by the name of their driver."""
    paths = sorted(files("drivers.evidence").joinpath("generators").iterdir(), key=lambda path: path.name)
    modules = [path.name.removesuffix(".toml") for path in paths if path.name.endswith(".toml")]
    return {
        driver: GeneratorFamily(driver, module, table["makers"])
        for module in modules
        for driver, table in _read(f"generators/{module}")["drivers"].items()
    }


def assumptions_about(model: str) -> tuple[Assumption, ...]:
    """Return the assumptions about a model of a function generator or supply; none without a driver of this package."""
    is_supply = model.upper().startswith(SUPPLY_MODELS)
    return tuple(
        each
        for each in assumptions()
        if each.driver not in (CARD_INPUT, LABJACK, CARD_OUTPUT, INTERLOCK)
        and (each.driver == SUPPLY) == is_supply
        and each.is_about(model)
    )


def assumptions_about_card(*, plays: bool, driver: str = "ni") -> tuple[Assumption, ...]:
    """Return the assumptions about the inputs of a card, by its driver, and about its output if it plays the drives."""
    inputs = LABJACK if driver == LABJACK else CARD_INPUT
    drivers = (inputs, CARD_OUTPUT) if plays else (inputs,)
    return tuple(each for each in assumptions() if each.driver in drivers)


@cache
def assumptions() -> tuple[Assumption, ...]:
    """Return the assumptions of all generators, supplies and cards, by driver."""
    modules = dict.fromkeys(family.module for family in generator_families().values())
    generators = (row for module in modules for row in _generator_rows(_read(f"generators/{module}")))
    others = (row for stem in ("supplies", "cards") for row in _rows(_read(stem)))
    return (*generators, *others)


@cache
def _read(stem: str) -> dict[str, Any]:
    return tomllib.loads(files("drivers.evidence").joinpath(f"{stem}.toml").read_text("utf-8"))


def _generator_rows(family: Mapping[str, Any]) -> Iterator[Assumption]:
    """Yield the common assumptions of all generators, adapted to a family, and then the family's own."""
    for driver, table in family["drivers"].items():
        holds_range = "idle_mv" in table
        common = {
            row["quantity"]: row
            for row in _read("every_generator")["assumptions"]
            if row.get("range_held", holds_range) == holds_range and row["quantity"] not in table.get("not_assumed", ())
        }
        own = {row["quantity"]: row for row in table["assumptions"] if row["quantity"] in common}
        rows = [row | own.get(quantity, {}) for quantity, row in common.items()]
        rows += [row for row in table["assumptions"] if row["quantity"] not in common]
        yield from (_assumption(driver, table, row, family) for row in rows)


def _rows(tables: Mapping[str, Any]) -> Iterator[Assumption]:
    for driver, table in tables["drivers"].items():
        yield from (_assumption(driver, table, row, tables) for row in table["assumptions"])


def _assumption(driver: str, table: Mapping[str, Any], row: Mapping[str, Any], tables: Mapping[str, Any]) -> Assumption:
    """Return a row of a driver's table as an assumption, with sources and numbers inserted."""
    from drivers.evidence.assumption import ArmingCheck, Assumption, OutputCheck, Quote  # opening a bench needs none

    names = tables.get("sources", {}) | {"idle_mv": table.get("idle_mv", "")}
    return Assumption(
        driver,
        row.get("models", table["models"]),
        row["quantity"],
        row["value"].format(**names),
        row.get("evidence", "").format(**names),
        tuple(OutputCheck(check) for check in row.get("checks", ())),
        row.get("pattern", ""),
        tuple(Quote(names[source], place, text) for source, place, text in row.get("quotes", ())),
        tuple(row.get("claims", ())),
        ArmingCheck(row["at_arming"]) if "at_arming" in row else None,
    )
