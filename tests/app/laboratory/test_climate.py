"""A serial sensor through a run, waiting for a temperature, and climate chambers: what is in the file and what left the card."""

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.config.bench_file import BenchConfig
from app.config.bench_tables import EnvironmentTable
from app.identification.observations import run_observations
from drivers import EnvironmentReading, InstrumentError
from drivers.sensors.environment import TextEnvironmentSensor
from protocols.base import LogMessage, PointMeasured, ProgressUpdated, PromptShown, Quality, RunStatus
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.wiring_check import WiringCheck
from protocols.runfile.reader import Run
from tests.helpers.electrical.bench import with_inputs
from tests.helpers.simulated_bench import Ran, laboratory, run, simulated
from tests.protocols.test_air import THERMOMETER

DWELL = SineDwell(frequencies_hz=(100, 150, 170), peak_to_peak_v=1.0, sample_rate_hz=10_000, record_s=0.1)
WAITING = {"air_temperature_c": 35.0, "air_within_k": 0.5, "air_steady_s": 20.0}
CHECK = WiringCheck(record_s=0.5, wait_s=0.2)


def waiting(**changes: Any) -> WiringCheck:
    return WiringCheck(**{**CHECK.model_dump(), **WAITING, **changes})


def with_sensor(config: BenchConfig, driver: str = "text") -> BenchConfig:
    request = "SEND" if driver == "text" else ""
    table = EnvironmentTable(port="simulated", driver=driver, request=request, timeout_s=20.0)
    return config.model_copy(update={"environment": table})


def messages(ran: Ran) -> list[str]:
    return [event.text for event in ran.events if isinstance(event, LogMessage)]


def test_a_serial_sensor_is_read_for_every_point(tmp_path: Path) -> None:
    room = {"temperature_c": 19.0, "drift_k_per_h": 3600.0, "humidity": 0.62}
    with laboratory(with_sensor(simulated(room=room))) as lab:
        ran = run(DWELL, tmp_path, lab)
        ended_s = lab.control.clock.now()
    with Run(ran.path) as file:
        columns, units, record = file.points(), file.units(), file.record
        recorded = [each.air["air_temperature"] for each in file.recordings()]
        observations = run_observations(file)
    assert (units["air_temperature"], units["air_humidity"]) == ("degC", "1")
    assert recorded == columns["air_temperature"].tolist()
    assert (np.diff(columns["air_temperature"]) > 0.1).all()
    assert 19.0 < columns["air_temperature"][0] < columns["air_temperature"][-1] < 19.0 + ended_s
    assert columns["air_humidity"] == pytest.approx(0.62, abs=1e-4)
    assert record.conditions.temperature_c == pytest.approx(columns["air_temperature"].mean())
    assert record.conditions.origin.startswith("sensor at /dev/pts/")
    found = [each.temperature_c for each in observations]
    assert [each.usable.sum() for each in observations] == [1] * len(found) if len(found) == 3 else [3]
    assert np.mean(found) == pytest.approx(columns["air_temperature"].mean(), abs=1.0)


def test_a_lost_sensor_is_a_gap_and_not_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    count = 0

    def read(_: TextEnvironmentSensor) -> EnvironmentReading:
        nonlocal count
        count += 1
        if count == 2:
            raise InstrumentError("/dev/pts/9 was silent")
        return EnvironmentReading(20.0 + count, 0.4)

    monkeypatch.setattr(TextEnvironmentSensor, "read", read)
    with laboratory(with_sensor(simulated())) as lab:
        ran = run(DWELL, tmp_path, lab)
    with Run(ran.path) as file:
        seen, quality = file.points()["air_temperature"], file.points()["quality"].astype(int)
    assert ran.status is RunStatus.COMPLETED
    assert seen[0] == 21.0
    assert np.isnan(seen[1])
    flagged = [bool(Quality(each) & Quality.AIR_UNKNOWN) for each in quality]
    assert flagged == np.isnan(seen).tolist()
    assert Quality(quality[1]).usable
    assert sum("/dev/pts/9 was silent" in text for text in messages(ran)) == 1


