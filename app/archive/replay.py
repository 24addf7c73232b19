"""Loading of a finished run for display: points, curves, estimates, log messages and traces."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, fields
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from app.common import (
    ResultSummary,
    Severity,
    format_point,
    minmax_decimate,
    minmax_pairs,
    natural_frequency_of,
    summarize_result,
)
from model import Array, current_column, format_time
from protocols import PROTOCOLS, measured_points
from protocols.base import (
    EVENTS,
    BlockStored,
    DriveStarted,
    PointMeasured,
    PromptShown,
    Protocol,
    RecordingFinished,
    Series,
    usable_mask,
)
from protocols.runfile import (
    RESPONSE_COLUMNS,
    LoggedEvent,
    Run,
    RunReadError,
    RunRecord,
    RunTrace,
    translate_read_errors,
)

if TYPE_CHECKING:
    from app.session import LogLine

ROWS_PER_CHUNK = 1_000_000
TRACE_COLUMNS = 2000

Sketch = tuple[Array, Array]
"""Places of the points of a thumbnail in a unit square, each (N,); empty without points."""
NO_SKETCH: Sketch = (np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True)
class TraceWindow:
    """Drive (V) and displacement (um) over the time shown, all (N,): as low, high, low, high ..., or every sample."""

    time_s: Array
    drive_v: Array
    displacement_um: Array
    unit: str = "m"
    """Unit of the sensor: m; m/s of a vibrometer, whose velocity in um/s stands for the displacement."""
    raw: bool = False
    """True if every sample is included, False for minimum and maximum pairs."""


@dataclass(frozen=True, slots=True)
class LoadedRun:
    """A run as a page shows it: its record with points, series, log and traces in memory."""

    path: Path
    record: RunRecord
    points: tuple[Any, ...]
    series: tuple[Series, ...]
    messages: "tuple[LogLine, ...]"
    traces: TraceWindow
    hints: tuple[str, ...] = ()
    """The protocol's warnings about the points."""

    @property
    def max_hz(self) -> float:
        """Highest frequency of the points."""
        return max((float(p.frequency) for p in self.points if hasattr(p, "frequency")), default=250.0)

    @property
    def result(self) -> ResultSummary:
        """Summary of the run for the result card."""
        return _result(self.path, self.record, self.points, self.hints)


@dataclass(frozen=True, slots=True)
class MeasuredResponse:
    """Amplitudes of a run over frequency, to be overlaid on model curves, SI."""

    path: Path
    label: str
    simulated: bool
    peak_to_peak_v: float
    """Drive amplitude as recorded."""
    peak_to_peak: Series
    """Max - min of the points in the order of their frequencies; NaN where not measured, as in the fundamental."""
    fundamental: Series
    """Peak amplitude of the fundamental, with its phase where every point has one."""
    natural_hz: float = math.nan
    """Identified natural frequency; NaN without one."""

    @property
    def frequency_hz(self) -> Array:
        """(P,)."""
        return self.peak_to_peak.x

    @property
    def phase(self) -> Array:
        """Phase of the fundamental, rad, unwrapped over the frequencies, (P,); NaN where not measured."""
        angle = self.fundamental.phase
        return np.full(self.frequency_hz.size, np.nan) if angle is None else np.unwrap(angle)

    @property
    def title(self) -> str:
        """The label, with a mark if the run is simulated."""
        return f"{self.label}{', SIMULATED' if self.simulated else ''}"


def load_run(path: Path, with_traces: bool = True) -> LoadedRun:
    """Read a run; without its traces, which take long where there are many samples, they are empty.

    Raises:
        RunReadError: it cannot be read.
    """
    with Run(path) as run, translate_read_errors(path):
        kind = PROTOCOLS.get(run.record.protocol)
        begun = datetime.fromisoformat(run.record.start_time).astimezone()
        log = [_log_line(event, begun, kind) for event in run.events()]
        points = tuple(_load_points(run, kind))
        return LoadedRun(
            path,
            run.record,
            points,
            run.series(),
            tuple(message for message in log if message is not None),
            read_trace_window(run.trace) if with_traces else TraceWindow(np.empty(0), np.empty(0), np.empty(0)),
            _load_hints(run, kind, points),
        )


