"""Time series under a sine, one file a frequency: each becomes a point of a sine dwell, and is kept as a curve of the run."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.archive.importing.columns import ImportingError, Matched
from app.archive.importing.points import Taken
from app.archive.importing.table import Sheet
from app.archive.importing.values import Asked, sources, values_of
from app.common.progress import Tell, part, parts, untold
from drivers.drive import Sine
from protocols.base.quality import Quality
from protocols.base.records import Column, Curve, Recording
from protocols.measurements.sine_dwell import SinePoint, sine_point
from protocols.registry import PROTOCOLS
from protocols.signals import fit_frequency, fit_sine

Array = NDArray[np.float64]

LEAST_CYCLES = 3
LOOKED = 0.4
"""How far a series is when its numbers are there: what is left is finding its frequency and its sine."""
EVEN = 0.01
"""By how much of a sample the times may be uneven."""
NO_SINE = 0.1
"""What a sine fit leaves of the drive, as a share of its amplitude, above which it is none."""


def take_series(series: Sequence[tuple[Sheet, Matched]], asked: Asked, tell: Tell = untold) -> Taken:
    """One run of several time series, a point each.

    Raises:
        ImportingError, SheetError: a sentence that says which file is wrong, where, and what would do.
    """
    points, curves, cautions = [], [], list[str]()
    told = parts(tell, [len(sheet.places) for sheet, _ in series])
    for entry, ((sheet, matched), tell_one) in enumerate(zip(series, told, strict=True)):
        point, curve, said = _point(sheet, matched, asked, tell_one)
        points.append(point)
        curves.append(replace(curve, entry=entry))
        cautions += said
    frequencies = [point.frequency for point in points]
    for i, f in enumerate(frequencies):
        if (j := next((j for j in range(i) if abs(frequencies[j] - f) < 0.05), None)) is not None:
            cautions.append(
                f"{series[i][0].path.name} and {series[j][0].path.name} are both at {f:.4g} Hz: both are kept, as repeats"
            )
    parameters = {"peak_to_peak_v": 2 * max(p.drive_amplitude for p in points), **asked.settings}
    return Taken(
        PROTOCOLS["sine-dwell"],
        tuple(points),
        tuple(range(len(points))),
        parameters,
        tuple(sources(series[0][1], asked)),
        tuple((sheet.path.name, sheet.sha256) for sheet, _ in series),
        tuple(cautions),
        tuple(cells.head for cells in series[0][1].left),
        tuple(curves),
    )


def _point(sheet: Sheet, matched: Matched, asked: Asked, tell: Tell) -> tuple[SinePoint, Curve, list[str]]:
    values, cautions = values_of(sheet, matched, asked, part(tell, 0.0, LOOKED))
    for name, cells in matched.of.items():
        if (gaps := np.flatnonzero(~np.isfinite(values[name]))).size:
            row = int(gaps[0])
            raise ImportingError(
                f"{sheet.at(row, cells)}: '{cells.cells[row]}' is a gap in the series; cut it off there"
            )
    time, moved = values["time"], values["displacement"]
    rate = _rate(sheet, matched, time)
    drive = values.get("drive")
    if drive is None:
        f, amplitude = _told(sheet, asked)
        drive = asked.amplifier.rest_v + amplitude * np.sin(2 * np.pi * f * (time - time[0]))
    else:
        f = _frequency(sheet, drive, rate)
        amplitude = abs(fit_sine(drive, rate, f).fundamental)
    if (time[-1] - time[0]) * f < LEAST_CYCLES:
        raise ImportingError(
            f"{sheet.path} holds {(time[-1] - time[0]) * f:.2g} cycles of {f:.4g} Hz; at least {LEAST_CYCLES} are needed"
        )
    tell(0.5 * (LOOKED + 1.0))
    cycles = max(int((time[-1] - time[0]) * f), 1)
    sine = Sine(f, min(amplitude, asked.amplifier.high_v - asked.amplifier.rest_v), asked.amplifier.rest_v, cycles)
    simulated = asked.simulated or "SIMULATED" in sheet.path.name
    recording = Recording(0, (0, moved.size), rate, sine, drive, moved, Quality.IMPORTED, asked.delay_s)
    try:
        point = sine_point([recording], simulated)
    except ValueError as error:
        raise ImportingError(f"{sheet.path}: {error}") from None
    told = {
        "time": Column(time - time[0], "s", "time"),
        "displacement": Column(moved, "m", "displacement of the centre"),
    }
    if "drive" in values:
        told["drive"] = Column(drive, "V", "volts at the amplifier's input")
    else:
        point = replace(point, phase=math.nan, phase_errors=math.nan)
        cautions.append(f"{sheet.path.name} has no drive: its phase is not known")
    return (
        point,
        Curve("time series", f"{point.frequency:.4g} Hz, {sheet.path.name}", "time", "displacement", told),
        cautions,
    )


def _rate(sheet: Sheet, matched: Matched, time: Array) -> float:
    if time.size < 2:
        raise ImportingError(f"{sheet.path} holds {time.size} samples; a series is needed")
    steps, cells = np.diff(time), matched.of["time"]
    if (back := np.flatnonzero(steps <= 0)).size:
        row = int(back[0]) + 1
        raise ImportingError(
            f"{sheet.at(row, cells)}: {cells.cells[row]} does not come after {cells.cells[row - 1]}; sort the samples by time"
        )
    step = float(np.median(steps))
    if (uneven := np.flatnonzero(np.abs(steps - step) > max(EVEN, 0.02) * step + 2 * np.spacing(time[-1]))).size:
        row = int(uneven[0]) + 1
        raise ImportingError(
            f"{sheet.at(row, cells)}: {steps[row - 1]:.6g} s after the sample before, {step:.6g} s elsewhere; a series must be even: cut it at its gaps, "
            "or write more digits of the time"
        )
    return float((time.size - 1) / (time[-1] - time[0]))


def _frequency(sheet: Sheet, drive: Array, rate: float) -> float:
    """The frequency of the drive, which must be one sine."""
    spectrum = np.abs(np.fft.rfft((drive - drive.mean()) * np.hanning(drive.size)))
    top = int(spectrum[1:].argmax()) + 1
    f = fit_frequency(drive, rate, top * rate / drive.size)
    fit = fit_sine(drive, rate, f)
    if not fit.noise < NO_SINE * abs(fit.fundamental):
        raise ImportingError(
            f"{sheet.path}: the drive is no single sine (beside {abs(fit.fundamental):.3g} V at {f:.4g} Hz there are {fit.noise:.3g} V of something else); "
            "give one file for each frequency"
        )
    return f


def _told(sheet: Sheet, asked: Asked) -> tuple[float, float]:
    """Frequency and amplitude of a drive that was not recorded."""
    f, volts = asked.settings.get("frequencies_hz", ()), asked.settings.get("peak_to_peak_v")
    if len(f) != 1 or volts is None:
        raise ImportingError(
            f'{sheet.path} has no column of the drive: name it, --column drive=NAME, or say what it was: --set frequencies_hz=160 --set "peak_to_peak_v=5 V"'
        )
    return float(f[0]), float(volts) / 2
