"""Import of time series under a sine drive, one file per frequency, as points and curves of a sine dwell."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from app.archive.importing.columns import ColumnMapping
from app.archive.importing.points import ImportedRun
from app.archive.importing.table import ImportTable, TableImportError
from app.archive.importing.values import ImportOptions, column_sources, refuse_cells, table_values
from app.common import NO_PROGRESS, Progress
from drivers import Sine
from model import Array
from protocols.base import CurveColumn, Quality, Recording, ResultCurve
from protocols.measurements.sine_dwell import SinePoint, sine_point
from protocols.registry import PROTOCOLS
from protocols.signals import fit_frequency, fit_sine

MIN_CYCLES = 3
VALUES_SHARE = 0.4
"""Progress of a series when its numbers are parsed; the rest is the sine fit."""
SAMPLING_TOLERANCE = 0.01
"""Tolerated unevenness of the times, in sample intervals."""
MAX_NOISE_RATIO = 0.1
"""Residual of the sine fit relative to the amplitude above which the drive is rejected."""


def build_series_points(
    series: Sequence[tuple[ImportTable, ColumnMapping]],
    options: ImportOptions,
    progress: Progress = NO_PROGRESS,
) -> ImportedRun:
    """Return one run of several time series, a point each.

    Raises:
        TableImportError: a file is wrong; the message names it, the place and the remedy.
    """
    if options.uncertainties:
        raise TableImportError(
            f"--uncertainty {next(iter(options.uncertainties))}=...: a time series has the uncertainties of its sine fit; leave it "
            "away, and give the sensor's gain by --gain-error"
        )
    points, curves, cautions = [], [], list[str]()
    parts = progress.split([len(sheet.row_locations) for sheet, _ in series])
    for entry, ((sheet, matched), file_progress) in enumerate(zip(series, parts, strict=True)):
        point, curve, warnings = _series_point(sheet, matched, options, file_progress)
        points.append(point)
        curves.append(replace(curve, entry=entry))
        cautions += warnings
    if options.delay_s is None and any(math.isfinite(point.phase) for point in points):
        cautions.append(
            "the delay of the sensor's output is not given and taken as 0: phases are late by as much as it has, 6 degrees at 160 Hz for "
            "100 us; --sensor-delay '100 us' says it"
        )
    frequencies = [point.frequency for point in points]
    for i, f in enumerate(frequencies):
        if (j := next((j for j in range(i) if abs(frequencies[j] - f) < 0.05), None)) is not None:
            cautions.append(
                f"{series[i][0].path.name} and {series[j][0].path.name} are both at {f:.4g} Hz: both are kept, as repeats"
            )
    parameters = {"peak_to_peak_v": 2 * max(p.drive_amplitude for p in points), **options.settings}
    return ImportedRun(
        PROTOCOLS["sine-dwell"],
        tuple(points),
        tuple(range(len(points))),
        parameters,
        tuple(column_sources(series[0][1], options)),
        tuple((sheet.path.name, sheet.sha256) for sheet, _ in series),
        tuple(cautions),
        tuple(cells.heading for cells in series[0][1].unused),
        tuple(curves),
    )


def _series_point(
    table: ImportTable, mapping: ColumnMapping, options: ImportOptions, progress: Progress
) -> tuple[SinePoint, ResultCurve, list[str]]:
    values, cautions = table_values(table, mapping, options, progress.part(0.0, VALUES_SHARE))
    for name, cells in mapping.columns.items():
        refuse_cells(table, cells, ~np.isfinite(values[name]), "'{}' is a gap in the series; cut it off there")
    time, moved = values["time"], values["displacement"]
    rate = _sample_rate(table, mapping, time)
    drive = values.get("drive")
    if drive is None:
        f, amplitude = _stated_drive(table, options)
        drive = options.amplifier.rest_v + amplitude * np.sin(2 * np.pi * f * (time - time[0]))
    else:
        f = _drive_frequency(table, drive, rate)
        amplitude = abs(fit_sine(drive, rate, f).fundamental)
    if (time[-1] - time[0]) * f < MIN_CYCLES:
        raise TableImportError(
            f"{table.path} holds {(time[-1] - time[0]) * f:.2g} cycles of {f:.4g} Hz; at least {MIN_CYCLES} are needed"
        )
    progress.update(0.5 * (VALUES_SHARE + 1.0))
    cycles = max(int((time[-1] - time[0]) * f), 1)
    sine = Sine(
        f, min(amplitude, options.amplifier.high_v - options.amplifier.rest_v), options.amplifier.rest_v, cycles
    )
    simulated = options.simulated or "SIMULATED" in table.path.name
    recording = Recording(0, (0, moved.size), rate, sine, drive, moved, Quality.IMPORTED, options.delay_s or 0.0)
    try:
        point = sine_point([recording], simulated)
    except ValueError as error:
        raise TableImportError(f"{table.path}: {error}") from None
    columns = {
        "time": CurveColumn(time - time[0], "s", "time"),
        "displacement": CurveColumn(moved, "m", "displacement of the centre"),
    }
    if "drive" in values:
        columns["drive"] = CurveColumn(drive, "V", "volts at the amplifier's input")
    else:
        point = replace(point, phase=math.nan, phase_errors=math.nan)
        cautions.append(f"{table.path.name} has no drive: its phase is not known")
    return (
        point,
        ResultCurve("time series", f"{point.frequency:.4g} Hz, {table.path.name}", "time", "displacement", columns),
        cautions,
    )


def _sample_rate(table: ImportTable, mapping: ColumnMapping, time: Array) -> float:
    if time.size < 2:
        raise TableImportError(f"{table.path} holds {time.size} samples; a series is needed")
    steps, cells = np.diff(time), mapping.columns["time"]
    if (back := np.flatnonzero(steps <= 0)).size:
        row = int(back[0]) + 1
        raise TableImportError(
            f"{table.cell_location(row, cells)}: {cells.cells[row]} does not come after {cells.cells[row - 1]}; sort the samples by time"
        )
    step = float(np.median(steps))
    if (
        uneven := np.flatnonzero(np.abs(steps - step) > max(SAMPLING_TOLERANCE, 0.02) * step + 2 * np.spacing(time[-1]))
    ).size:
        row = int(uneven[0]) + 1
        raise TableImportError(
            f"{table.cell_location(row, cells)}: {steps[row - 1]:.6g} s after the sample before, {step:.6g} s elsewhere; a series must be even: cut it at its gaps, "
            "or write more digits of the time"
        )
    return float((time.size - 1) / (time[-1] - time[0]))


def _drive_frequency(table: ImportTable, drive: Array, rate: float) -> float:
    """Return the frequency of the drive, which must be a single sine."""
    spectrum = np.abs(np.fft.rfft((drive - drive.mean()) * np.hanning(drive.size)))
    top = int(spectrum[1:].argmax()) + 1
    f = fit_frequency(drive, rate, top * rate / drive.size)
    fit = fit_sine(drive, rate, f)
    if not fit.noise < MAX_NOISE_RATIO * abs(fit.fundamental):
        raise TableImportError(
            f"{table.path}: the drive is not a single sine (besides {abs(fit.fundamental):.3g} V at {f:.4g} Hz there are {fit.noise:.3g} V of other signals); "
            "give one file for each frequency"
        )
    return f


def _stated_drive(table: ImportTable, options: ImportOptions) -> tuple[float, float]:
    """Return frequency and amplitude of a drive that was not recorded."""
    f, volts = options.settings.get("frequencies_hz", ()), options.settings.get("peak_to_peak_v")
    if len(f) != 1 or volts is None:
        raise TableImportError(
            f'{table.path} has no column of the drive: name it with --column drive=NAME, or give the drive: --set frequencies_hz=160 --set "peak_to_peak_v=5 V"'
        )
    return float(f[0]), float(volts) / 2
