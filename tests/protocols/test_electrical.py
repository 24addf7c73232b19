"""Protocol `electrical` on the simulated bench: hidden parameters found, faults of the connection refused, the file gives the run."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from protocols.base import RunStatus
from protocols.measurements.electrical import Electrical
from protocols.rehearsal import CannotRunError, rehearse
from protocols.runfile.reader import Run
from tests.helpers.electrical.bench import MONITORS, electrical_bench, with_inputs
from tests.helpers.electrical.truth import true_capacitance, true_energy, true_loss
from tests.helpers.fault_search.searched import Person
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import Ran, laboratory, run, simulated

LOAD = {"capacitance_f": 1.41e-9, "loss_per_decade": 0.034, "leakage_ohm": 4e9}
PROTOCOL = Electrical(frequencies_hz=(20, 200), drives_v=(5.0, 1.0), levels_v=(5.0,), wait_s=1.0, record_s=0.5)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    with laboratory(electrical_bench(electrical=LOAD)) as lab:
        ran = run(PROTOCOL, tmp_path_factory.mktemp("runs"), lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    return ran


def test_small_voltages_come_before_high_ones(measured: Ran) -> None:
    assert [round(p.frequency) for p in measured.points] == [20, 20, 200, 20, 200, 0]
    assert [p.drive for p in measured.points] == [0.2, 1.0, 1.0, 5.0, 5.0, 5.0]


def test_capacitance_and_loss_are_the_plants(measured: Ran) -> None:
    truth = electrical_bench(electrical=LOAD).simulation_parameters
    for p in measured.points[:-1]:
        f = np.array([p.frequency])
        assert abs(p.capacitance - true_capacitance(truth, f)[0]) < 3 * p.capacitance_total
        assert abs(p.loss - true_loss(truth, f)[0]) < 3 * p.loss_total
        assert 0 < p.capacitance_errors < p.capacitance_total < 0.02 * p.capacitance
        assert abs(p.energy - true_energy(truth, p.frequency, p.drive)) < 3 * p.energy_total
        assert p.power == pytest.approx(p.energy * p.frequency)


@pytest.mark.deep
def test_a_sense_capacitor_tells_the_same_as_the_monitor(measured: Ran, tmp_path: Path) -> None:
    charge = {"name": "charge", "channel": "ai7", "unit": "C", "gain": 1e-6, "kind": "charge", "bleed_s": 10.0}
    charge |= {"gain_relative_uncertainty": 0.005, "delay_uncertainty_s": 2e-6}
    config = with_inputs(electrical_bench(electrical=LOAD), MONITORS[0], charge)
    with laboratory(config) as lab:
        ran = run(PROTOCOL, tmp_path, lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    truth = config.simulation_parameters
    for p, by_current in zip(ran.points[:-1], measured.points, strict=False):
        f = np.array([p.frequency])
        assert abs(p.capacitance - true_capacitance(truth, f)[0]) < 3 * p.capacitance_total
        assert abs(p.loss - true_loss(truth, f)[0]) < 3 * p.loss_total
        assert p.capacitance == pytest.approx(by_current.capacitance, rel=0.01)
    assert_leakage(ran.points[-1])


def test_the_leakage_is_the_plants(measured: Ran) -> None:
    assert_leakage(measured.points[-1])


def assert_leakage(held: Any) -> None:
    """Assert that leakage and absorption at 1500 V are those of the plant."""
    absorbed = LOAD["capacitance_f"] * 1500 * LOAD["loss_per_decade"] / math.log(10) / 1.5
    assert held.voltage == pytest.approx(1500, rel=0.01)
    assert abs(held.leakage - 1500 / LOAD["leakage_ohm"] - absorbed) < 3 * held.leakage_total + 0.2 * absorbed


def test_estimates_have_total_uncertainties(measured: Ran) -> None:
    found = {each.name: each for each in PROTOCOL.estimates(measured.points)}
    assert set(found) == {
        *(
            f"{name}, 20 Hz at {v} V"
            for name in ("capacitance", "loss_factor", "energy_per_cycle")
            for v in ("0.2", "1", "5")
        ),
        "leakage_current, 5 V held",
        "insulation_resistance, 5 V held",
    }
    insulation = found["insulation_resistance, 5 V held"]
    assert abs(insulation.value - LOAD["leakage_ohm"]) < 0.2 * LOAD["leakage_ohm"]
    assert measured.verdict.outcome == "good", measured.verdict.reasons


def test_the_file_gives_the_points_and_loops_of_the_run(measured: Ran) -> None:
    with Run(measured.path) as file:
        recordings = list(file.recordings())
        stored = file.points()
        loops = file.series()
        entry = [each for each in recordings if each.entry == 1]
        again = PROTOCOL.point(("sine", 20.0, 1.0), entry, simulated=True)
    assert again.capacitance == measured.points[1].capacitance == stored["capacitance"][1]
    assert len(loops) == 5
    assert loops[3].x.max() > 900
    assert np.ptp(loops[3].y) == pytest.approx(1.4e-9 * np.ptp(loops[3].x), rel=0.6)


@pytest.mark.parametrize(
    ("load", "words"),
    [
        ({"electrodes": "open"}, "not connected"),
        ({"electrodes": "damaged"}, "short-circuited or damaged"),
        ({"electrodes": "reversed"}, "wrong way round"),
    ],
)
def test_a_faulty_connection_gets_no_higher_voltage(load: dict[str, Any], words: str, tmp_path: Path) -> None:
    with laboratory(electrical_bench(electrical=load)) as lab:
        ran = run(PROTOCOL, tmp_path, lab)
    assert_refused(ran, words)


def test_without_high_voltage_the_run_ends_by_a_sentence(tmp_path: Path) -> None:
    with laboratory(electrical_bench()) as lab:
        ran = run(PROTOCOL, tmp_path, lab, operator=Person(lab.control, "forgetful", 0))
    assert ran.status is RunStatus.FAILED
    assert_names(ran.reason, "voltage", "high", f"{PROTOCOL.frequencies_hz[0]:g}")


def assert_refused(ran: Ran, words: str) -> None:
    """Assert that the run has ended by a sentence, and that no more than the small sine ever left the card."""
    assert ran.status is RunStatus.FAILED
    assert words in ran.reason
    assert "no higher voltage" in ran.reason
    assert not ran.points
    assert ran.report.live_s > 0
    assert 2.4 - 1e-3 <= ran.report.lowest_v < 2.42
    assert 2.58 < ran.report.highest_v <= 2.6 + 1e-3


@pytest.mark.deep
@pytest.mark.parametrize(
    ("load", "words"),
    [
        ({"polarisation": 0.6}, "depolarised"),
        ({"electrodes": "broken"}, "an electrode is broken"),
        ({"capacitance_f": 2.6e-9}, "another specimen"),
    ],
)
def test_a_changed_specimen_is_found_by_its_own_history(load: dict[str, Any], words: str, tmp_path: Path) -> None:
    short = Electrical(frequencies_hz=(20,), drives_v=(0.5,), levels_v=(), record_s=0.5)
    with laboratory(electrical_bench()) as lab:
        first = run(short, tmp_path, lab)
    assert first.status is RunStatus.COMPLETED, first.reason
    with laboratory(electrical_bench(electrical=load)) as lab:
        ran = run(PROTOCOL, tmp_path, lab)
        alone = run(short, tmp_path / "elsewhere", lab)
    assert_refused(ran, words)
    assert alone.status is RunStatus.COMPLETED  # without a history nothing is expected
    with Run(ran.path) as file:
        assert file.record.parameters["expected_f"] == first.points[0].capacitance
        assert file.record.requested == {"expected_f": 0.0, "expected_bending": 0.0}


def test_a_stated_value_takes_precedence_over_the_history(tmp_path: Path) -> None:
    short = Electrical(frequencies_hz=(20,), drives_v=(0.5,), levels_v=(), record_s=0.5, expected_f=3e-9)
    with laboratory(electrical_bench()) as lab:
        ran = run(short, tmp_path, lab)
    assert_refused(ran, "capacitance / expected: 0.599")


def test_a_specimen_that_does_not_move_is_refused(tmp_path: Path) -> None:
    with laboratory(electrical_bench(tactor={"mu": -1e-9})) as lab:
        ran = run(PROTOCOL, tmp_path, lab)
    assert (ran.status, ran.points) == (RunStatus.FAILED, [])
    assert "does not move" in ran.reason


def test_a_bench_without_the_channel_is_refused_before_anything_moves(tmp_path: Path) -> None:
    only_voltage = with_inputs(simulated(), MONITORS[0])
    with laboratory(only_voltage) as lab:
        with pytest.raises(CannotRunError, match="amplifier_voltage"):
            rehearse(PROTOCOL, lab.bench.amplifier, channels=lab.bench.channels)
        ran = run(PROTOCOL, tmp_path, lab)
    assert ran.status is RunStatus.FAILED
    assert "current-monitor or charge" in ran.reason
    assert ran.report.live_s == 0


@pytest.mark.deep
def test_without_a_voltage_monitor_the_characteristic_gives_the_volts(tmp_path: Path) -> None:
    short = Electrical(frequencies_hz=(20,), drives_v=(2.0,), levels_v=(), record_s=0.5)
    with laboratory(with_inputs(simulated(), MONITORS[1])) as lab:
        ran = run(short, tmp_path, lab)
    truth = simulated().simulation_parameters
    p = ran.points[-1]
    assert abs(p.capacitance - true_capacitance(truth, np.array([20.0]))[0]) < 3 * p.capacitance_total
