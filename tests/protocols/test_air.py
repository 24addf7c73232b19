"""Temperature and humidity at the card through a run: conditions of the run, and coefficients of the specimen by them."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from app.identification.specimen_identification import identify
from protocols.base import LogMessage
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.wiring_check import WiringCheck
from protocols.runfile.reader import Run
from tests.helpers.electrical.bench import with_inputs
from tests.helpers.simulated_bench import laboratory, run, simulated

THERMOMETER = {
    "name": "room",
    "channel": "ai4",
    "unit": "degC",
    "gain": 100.0,
    "kind": "temperature",
    "gain_relative_uncertainty": 0.001,
}
HYGROMETER = {"name": "moisture", "channel": "ai6", "unit": "1", "kind": "humidity"}
CHECK = WiringCheck(record_s=0.5, wait_s=0.2)


def test_the_conditions_of_a_run_are_the_means_of_the_sensors(tmp_path: Path) -> None:
    room = {"temperature_c": 19.0, "drift_k_per_h": 600.0, "humidity": 0.62}
    with laboratory(with_inputs(simulated(room=room), THERMOMETER, HYGROMETER)) as lab:
        ran = run(CHECK, tmp_path, lab)
        ended_s = lab.control.clock.now()
    with Run(ran.path) as file:
        record, trace = file.record, file.trace
        begin, end = (
            trace.channel_values("room", *rows.rows).mean() for rows in (list(file.recordings())[i] for i in (0, -1))
        )
    conditions, estimates = record.conditions, {each.name: each for each in record.estimates}
    assert begin < conditions.temperature_c < end
    assert 19.0 < conditions.temperature_c < 19.0 + 600 * ended_s / 3600
    assert conditions.humidity == pytest.approx(0.62, abs=1e-3)
    assert conditions.origin.startswith("room, mean of 4 recordings, 19.")
    assert 0.019 < estimates["air_temperature"].standard_error < end - begin + 0.02
    assert record.verdict.outcome == "good"


def test_a_sensor_that_is_not_connected_does_not_count(tmp_path: Path) -> None:
    loose = {**THERMOMETER, "offset": -273.15}
    with laboratory(with_inputs(simulated(), loose)) as lab:
        ran = run(CHECK, tmp_path, lab)
    said = [event.text for event in ran.events if isinstance(event, LogMessage)]
    assert sum("room" in text and "ai4" in text for text in said) == 4
    with Run(ran.path) as file:
        assert file.record.conditions.temperature_c is None


@pytest.mark.parametrize("table", [{**THERMOMETER, "unit": "K"}, {**HYGROMETER, "unit": "%"}])
def test_the_kind_determines_the_unit(table: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        with_inputs(simulated(), table)


@pytest.mark.deep
def test_runs_in_a_cold_and_a_warm_room_give_the_coefficients(tmp_path: Path) -> None:
    hidden = {"k2_per_kelvin": -1.4e-3, "mu_per_kelvin": 2.2e-3, "c0_per_kelvin": 4e-3}
    dwell, paths = SineDwell(frequencies_hz=(40, 130, 150, 170), peak_to_peak_v=1.0, sample_rate_hz=10_000), []
    for temperature_c in (18.0, 28.0):
        room = {"temperature_c": temperature_c, "drift_k_per_h": 30.0, **hidden}
        with laboratory(with_inputs(simulated(room=room), THERMOMETER)) as lab:
            paths.append(run(dwell, tmp_path, lab).path)
    found = {each.name: each for each in identify(paths).estimates}
    for name, value in hidden.items():
        assert abs(found[name].value - value) < 4 * found[name].standard_error
        assert found[name].standard_error < 0.2 * abs(value)


def test_a_thermometer_with_a_table_gives_its_temperature(tmp_path: Path) -> None:
    bent = {**THERMOMETER, "unit": "V", "gain": 1.0, "curve": "table", "coefficients": "0, -30, 0.19, 19, 0.25, 85"}
    with laboratory(with_inputs(simulated(room={"temperature_c": 19.0}), bent)) as lab:
        ran = run(CHECK, tmp_path, lab)
    with Run(ran.path) as file:
        assert file.points()["air_temperature"] == pytest.approx(19.0, abs=0.1)
        assert file.trace.channel_values("room").mean() == pytest.approx(0.19, abs=1e-3)