def test_the_points_of_a_run_over_many_kelvins_are_fitted_at_their_temperatures(tmp_path: Path) -> None:
    room = {"temperature_c": 19.0, "drift_k_per_h": 9000.0}
    with laboratory(with_inputs(simulated(room=room), THERMOMETER)) as lab:
        ran = run(DWELL, tmp_path, lab)
    with Run(ran.path) as file:
        observations, columns = run_observations(file), file.points()
    parts = [(each.temperature_c, each.usable.nonzero()[0].tolist()) for each in observations]
    assert sorted(row for _, rows in parts for row in rows) == [0, 1, 2]
    assert len(parts) > 1
    for celsius, rows in parts:
        assert celsius == pytest.approx(columns["air_temperature"][rows].mean())
    assert len({each.label for each in observations}) == len(parts)


@pytest.mark.deep
@pytest.mark.parametrize("chamber", ["espec", "by hand"])
def test_a_run_waits_at_rest_until_the_chamber_is_there(chamber: str, tmp_path: Path) -> None:
    config = simulated(room={"temperature_c": 23.0, "chamber_lag_s": 30.0})
    config = with_sensor(config, "espec") if chamber == "espec" else with_inputs(config, THERMOMETER)
    with laboratory(config) as lab:
        ran = run(waiting(), tmp_path, lab)
        near_s = [30 * np.log(12 / kelvins) for kelvins in (0.6, 0.45)]  # the chamber shows tenths of a kelvin
        assert near_s[0] + 20 < lab.control.clock.now() < near_s[1] + 50
    labels = [
        event.label for event in ran.events if isinstance(event, ProgressUpdated) if "waiting for 35" in event.label
    ]
    assert len(labels) > 40
    prompts = [event.prompt for event in ran.events if isinstance(event, PromptShown)]
    assert [each.values for each in prompts if each.action == "set-chamber"] == [{"temperature_c": 35.0}] * (
        chamber != "espec"
    )
    with Run(ran.path) as file:
        assert file.points()["air_temperature"] == pytest.approx(35.0, abs=0.5)
        assert file.trace.sample_count < 10 * CHECK.sample_rate_hz
    assert ran.verdict.outcome == "good"
    assert ran.report.outside_rest_s < 3.0, "only the check itself drives"


def test_a_wait_that_is_too_long_ends_the_run_in_one_sentence(tmp_path: Path) -> None:
    config = with_inputs(simulated(room={"chamber_lag_s": 1e5}), THERMOMETER)
    with laboratory(config) as lab:
        ran = run(waiting(air_longest_s=60.0), tmp_path, lab)
    assert ran.status is RunStatus.FAILED
    assert "35 °C (within 0.5 K) for 20 s within 60 s (now 23." in ran.reason
    assert not ran.points


def test_a_wait_is_stopped(tmp_path: Path) -> None:
    stop = threading.Event()

    def observe(event: Any) -> None:
        if isinstance(event, ProgressUpdated) and "waiting" in event.label:
            stop.set()

    with laboratory(with_inputs(simulated(room={"chamber_lag_s": 1e5}), THERMOMETER)) as lab:
        ran = run(waiting(), tmp_path, lab, observe, cancel=stop)
    assert ran.status is RunStatus.STOPPED
    assert not any(isinstance(event, PointMeasured) for event in ran.events)


def test_a_bench_without_a_sensor_does_not_wait(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(waiting(), tmp_path, lab)
    assert ran.status is RunStatus.FAILED
    assert "air_within_k" in ran.reason


def test_a_chamber_refuses_what_it_does_not_reach(tmp_path: Path) -> None:
    with laboratory(with_sensor(simulated(), "espec")) as lab:
        with pytest.raises(InstrumentError, match="limited to -45 to 90"):
            lab.bench.environment.set_temperature(120.0)
        lab.bench.environment.set_temperature(-20.0)
        lab.control.clock.sleep(1e4)
        assert lab.bench.environment.read() == EnvironmentReading(-20.0, 0.45)
