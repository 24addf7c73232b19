"""Fault matrix: any fault, protocol and moment ends at rest or `unsafe`, with a readable file and no traceback."""

import re
from pathlib import Path

import pytest

from protocols.base import RunStatus
from protocols.registry import PROTOCOLS
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS, INTERLOCK_FAULTS, SPECIMEN_FAULTS
from sim_hardware.testing.safe_volts import STEP_V
from tests.helpers.fault_matrix import ON_WIRES_ONLY, TAKES_THE_DRIVE, cell, moments_of

pytestmark = pytest.mark.breaks_the_drive

ON_WIRES = [
    ("grpc-gone", "sine-dwell", "recording"),
    ("card-unplugged", "wiring-check", "settling"),
]
"""Cells that the virtual clock cannot show, with the required text of the watchdog's log; all cells are in docs/fault-matrix.md."""


KINDS = ("sine-dwell", "sweep", "voltage-steps", "static-loading")
"""One protocol of each kind: sine, sweep, steps, or manual actions."""

FAULTS_OF_A_BENCH = [
    fault for fault in FAULT_DESCRIPTIONS if fault not in (*ON_WIRES_ONLY, *SPECIMEN_FAULTS, *INTERLOCK_FAULTS)
]


def assert_rest_or_unsafe(name: str, fault: str, moment: str, folder: Path) -> None:
    seen = cell(fault, name, moment, folder)
    assert not seen.faults, f"{moment}: {seen.faults}: {seen.reason}"
    assert "an error of this program" not in seen.reason
    if fault not in TAKES_THE_DRIVE:
        assert seen.largest_jump_v <= STEP_V + 1e-6, moment


@pytest.mark.one_in(5)
@pytest.mark.parametrize("fault", FAULTS_OF_A_BENCH)
@pytest.mark.parametrize("name", KINDS)
def test_every_fault_in_every_kind_of_protocol(name: str, fault: str, tmp_path: Path) -> None:
    """Moments are dealt so that every fault meets four, and every kind all of them."""
    own = moments_of(name).names
    moment = own[(KINDS.index(name) + FAULTS_OF_A_BENCH.index(fault)) % len(own)]
    assert_rest_or_unsafe(name, fault, moment, tmp_path)


@pytest.mark.deep
@pytest.mark.parametrize("fault", FAULTS_OF_A_BENCH)
@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_fault_in_every_protocol_at_every_moment(name: str, fault: str, tmp_path: Path) -> None:
    for moment in moments_of(name).names:
        assert_rest_or_unsafe(name, fault, moment, tmp_path / moment)


def test_a_level_near_rest_that_nobody_brought_back_is_not_rest(tmp_path: Path) -> None:
    """Found by the matrix: a ramp broken off after its first step left 33 mV at the input, 20 V on the specimen."""
    seen = cell("scpi-silent", "wiring-check", "ramp", tmp_path)
    assert 0.02 < abs(seen.end_v - 2.5) < 0.05
    assert seen.status is RunStatus.UNSAFE
    assert re.search(r"\(lowest 2\.5\d+ V, highest 2\.5\d+ V\)", seen.reason)


@pytest.mark.parametrize("fault", ["scpi-late", "scpi-garbled", "scpi-half"])
def test_a_ramp_whose_answers_cannot_be_read_is_brought_back_all_the_same(fault: str, tmp_path: Path) -> None:
    seen = cell(fault, "wiring-check", "ramp", tmp_path)
    assert seen.at_rest
    assert seen.end_v == pytest.approx(2.5, abs=1e-3)
    assert seen.status is RunStatus.FAILED


def test_a_small_sine_that_still_plays_is_not_rest(tmp_path: Path) -> None:
    """Found by the matrix: its mean is rest, and every sample of it was near enough."""
    seen = cell("scpi-garbled", "wiring-check", "stopping", tmp_path)
    assert seen.at_rest
    assert seen.status is RunStatus.COMPLETED


@pytest.mark.one_in(100)
@pytest.mark.parametrize(("fault", "name", "moment"), ON_WIRES)
def test_on_real_wires_with_the_watchdog(fault: str, name: str, moment: str, tmp_path: Path) -> None:
    seen = cell(fault, name, moment, tmp_path, wires=True)
    assert not seen.faults, f"{seen.faults}: {seen.reason}"
    if seen.status is RunStatus.UNSAFE:
        assert "the program could not confirm rest" in seen.watchdog_log


def test_the_table_in_the_documentation_is_whole_and_without_a_fault() -> None:
    """`python docs/make_fault_matrix.py` runs every cell and writes it."""
    text = (Path(__file__).parents[2] / "docs" / "fault-matrix.md").read_text()
    for name in PROTOCOLS:
        for fault in (fault for fault in FAULT_DESCRIPTIONS if fault not in (*SPECIMEN_FAULTS, *INTERLOCK_FAULTS)):
            assert f"| {name} | {fault} |" in text, "a fault or a protocol is new: python docs/make_fault_matrix.py"
    assert "FAULT" not in text
