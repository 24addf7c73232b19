"""Import of a time series under one sweep or chirp, as a run of the protocol `sweep` with its frequency response."""

import math
from collections.abc import Mapping

import numpy as np

from app.archive.importing.columns import ColumnMapping
from app.archive.importing.points import ImportedRun
from app.archive.importing.table import ImportTable, TableImportError
from app.archive.importing.values import ImportOptions, column_sources
from model import Array
from protocols.base import Quality, Series, SeriesAxis
from protocols.measurements.response_series import check_response_present, frequency_response_series
from protocols.measurements.sweep import sweep_point
from protocols.registry import PROTOCOLS
from protocols.signals import estimate_swept_response

MIN_CROSSINGS = 40
"""Of the middle of the drive's range: fewer are no sweep."""

MIN_FREQUENCY_RATIO = 1.5
"""Of the highest to the lowest frequency of a sweep."""

MIN_MONOTONY = 0.98
"""Correlation of time and frequency, by rank."""

LINEAR_TOLERANCE = 0.05
"""Deviation of the frequency from a straight line over time, as a share of the band, from which on a caution is given."""


def sweep_frequencies(drive: Array, rate_hz: float) -> tuple[Array, Array] | None:
    """Return times (s) and frequencies (Hz) of a single sweep from its zero crossings; None for another drive."""
    centred = drive - 0.5 * (drive.max() + drive.min())
    at = np.flatnonzero(np.diff(np.signbit(centred)))
    if at.size < MIN_CROSSINGS:
        return None
    crossings = (at + centred[at] / (centred[at] - centred[at + 1])) / rate_hz
    # Whole cycles, so that an offset does not count, averaged over five.
    cycles = crossings[2:] - crossings[:-2]
    time = 0.5 * (crossings[2:] + crossings[:-2])
    parts = max(cycles.size // 5, 8)
    time, f = (np.array([each.mean() for each in np.array_split(x, parts)]) for x in (time, 1 / cycles))
    order = np.argsort(np.argsort(f))
    monotony = float(np.corrcoef(order, np.arange(parts))[0, 1]) if np.ptp(order) else 0.0
    if abs(monotony) < MIN_MONOTONY or f.max() < MIN_FREQUENCY_RATIO * f.min():
        return None
    return time, f


def build_sweep_run(
    table: ImportTable, mapping: ColumnMapping, values: Mapping[str, Array], rate_hz: float, options: ImportOptions
) -> ImportedRun:
    """Return the run of one swept time series, whose drive `sweep_frequencies` recognized.

    Raises:
        TableImportError: there is no response, or the sweep is too short.
    """
    drive, moved, time = values["drive"], values["displacement"], values["time"]
    at, f = sweep_frequencies(drive, rate_hz) or (time[:0], time[:0])
    if options.elongation_m is not None:
        raise TableImportError(
            f"{table.path} is a sweep, and a run of a sweep has no elongation; leave --membrane-elongation away if the tactor was free, "
            "else give a table of frequency and receptance"
        )
    low, high = float(np.percentile(f, 1)), float(np.percentile(f, 99))
    try:
        response = estimate_swept_response(drive, moved, rate_hz, (low, high), delay_s=options.delay_s or 0.0)
        check_response_present(response)
        amplitude_v = 0.5 * float(np.ptp(drive))
        simulated = options.simulated or "SIMULATED" in table.path.name
        quality = Quality.IMPORTED | (Quality.SIMULATED if simulated else Quality.GOOD)
        point = sweep_point(1.0, response, amplitude_v, int(quality))
    except ValueError as error:
        raise TableImportError(f"{table.path}: {error}") from None
    cautions = [f"{table.path.name} is taken for one sweep from {f[0]:.4g} to {f[-1]:.4g} Hz"]
    bent = float(np.abs(f - np.polyval(np.polyfit(at, f, 1), at)).max()) / (high - low)
    if bent > LINEAR_TOLERANCE:
        cautions.append(
            f"the sweep's frequency does not rise or fall evenly (by {100 * bent:.2g} % of its band): lines are given only where it was slow"
        )
    return ImportedRun(
        PROTOCOLS["sweep"],
        (point,),
        (0,),
        {"peak_to_peak_v": 2 * amplitude_v},
        tuple(column_sources(mapping, options)),
        ((table.path.name, table.sha256),),
        (*cautions, *delay_caution(options)),
        tuple(cells.heading for cells in mapping.unused),
        (frequency_response_series(response), *time_series(time, moved, drive, table.path.name)),
    )


def time_series(time: Array, moved: Array, drive: Array | None, label: str) -> tuple[Series, ...]:
    """Return the drive, where it was recorded, and the displacement over time; all (N,), SI."""
    axis, since = SeriesAxis("time", "s", "time"), time - time[0]
    driven, measured = (
        SeriesAxis("drive", "V", "volts at the amplifier's input"),
        SeriesAxis("displacement", "m", "displacement of the centre"),
    )
    shown = Series(since, moved, x_axis=axis, y_axis=measured, name="time series", label=label)
    if drive is None:
        return (shown,)
    return Series(since, drive, x_axis=axis, y_axis=driven, name="time series of the drive", label=label), shown


def delay_caution(options: ImportOptions) -> tuple[str, ...]:
    """Return the caution that the sensor's delay is not given, if it is not."""
    if options.delay_s is not None and math.isfinite(options.delay_s):
        return ()
    words = (
        "the delay of the sensor's output is not given and taken as 0: phases are late by as much as it has, 6 degrees at 160 Hz for "
        "100 us; --sensor-delay '100 us' says it"
    )
    return (words,)
