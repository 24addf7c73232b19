"""Import of a recorded chirp whose displacement finite elements made, and the fit of it."""

from pathlib import Path

import numpy as np
import pytest

from app.identification.specimen_identification import identify
from benchmarks.campaigns import elements
from model import Array, Tactor
from model.identification import FrequencyResponseObservation
from protocols.runfile.reader import Run
from tests.helpers.importing import brought, points, refused

RATE_HZ = 4000.0


def chirp(path: Path, sweeps: int = 1) -> Path:
    """A sweep of 10 s from 30 to 420 Hz through the amplifier's two slopes, 0.3 um of noise, the sensor 100 us late."""
    t = np.arange(round(11 * RATE_HZ)) / RATE_HZ
    at = np.mod(np.minimum(t, 10 - 1e-9), 10 / sweeps)
    phase = 2 * np.pi * (30 * at + 0.5 * 390 * sweeps / 10 * at**2)
    drive = 2.5 + np.where(t < 10, 2.5 * np.sin(phase), 0.0)
    volts = np.where(drive > 2.5, 600.0, 200.0) * (drive - 2.5)
    f = np.fft.rfftfreq(t.size, 1 / RATE_HZ)
    grid = np.concatenate((np.arange(0, 700, 0.25), np.arange(700, 2001, 5)))
    H = elements(Tactor(), grid, None, np.inf)
    smooth = np.interp(f, grid, H.real) + 1j * np.interp(f, grid, H.imag)
    moved: Array = np.fft.irfft(np.fft.rfft(volts) * smooth * np.exp(-2j * np.pi * f * 1e-4), t.size)
    moved = moved + 3e-7 * np.random.default_rng(8).standard_normal(t.size)
    table = np.column_stack((t, drive, 1e6 * moved))
    np.savetxt(path, table, "%.9g", delimiter=",", header="time [s],drive [V],displacement [um]", comments="")
    return path


@pytest.mark.deep
def test_a_chirp_becomes_a_sweep_whose_lines_are_those_of_finite_elements(tmp_path: Path) -> None:
    path = brought(chirp(tmp_path / "chirp.csv"), "--sensor-delay", "100 us", "--gain-error", "0.2 %")
    with Run(path) as run:
        assert run.protocol == "sweep"
        assert run.imported
        response, series = run.curves()
        assert response.name == "frequency response"
        assert series.columns["displacement"].values.size == round(11 * RATE_HZ)
    (amplitude,) = points(path)["drive_amplitude"]
    assert amplitude == pytest.approx(2.5, rel=0.01)
    found = identify([path], sheet="none")
    (lines,) = found.observations.of_type(FrequencyResponseObservation)
    truth = 400 * np.asarray(lines.drive_amplitude_v) * elements(Tactor(), lines.frequency_hz, None, np.inf)
    z = (np.asarray(lines.fundamental_m) - truth) / lines.errors_m
    # Measured: 0.54. What leaks of the harmonics of so fast a sweep counts as error (decision 25).
    assert 0.4 < np.sqrt(np.mean(np.abs(z) ** 2) / 2) < 1.1
    for e in found.identified:
        assert abs(e.value - getattr(Tactor(), e.name)) < 3 * e.standard_error, e


@pytest.mark.deep
def test_two_sweeps_in_one_file_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = " ".join(refused(chirp(tmp_path / "two.csv", sweeps=2), capsys).split())
    assert "the drive is not a single sine" in said
    assert "or one with a single sweep up or down" in said


@pytest.mark.deep
def test_a_sweep_on_the_membrane_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(chirp(tmp_path / "c.csv"), capsys, "--as", "raw", "--membrane-elongation", "1.27 mm")
    assert "elongation" in said
