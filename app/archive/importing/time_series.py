"""Import of time series: under a sine, one file per frequency, as points of a sine dwell; under a sweep as a run of its own."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from app.archive.importing.columns import ColumnMapping
from app.archive.importing.points import ImportedRun
from app.archive.importing.swept_series import build_sweep_run, delay_caution, sweep_frequencies, time_series
from app.archive.importing.table import ImportTable, TableImportError
from app.archive.importing.values import ImportOptions, column_sources, refuse_cells, table_values
from app.common import NO_PROGRESS, Progress
from drivers import Sine
from model import Array
from protocols.base import Quality, Recording, Series
from protocols.measurements.sine_dwell import SinePoint, sine_point
from protocols.registry import PROTOCOLS
from protocols.signals import fit_frequency, fit_sine

MIN_CYCLES = 3
SAMPLING_TOLERANCE = 0.01
"""Tolerated unevenness of the times, in sample intervals."""
MAX_NOISE_RATIO = 0.1
"""Residual of the sine fit relative to the amplitude above which the drive is rejected."""


class _Series(NamedTuple):
    table: ImportTable
    mapping: ColumnMapping
    values: Mapping[str, Array]
    rate_hz: float
    cautions: tuple[str, ...]


def build_series_runs(
    series: Sequence[tuple[ImportTable, ColumnMapping]],
    options: ImportOptions,
    progress: Progress = NO_PROGRESS,
) -> list[ImportedRun]:
    """Return one run of all time series under a sine, a point each, and one of every time series under a sweep.

    Raises:
        TableImportError: a file is wrong; the message names it, the place and the remedy.
    """
    if options.uncertainties:
        raise TableImportError(
            f"--uncertainty {next(iter(options.uncertainties))}=...: a time series has the uncertainties of its sine fit; leave it "
            "away, and give the sensor's gain by --gain-error"
        )
    parts = progress.split([len(sheet.row_locations) for sheet, _ in series])
    sines, runs = list[_Series](), list[ImportedRun]()
    for (sheet, matched), file_progress in zip(series, parts, strict=True):
        each = _read_series(sheet, matched, options, file_progress)
        drive = each.values.get("drive")
        if drive is None or _is_single_sine(drive, each.rate_hz) or sweep_frequencies(drive, each.rate_hz) is None:
            sines.append(each)
        else:
            run = build_sweep_run(sheet, matched, each.values, each.rate_hz, options)
            runs.append(replace(run, warnings=(*each.cautions, *run.warnings)))
    return [*([_dwell_of_sines(sines, options)] if sines else []), *runs]


def _read_series(table: ImportTable, mapping: ColumnMapping, options: ImportOptions, progress: Progress) -> _Series:
    values, cautions = table_values(table, mapping, options, progress)
    for name, cells in mapping.columns.items():
        refuse_cells(table, cells, ~np.isfinite(values[name]), "'{}' is a gap in the series; cut it off there")
    return _Series(table, mapping, values, _sample_rate(table, mapping, values["time"]), tuple(cautions))


def _dwell_of_sines(series: Sequence[_Series], options: ImportOptions) -> ImportedRun:
    points, curves, cautions = [], list[Series](), list[str]()
    for entry, each in enumerate(series):
        point, series_of_entry, warnings = _series_point(each, options)
        points.append(point)
        curves += [replace(one, entry=entry) for one in series_of_entry]
        cautions += warnings
    if any(math.isfinite(point.phase) for point in points):
        cautions += delay_caution(options)
    frequencies = [point.frequency for point in points]
    for i, f in enumerate(frequencies):
        if (j := next((j for j in range(i) if abs(frequencies[j] - f) < 0.05), None)) is not None:
            cautions.append(
                f"{series[i].table.path.name} and {series[j].table.path.name} are both at {f:.4g} Hz: both are kept, as repeats"
            )
    parameters = {"peak_to_peak_v": 2 * max(p.drive_amplitude for p in points), **options.settings}
    return ImportedRun(
        PROTOCOLS["sine-dwell"],
        tuple(points),
        tuple(range(len(points))),
        parameters,
        tuple(column_sources(series[0].mapping, options)),
        tuple((sheet.path.name, sheet.sha256) for sheet, *_ in series),
        tuple(cautions),
        tuple(cells.heading for cells in series[0].mapping.unused),
        tuple(curves),
    )


def _series_point(series: _Series, options: ImportOptions) -> tuple[SinePoint, tuple[Series, ...], list[str]]:
    table, _, values, rate, _ = series
    cautions = list(series.cautions)
    time, moved = values["time"], values["displacement"]
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
    if "drive" not in values:
        point = replace(point, phase=math.nan, phase_errors=math.nan)
        cautions.append(f"{table.path.name} has no drive: its phase is not known")
    label = f"{point.frequency:.4g} Hz, {table.path.name}"
    return point, time_series(time, moved, values.get("drive"), label), cautions


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


def _is_single_sine(drive: Array, rate: float) -> bool:
    fit = fit_sine(drive, rate, _largest_frequency(drive, rate))
    return fit.noise < MAX_NOISE_RATIO * abs(fit.fundamental)


def _largest_frequency(drive: Array, rate: float) -> float:
    spectrum = np.abs(np.fft.rfft((drive - drive.mean()) * np.hanning(drive.size)))
    return fit_frequency(drive, rate, (int(spectrum[1:].argmax()) + 1) * rate / drive.size)


def _drive_frequency(table: ImportTable, drive: Array, rate: float) -> float:
    """Return the frequency of the drive, which must be a single sine."""
    f = _largest_frequency(drive, rate)
    fit = fit_sine(drive, rate, f)
    if not fit.noise < MAX_NOISE_RATIO * abs(fit.fundamental):
        raise TableImportError(
            f"{table.path}: the drive is not a single sine (besides {abs(fit.fundamental):.3g} V at {f:.4g} Hz there are {fit.noise:.3g} V of other signals); "
            "give one file for each frequency, or one with a single sweep up or down"
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
