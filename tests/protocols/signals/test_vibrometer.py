"""Runs with a vibrometer: dwell and sweep find the displacement of the plant, static protocols are refused, a file gives the same."""

import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from app.config.bench_file import BenchConfig
from drivers import Sine
from protocols.base import DriveStarted, Event, Protocol, Quality, RecordingFinished, RunStatus
from protocols.measurements.free_decay import FreeDecay
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.sweep import Sweep
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runfile.reader import Run
from protocols.signals import fit_frequency, fit_sine
from sim_hardware.bench import SimulatedBench
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run, simulated

GAIN_ERROR, GAIN_UNCERTAINTY = 0.004, 0.005
FREQUENCIES_HZ = (60.0, 150.0, 240.0)
VELOCITY_UNIT, GAIN_UNIT = "m/s", "m/s/V"
DWELL = SineDwell(frequencies_hz=FREQUENCIES_HZ, record_s=0.2, min_cycles=10)


def with_vibrometer(**sensor: Any) -> BenchConfig:
    """Return the ideal simulated bench with a vibrometer of 0.1 (m/s)/V whose true gain is another one."""
    gain = 0.1
    truth = {
        "quantity": "velocity",
        "noise_m": 1e-4,
        "range_m": 1.0,
        "delay_s": 2e-5,
        "gain_m_per_v": gain * (1 + GAIN_ERROR),
    }
    config = simulated(sensor=truth).model_dump()
    stated = {"name": "vibrometer", "quantity": "velocity", "gain_m_per_v": gain, "delay_s": 2e-5}
    return BenchConfig.model_validate(
        config | {"sensor": stated | {"gain_relative_uncertainty": GAIN_UNCERTAINTY} | sensor}
    )


class Truth:
    """Amplitude and phase of the plant's displacement against the drive, at the end of every recording."""

    def __init__(self, control: SimulatedBench) -> None:
        self._control = control
        self.values: list[complex] = []

    def __call__(self, event: Event) -> None:
        if isinstance(event, RecordingFinished) and isinstance(event.drive, Sine):
            rate_hz = 20_000.0
            t = self._control.clock.now() - 0.02 - np.arange(2000)[::-1] / rate_hz
            drive_v, moved = self._control.history.volts(t), self._control.plant.displacement(t)
            f = fit_frequency(drive_v, rate_hz, event.drive.frequency_hz)
            driven, seen = fit_sine(drive_v, rate_hz, f), fit_sine(moved, rate_hz, f, 8)
            self.values.append(seen.fundamental / np.exp(1j * np.angle(driven.fundamental)))


def test_a_dwell_finds_the_displacement_of_the_plant_within_its_total_uncertainty(tmp_path: Path) -> None:
    with laboratory(with_vibrometer()) as lab:
        truth = Truth(lab.control)
        ran = run(DWELL, tmp_path, lab, truth)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    assert len(ran.points) == len(truth.values) == len(FREQUENCIES_HZ)
    for point, true in zip(ran.points, truth.values, strict=True):
        total = math.hypot(point.fundamental_errors, GAIN_UNCERTAINTY * point.fundamental)
        assert abs(point.fundamental - abs(true)) < 2 * total
        # The stated gain is too small by a known error, which the statistical error alone does not cover.
        assert point.fundamental * (1 + GAIN_ERROR) == pytest.approx(
            abs(true), abs=5 * point.fundamental_errors + 1e-4 * abs(true)
        )
        assert abs(np.angle(np.exp(1j * (point.phase - np.angle(true))))) < 4 * point.phase_errors + 1e-3


def test_a_file_says_that_its_samples_are_a_velocity_and_gives_the_points_of_the_live_run(tmp_path: Path) -> None:
    with laboratory(with_vibrometer(corner_hz=0.5)) as lab:
        ran = run(DWELL, tmp_path, lab)
    with h5py.File(ran.path) as file:
        trace = file["entry/trace"]
        assert trace["displacement"].attrs["scaled_units"] == VELOCITY_UNIT
        assert file["entry/instrument/displacement_sensor/gain"].attrs["units"] == GAIN_UNIT
        assert file["entry/instrument/displacement_sensor/corner"][()] == 0.5
    with Run(ran.path) as file:
        assert file.record.sensor.measures_velocity
        again = DWELL.point((FREQUENCIES_HZ[0],), [next(iter(file.trace.recordings()))], simulated=True)
    assert again.fundamental == pytest.approx(ran.points[0].fundamental, rel=1e-9)
    assert again.phase == pytest.approx(ran.points[0].phase, abs=1e-9)