def run_result(run: Run) -> ResultSummary:
    """Return the summary of an open run for the result card."""
    kind = PROTOCOLS.get(run.record.protocol)
    points = tuple(_load_points(run, kind))
    return _result(run.path, run.record, points, _load_hints(run, kind, points))


def _result(path: Path, record: RunRecord, points: tuple[Any, ...], hints: tuple[str, ...]) -> ResultSummary:
    kind = PROTOCOLS.get(record.protocol)
    listed = kind is not None and all(isinstance(point, kind.point_type) for point in points)
    return summarize_result(
        record.verdict,
        record.reason,
        record.estimates,
        kind if listed else None,  # points of another version, or imported ones, are not listed
        points,
        hints,
        str(path),
        record.simulated,
        gain_uncertainty=record.sensor.gain_relative_uncertainty,
    )


def read_measured_response(path: Path) -> MeasuredResponse:
    """Return the points of a run that has a response over frequency.

    Raises:
        RunReadError: it cannot be read, or has none.
    """
    with Run(path) as run, translate_read_errors(path):
        points = run.points()
        if not (points.keys() >= RESPONSE_COLUMNS and points["frequency"].size):
            raise RunReadError(f"{path.name} has no points over frequency; take a finished sine dwell")
        order = np.argsort(points["frequency"], kind="stable")
        columns = {name: column[order] for name, column in points.items()}
        f, usable = columns["frequency"], usable_mask(columns["quality"])
        whole, size, phase = (columns[name] for name in ("peak_to_peak", "fundamental", "phase"))
        if np.isfinite(phase[np.isfinite(size)]).all():
            size = size * np.exp(1j * phase)
        return MeasuredResponse(
            path=path,
            label=f"{run.record.specimen} {format_time(run.record.start_time)}",
            simulated=run.record.simulated,
            peak_to_peak_v=2 * float(np.median(columns["drive_amplitude"])),
            peak_to_peak=Series(f, whole, columns["peak_to_peak_errors"], usable=usable),
            fundamental=Series(f, size, columns["fundamental_errors"], usable=usable),
            natural_hz=natural_frequency_of(run.record.estimates),
        )


