"""Run files for tests, written by the product's writer without a bench."""

import shutil
from pathlib import Path
from unittest import mock

import h5py
import numpy as np

from drivers.drive_shapes import Sine
from drivers.interfaces import Block, Scale
from drivers.sensors.laser_sensor import LaserSensor
from protocols.base import BenchArmed, EstimatedQuantity, LogMessage, Quality, RunStatus, Verdict
from protocols.measurements.sine_dwell import SineDwell, SinePoint
from protocols.runfile.record import RunRecord
from protocols.runfile.writer import NOT_JUDGED, RunFileWriter

SCALES = (Scale((0.0, 10 / 32768)), Scale((0.0, 10 / 32768)))
NOBODY = 4_200_000
"""No process has this number: it is beyond what the system gives."""
FOUND = EstimatedQuantity("natural_frequency", 158.35, 0.01, "Hz", "fit")


def sine_point(frequency_hz: float, size_m: float = 1e-3, quality: Quality = Quality.SIMULATED) -> SinePoint:
    return SinePoint(
        frequency_hz, size_m, 2e-6, 0.48 * size_m, 1e-8, -0.5, 1e-4, 0.1, (size_m,) * 8, 2.5, 2.5, 0, 0, 5e-7, 80,
        int(quality),
    )  # fmt: skip


def initial_record(specimen: str, frequencies: tuple[float, ...], rate_hz: float) -> RunRecord:
    return RunRecord(
        protocol="sine-dwell",
        title=f"Sine dwell of {specimen}",
        parameters=SineDwell(frequencies_hz=frequencies, sample_rate_hz=rate_hz).model_dump(),
        axes=("frequency", "peak_to_peak"),
        sensor=LaserSensor("laser", 1e-4),
        simulated=True,
        specimen=specimen,
    )


def begun_run(folder: Path, specimen: str, frequencies: tuple[float, ...], rate_hz: float) -> RunFileWriter:
    file = RunFileWriter.new(folder, initial_record(specimen, frequencies, rate_hz), SinePoint)
    file.start_stream(rate_hz, SCALES)
    wave = np.sin(2 * np.pi * 100.0 * np.arange(1000) / rate_hz)
    raw = np.round(np.stack([2.5 + 2.5 * wave, 5 * wave]) * 3276.8).astype(np.int16)
    file.append_event(BenchArmed(), 0.0)
    file.append_block(Block(0, raw), 0.2)
    file.append_block(Block(2000, raw), 0.6)  # a gap: a thousand scans were not kept
    file.append_event(LogMessage("ß: a long remark " * 100), 0.3)
    file.append_recording((0, 1000), int(Quality.SIMULATED), Sine(100.0, 2.5, 2.5, 20))
    return file


def finished_run(
    folder: Path,
    specimen: str = "T7",
    frequencies: tuple[float, ...] = (100.0, 160.0),
    rate_hz: float = 5000.0,
    size_m: float = 1e-3,
    verdict: Verdict = NOT_JUDGED,
) -> Path:
    """A run of a few points that ended in order."""
    file = begun_run(folder, specimen, frequencies, rate_hz)
    for f in frequencies:
        file.append_point(sine_point(f, size_m))
    file.finish(RunStatus.COMPLETED, "all points measured", (FOUND,), verdict=verdict)
    return file.path


def crashed_run(folder: Path, specimen: str = "T3") -> Path:
    """What a program leaves that is killed after its first point."""
    with mock.patch("protocols.runfile.writer.os.getpid", return_value=NOBODY):
        file = begun_run(folder / ".writing", specimen, (100.0, 160.0), 5000.0)
    file.append_point(sine_point(100.0))
    folder.mkdir(exist_ok=True)
    left = folder / file.path.name
    shutil.copy(file.path, left)
    file.close_after_error()
    shutil.rmtree(folder / ".writing")
    return left


def newer_run(folder: Path, specimen: str = "T5") -> Path:
    """A run of a future format."""
    path = finished_run(folder, specimen)
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = 99
    return path
