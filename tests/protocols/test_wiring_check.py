"""Wiring check: passes on a correct simulated bench, finds the wrong wire on a faulty one."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from protocols.base import Outcome, RunStatus
from protocols.measurements.wiring_check import WiringCheck
from protocols.registry import PROTOCOLS
from protocols.rehearsal import rehearse
from protocols.runfile.reader import Run
from tests.helpers.electrical.bench import electrical_bench
from tests.helpers.simulated_bench import laboratory, run, simulated

CHECK = WiringCheck(record_s=0.5, wait_s=0.2)


def failing(check: WiringCheck, points: list[Any]) -> set[str]:
    return {verdict.name for verdict in check.checks(points) if not verdict.passed}


def test_it_finds_the_truth_of_the_bench(tmp_path: Path) -> None:
    with laboratory(simulated(generator={"clock_ppm": 50.0})) as lab:
        ran = run(CHECK, tmp_path, lab)
        truth = lab.control.parameters
    assert ran.status == RunStatus.COMPLETED
    found = {verdict.name: verdict.value for verdict in CHECK.checks(ran.points)}
    assert failing(CHECK, ran.points) == set()
    assert found["gain above / below"] == pytest.approx(3.0, rel=0.02)  # 600 and 200 V per volt
    assert found["clock difference"] == pytest.approx(50e-6, abs=20e-6)
    assert found["noise floor"] == pytest.approx(truth.sensor.noise_m, rel=0.1)
    assert 0 < found["latency beyond the sensor's"] < 1e-3
    assert ran.report.highest_v <= 2.6 + 1e-6
    assert ran.report.lowest_v >= 2.4 - 1e-6
    with Run(ran.path) as file:
        assert file.points()["commanded"].tolist() == [2.5, 2.6, 2.4, 2.5]
        names = {estimate.name for estimate in file.record.estimates}
        assert names == {"static_gain_above_rest", "static_gain_below_rest", "bench_latency", "noise_floor"}
        again = [CHECK.point((), [recording], simulated=True) for recording in file.recordings()]
    assert [p.displacement for p in again] == pytest.approx([p.displacement for p in ran.points], rel=1e-9)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("truth", "names"),
    [
        ({"sensor": {"noise_m": 2e-5}}, {"noise floor"}),
        ({"sensor": {"delay_s": 0.02}}, {"latency beyond the sensor's"}),
        ({"generator": {"clock_ppm": 1000.0}}, {"clock difference"}),
        ({"amplifier": {"map": {"slope_above": 200.0}}}, {"gain above / below"}),
    ],
)
def test_what_is_wrong_with_a_bench_is_named(truth: dict[str, Any], names: set[str], tmp_path: Path) -> None:
    with laboratory(simulated(**truth)) as lab:
        ran = run(CHECK, tmp_path, lab)
    assert failing(CHECK, ran.points) == names


@pytest.mark.deep
@pytest.mark.parametrize(
    ("load", "name"),
    [
        ({"electrodes": "open"}, "capacitance of the specimen"),
        ({"electrodes": "damaged"}, "loss factor of the specimen"),
        ({"electrodes": "reversed"}, "sign of the bending"),
        ({"electrodes": "broken"}, "capacitance / expected"),
        ({"polarisation": 0.5}, "bending / expected"),
    ],
)
def test_a_current_monitor_shows_the_connection_of_the_specimen(
    load: dict[str, Any], name: str, tmp_path: Path
) -> None:
    with laboratory(electrical_bench()) as lab:
        good = run(CHECK, tmp_path, lab)
    assert good.verdict.outcome is Outcome.GOOD, good.verdict.reasons
    with laboratory(electrical_bench(electrical=load)) as lab:
        ran = run(CHECK, tmp_path, lab)
    assert ran.verdict.outcome is Outcome.DID_NOT_PASS
    assert name in {check.name for check in ran.verdict.failed_checks}
    assert ran.report.highest_v <= 2.6 + 1e-6


@pytest.mark.deep
def test_the_delay_of_the_sensor_that_the_bench_file_tells_is_no_latency(tmp_path: Path) -> None:
    config = simulated(sensor={"delay_s": 0.02})
    config = config.model_copy(update={"sensor": config.sensor.model_copy(update={"delay_s": 0.02})})
    with laboratory(config) as lab:
        ran = run(CHECK, tmp_path, lab)
    assert failing(CHECK, ran.points) == set()


def test_a_swapped_sign_is_wrong_polarity_and_no_latency(tmp_path: Path) -> None:
    with laboratory(simulated(sensor={"gain_m_per_v": -1e-4})) as lab:
        ran = run(CHECK, tmp_path, lab)
    assert failing(CHECK, ran.points) == {"polarity (1 right, -1 wrong)"}
    assert failing(WiringCheck(polarity=-1), ran.points) == set()


@pytest.mark.deep
def test_high_voltage_that_is_off_leaves_no_gain(tmp_path: Path) -> None:
    class Forgetful:
        def show(self, ask_id: int, prompt: object) -> None: ...

        def answer(self, ask_id: int) -> str:
            return "yes yes"

    with laboratory() as lab:
        ran = run(CHECK, tmp_path, lab, operator=Forgetful())
    assert {"gain above rest", "gain below rest"} <= failing(CHECK, ran.points)


def test_it_is_one_of_the_protocols_and_can_be_rehearsed() -> None:
    assert PROTOCOLS["wiring-check"] is WiringCheck
    with laboratory() as lab:
        rehearsal = rehearse(WiringCheck(), lab.bench.amplifier)
    assert rehearsal.entries == 4
    assert rehearsal.highest_specimen_v == pytest.approx(60)
    assert rehearsal.lowest_specimen_v == pytest.approx(-20)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"level_v": 2.0}, "less than or equal to 0.5"),
        ({"frequency_hz": 100, "sample_rate_hz": 1000}, "too low to see the latency"),
        ({"slopes_low": 7}, "slopes_low must lie below slopes_high"),
    ],
)
def test_what_makes_no_sense_is_refused(settings: dict[str, float], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        WiringCheck(**settings)


def test_a_check_that_was_broken_off_did_not_pass() -> None:
    (missing,) = CHECK.checks([])
    assert not missing.passed
    assert missing.consequence is Outcome.DID_NOT_PASS
    assert CHECK.estimates([]) == ()