def read_sketch(path: Path, most: int) -> Sketch:
    """Return what a thumbnail of a run shows: its points on the axes of the protocol, else its last curve, of about `most` points.

    Raises:
        RunReadError: it cannot be read.
    """
    with Run(path) as run, translate_read_errors(path):
        points, (x_name, y_name) = run.points(), run.record.axes
        if {x_name, y_name} <= points.keys() and points[x_name].size > 1:
            series = Series(points[x_name], points[y_name], usable=usable_mask(points["quality"]))
            if "part" in points:  # of several passes over x the first
                series = series.at(points["part"] == points["part"][0])
        elif (curves := run.series()) and curves[-1].x.size > 1:
            series = curves[-1]
        else:
            return NO_SKETCH
        x, y = series.x, series.plotted
    good = np.isfinite(x) & np.isfinite(y) & (True if series.usable is None else series.usable)
    order = np.argsort(x[good], kind="stable")[:: max(int(good.sum()) // most, 1)]
    x, y = x[good][order], y[good][order]
    return (_unit(x), _unit(y)) if x.size > 1 else NO_SKETCH


def _unit(values: Array) -> Array:
    span = float(np.ptp(values))
    return (values - values.min()) / span if span > 0 else np.full(values.size, 0.5)


def read_trace_window(trace: RunTrace, start: int = 0, stop: int | None = None) -> TraceWindow:
    """Return the min/max decimation of rows start..stop to `TRACE_COLUMNS` columns; a million rows are in memory at once."""
    stop = trace.sample_count if stop is None else min(stop, trace.sample_count)
    per = max(-(-(stop - start) // TRACE_COLUMNS), 1)
    if 0 < stop - start <= 2 * TRACE_COLUMNS:
        return TraceWindow(
            trace.time_s(start, stop),
            trace.drive_v(start, stop),
            1e6 * trace.displacement_m(start, stop),
            trace.sensor().unit,
            raw=True,
        )
    times, drives, displacements = [np.empty(0)], [np.empty(0)], [np.empty(0)]
    step = max(ROWS_PER_CHUNK // per, 1) * per
    for first in range(start, stop, step):
        last = min(first + step, stop)
        time_s, drive_v = minmax_decimate(trace.time_s(first, last), trace.drive_v(first, last), per)
        times.append(time_s)
        drives.append(drive_v)
        displacements.append(minmax_pairs(1e6 * trace.displacement_m(first, last), per))
    return TraceWindow(
        np.concatenate(times), np.concatenate(drives), np.concatenate(displacements), trace.sensor().unit
    )


def load_trace_window(path: Path, from_s: float, to_s: float) -> TraceWindow:
    """Read the traces of a part of a run: every sample if there are few enough.

    Raises:
        RunReadError: it cannot be read.
    """
    with Run(path) as run, translate_read_errors(path):
        trace = run.trace
        rows = range(trace.sample_count)

        def scan_time_s(row: int) -> float:
            return float(trace.time_s(row, row + 1)[0])

        start, stop = bisect_left(rows, from_s, key=scan_time_s), bisect_right(rows, to_s, key=scan_time_s)
        return read_trace_window(trace, max(start - 1, 0), stop + 1)


def _load_hints(run: Run, kind: type[Protocol] | None, points: Sequence[Any]) -> tuple[str, ...]:
    """Return the protocol's warnings about the points; none of a run with other columns or parameters than this version's."""
    if kind is None or kind.warnings is Protocol.warnings:
        return ()
    try:
        return kind.model_validate(run.record.parameters).warnings(points)
    except (ValueError, AttributeError, TypeError):
        return ()


def _load_points(run: Run, kind: type[Protocol] | None) -> list[Any]:
    columns = run.points()
    if kind is not None and set(kind.axes) <= columns.keys():
        return [point for _, point in measured_points(run, kind.point_type)]
    rows = zip(*columns.values(), strict=True)
    points = [SimpleNamespace(**dict(zip(columns, row, strict=True))) for row in rows]
    for point in points:
        point.quality = int(getattr(point, "quality", 0))
    return points


def _log_line(event: LoggedEvent, started: datetime, protocol: type[Protocol] | None) -> "LogLine | None":
    """Return the log line of an event, None if the event is not logged."""
    from app.session import LogLine, describe_event  # not needed for a report

    kind: Any = EVENTS.get(event.kind)  # None for a type of a newer version of this program
    at = started + timedelta(seconds=event.time_s)
    try:
        if event.kind == PointMeasured.kind:
            # A value that is not finite is stored as null.
            stored = event.fields["point"]
            values = {current_column(n, stored): math.nan if v is None else v for n, v in stored.items()}
            whole = protocol is not None and values.keys() == {field.name for field in fields(protocol.point_type)}
            make = protocol.point_type if protocol is not None and whole else SimpleNamespace
            return LogLine(at, Severity.INFO, format_point(make(**values)))
        if event.kind == PromptShown.kind:
            return LogLine(at, Severity.WARNING, f"Asked: {event.fields['prompt']['text']}")
        if kind in (None, DriveStarted, RecordingFinished, BlockStored):
            return None
        message = describe_event(kind(**event.fields))
    except (TypeError, KeyError, AttributeError, ValueError):  # an event of another version: log its name
        return LogLine(at, Severity.INFO, event.kind)
    return None if message is None else LogLine(at, *message)
