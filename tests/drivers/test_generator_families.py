"""Families of function generators: driver, evidence and simulated instruments are found by one name, and agree with each other."""

import re
from importlib import import_module

import pytest

from app.config.driver_registry import SOURCES, load_driver
from drivers import generator_families
from drivers.evidence.assumption import Assumption
from drivers.evidence.evidence_files import assumptions
from drivers.generators.burst import BurstGenerator
from drivers.generators.keysight import FULL_SCALES
from drivers.generators.rigol import MEMORY_POINTS, PACKET_POINTS
from drivers.generators.siglent import FULL_SCALE

FAMILIES = generator_families()


def driver_of(name: str) -> type[BurstGenerator]:
    driver = load_driver(SOURCES, name)
    assert isinstance(driver, type)
    assert issubclass(driver, BurstGenerator)
    return driver


@pytest.mark.one_in(1)
@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_has_driver_evidence_and_simulated_instruments(name: str) -> None:
    assert driver_of(name).__module__ == f"drivers.generators.{FAMILIES[name].module}"
    assert name in import_module(f"sim_hardware.generators.{FAMILIES[name].module}").SIMULATED
    assert [each for each in assumptions() if each.driver == name]


def value_of(driver: str, quantity: str, models: str) -> str:
    (value,) = (a.value for a in assumptions() if (a.driver, a.quantity, a.models) == (driver, quantity, models))
    return value


def test_idle_deviations_are_half_of_the_idle_amplitudes() -> None:
    for name in FAMILIES:
        able = driver_of(name).dialect_type.capabilities
        held = [a for a in assumptions() if a.driver == name and a.quantity == "abort in mid-burst"]
        assert bool(held) == able.holds_range
        assert all(f"within {able.idle_amplitude_vpp / 2 * 1e3:g} mV" in each.value for each in held)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("driver", "quantity", "models", "number"),
    [
        ("keysight-33200", "converter", "33250A", FULL_SCALES["33250"]),
        ("rigol-dg", "points of a packet", "DG1000Z", PACKET_POINTS),
        ("rigol-dg800", "points of a waveform", "DG800, DG900, DG2000", MEMORY_POINTS),
        ("rigol-dg800", "points of a waveform", "DG4000", MEMORY_POINTS),
        ("siglent-sdg", "full-scale code", "SDG2000X", FULL_SCALE),
    ],
)
def test_a_number_of_the_table_is_the_driver_s(driver: str, quantity: str, models: str, number: int) -> None:
    assert str(number) in value_of(driver, quantity, models)


@pytest.mark.parametrize(
    ("driver", "quantity", "models"),
    [
        ("keysight-33500", "smallest amplitude used", "33500B, 33600A, EDU33210, FG33530"),
        ("keysight-33200", "smallest amplitude", "33210A, 33220A, 33250A, G5100A"),
    ],
)
def test_the_smallest_amplitude_of_the_table_is_the_driver_s(driver: str, quantity: str, models: str) -> None:
    vpp = driver_of(driver).dialect_type.capabilities.idle_amplitude_vpp
    assert value_of(driver, quantity, models).startswith(f"{vpp * 1e3:g} mVpp")


REVISION = re.compile(
    r" at [0-9a-f]{7}\b|issue \d+|Guide|Manual|data sheet, Rev|of \d+ \w+ 20\d\d|T-Series Datasheet, [A\d]|C example"
)
"""What a quoted document names: a commit, the number of a thread, or the title of a guide, whose page is the place."""


def claims_of(row: Assumption) -> list[str]:
    """Return regular expressions for the headers and numbers that the value of a row claims; a header may be in its long form."""
    if row.claims:
        return [re.escape(claim) for claim in row.claims]
    words = [word for text in re.findall(r"`([^`]+)`", row.value) for word in re.split(r"[ ,]+", text) if word != "OFF"]
    headers = [r"\w*[^;]*:".join(re.escape(node) for node in word.split(":")) for word in words]
    numbers = re.findall(r"\b(?:0x\w+|\d{3,})\b", re.sub(r"(?<=\d) (?=\d{3})", "", re.sub(r"`[^`]*`", "", row.value)))
    return headers + numbers


@pytest.mark.parametrize(
    "row", [row for row in assumptions() if row.quotes], ids=lambda row: f"{row.driver}-{row.quantity}"
)
def test_the_quotes_of_an_assumption_contain_what_it_claims(row: Assumption) -> None:
    text = "\n".join(quote.text for quote in row.quotes)
    assert not [claim for claim in claims_of(row) if not re.search(claim, text, re.IGNORECASE)]
    assert claims_of(row) or row.quantity == "polarity"
    for quote in row.quotes:
        assert REVISION.search(quote.document), quote
        assert quote.place
        assert 8 < len(quote.text) < 200


def test_at_most_fifty_assumptions_are_unproven() -> None:
    assert len([row for row in assumptions() if row.is_unproven]) <= 50