@pytest.mark.deep
def test_a_sweep_finds_the_resonance_that_a_displacement_sensor_finds(tmp_path: Path) -> None:
    estimates = []
    for name, config in (("laser", simulated()), ("vibrometer", with_vibrometer())):
        with laboratory(config) as lab:
            ran = run(Sweep(), tmp_path / name, lab)
        assert ran.status is RunStatus.COMPLETED, ran.reason
        with Run(ran.path) as file:
            estimates.append({each.name: each for each in file.record.estimates})
            peak = ran.points[0].peak_response
        estimates[-1]["peak"] = peak
    laser, vibrometer = estimates
    for name in ("natural_frequency", "damping_ratio"):
        error = math.hypot(laser[name].standard_error, vibrometer[name].standard_error)
        assert abs(laser[name].value - vibrometer[name].value) < 3 * error + 1e-4 * laser[name].value, name
    assert vibrometer["peak"] * (1 + GAIN_ERROR) == pytest.approx(laser["peak"], rel=2e-3)


@pytest.mark.parametrize("protocol", [VoltageSteps(), FreeDecay()], ids=["voltage-steps", "free-decay"])
def test_a_protocol_that_needs_the_mean_is_refused_in_a_sentence_before_anything_moves(
    protocol: Protocol, tmp_path: Path
) -> None:
    with laboratory(with_vibrometer()) as lab:
        ran = run(protocol, tmp_path, lab)
    assert ran.status is RunStatus.FAILED
    assert not any(isinstance(event, DriveStarted) for event in ran.events)
    assert_names(ran.reason, "vibrometer", "velocity", "sine-dwell", "membrane-series", "sweep")


def test_a_velocity_beyond_the_range_of_the_vibrometer_flags_the_point(tmp_path: Path) -> None:
    config = with_vibrometer(valid_low_v=-4.0, valid_high_v=4.0)
    with laboratory(config) as lab:
        ran = run(SineDwell(frequencies_hz=(60.0, 150.0), record_s=0.2, min_cycles=10), tmp_path, lab)
    slow, fast = (Quality(point.quality) for point in ran.points)
    assert slow.usable
    assert Quality.OUT_OF_RANGE in fast


def test_a_bent_capacitive_probe_gives_the_displacement_of_the_plant_by_its_calibration_curve(tmp_path: Path) -> None:
    """The straight line is off by the bend, 3 % at full range; between eleven points the curve is off by h^2 f'' / 8."""
    gain, bend_per_m, reach_m = 1e-4, 150.0, 5e-4
    places_m = np.linspace(-reach_m, reach_m, 11)
    points = [(float(m), float(m / gain * (1 + bend_per_m * m))) for m in places_m]
    sensor = {"gain_m_per_v": gain, "delay_s": 1e-4, "calibration_points": points}
    config = simulated(
        sensor={"gain_m_per_v": gain, "curve_per_m": bend_per_m, "noise_m": 1e-8, "delay_s": 1e-4}
    ).model_dump()
    amplitudes = {}
    for use in (False, True):
        bench = BenchConfig.model_validate(config | {"sensor": sensor | {"use_curve": use}})
        with laboratory(bench) as lab:
            truth = Truth(lab.control)
            ran = run(SineDwell(frequencies_hz=(60.0,), record_s=0.2, min_cycles=10), tmp_path / str(use), lab, truth)
        assert ran.status is RunStatus.COMPLETED, ran.reason
        amplitudes[use] = ran.points[0].fundamental / abs(truth.values[0]) - 1
    assert abs(amplitudes[True]) < (places_m[1] - places_m[0]) ** 2 * bend_per_m / 8 / 1e-4
    assert abs(amplitudes[False]) > 3 * abs(amplitudes[True])
    with Run(ran.path) as file:
        assert file.record.sensor.curve == tuple(sorted(points, key=lambda point: point[1]))
