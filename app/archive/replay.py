"""A run as it was: its response, its model, its traces and what happened, read from its file. No Qt."""

from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, fields
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.session.messages import Level, Message, point_words, sentence
from protocols.base.events import EVENTS, Asked, BlockTaken, Playing, PointMeasured, Recorded
from protocols.base.protocol import Protocol
from protocols.base.quality import usable
from protocols.base.records import Curve, Estimate
from protocols.registry import PROTOCOLS
from protocols.resume import points_of
from protocols.runfile.reader import Happened, Run, RunError
from protocols.runfile.trace import Trace

Array = NDArray[np.float64]
CHUNK = 1_000_000
COLUMNS = 2000


@dataclass(frozen=True, slots=True)
class Traces:
    """Drive (V) and displacement (um) over the time shown, all (N,): as low, high, low, high ..., or every sample."""

    time_s: Array
    drive_v: Array
    displacement_um: Array
    raw: bool = False
    """Every sample, none left out."""


@dataclass(frozen=True, slots=True)
class Reopened:
    """Everything the page shows of one run."""

    path: Path
    title: str
    protocol: str
    specimen: str
    state: str
    reason: str
    start_time: str
    simulated: bool
    parameters: Mapping[str, Any]
    points: tuple[Any, ...]
    curves: tuple[Curve, ...]
    estimates: tuple[Estimate, ...]
    messages: tuple[Message, ...]
    traces: Traces
    duration_s: float

    @property
    def top_hz(self) -> float:
        """How far the response reaches."""
        return max((float(p.frequency) for p in self.points if hasattr(p, "frequency")), default=250.0)


@dataclass(frozen=True, slots=True)
class Measured:
    """The points of a run, to lie over the curves; all (P,), SI."""

    path: Path
    label: str
    simulated: bool
    peak_to_peak_v: float
    """Of the drive, as recorded."""
    frequency_hz: Array
    peak_to_peak: Array
    peak_to_peak_errors: Array
    twice_fundamental: Array
    fundamental_errors: Array
    phase: Array
    usable: NDArray[np.bool_]


def reopen(path: Path) -> Reopened:
    """Read a run.

    Raises:
        RunError: it cannot be read; the sentence says why.
    """
    try:
        with Run(path) as run:
            kind = PROTOCOLS.get(run.protocol)
            points = tuple(_points(run, kind))
            begun = datetime.fromisoformat(run.start_time).astimezone()
            log = [_message(event, begun, kind) for event in run.events()]
            return Reopened(
                path,
                run.title,
                run.protocol,
                run.specimen,
                run.state,
                run.reason,
                run.start_time,
                run.simulated,
                run.parameters,
                points,
                run.curves(),
                run.estimates(),
                tuple(message for message in log if message is not None),
                read_traces(run.trace),
                run.trace.duration_s,
            )
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        raise RunError(f"{path} is damaged inside: {error}") from None


def read_measured(path: Path) -> Measured:
    """Return the points of a run that has a response over frequency.

    Raises:
        RunError: it cannot be read, or has none.
    """
    try:
        with Run(path) as run:
            points = run.points()
            if not len(points.get("frequency", ())) or "fundamental" not in points:
                raise RunError(f"{path.name} has no points over frequency; take a finished sine dwell")
            order = np.argsort(points["frequency"], kind="stable")
            columns = {name: column[order] for name, column in points.items()}
            return Measured(
                path,
                f"{run.specimen} {run.start_time[:16].replace('T', ' ')}",
                run.simulated,
                2 * float(np.median(columns["drive_amplitude"])),
                columns["frequency"],
                columns["peak_to_peak"],
                columns["peak_to_peak_errors"],
                2 * columns["fundamental"],
                columns["fundamental_errors"],
                np.unwrap(columns["phase"]),
                usable(columns["quality"]),
            )
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        raise RunError(f"{path.name} is damaged inside: {error}") from None


def read_traces(trace: Trace, start: int = 0, stop: int | None = None) -> Traces:
    """Smallest and largest of each of `COLUMNS` stretches of rows start..stop; a million rows are in memory at once."""
    stop = trace.samples if stop is None else min(stop, trace.samples)
    per = max(-(-(stop - start) // COLUMNS), 1)
    if 0 < stop - start <= 2 * COLUMNS:
        return Traces(
            trace.time_s(start, stop), trace.drive_v(start, stop), 1e6 * trace.displacement_m(start, stop), raw=True
        )
    kept: tuple[list[Array], list[Array], list[Array]] = ([], [], [])
    step = max(CHUNK // per, 1) * per
    for first in range(start, stop, step):
        last = min(first + step, stop)
        edges = np.arange(0, last - first, per)
        kept[0].append(trace.time_s(first, last)[edges])
        for into, values in ((kept[1], trace.drive_v(first, last)), (kept[2], 1e6 * trace.displacement_m(first, last))):
            pairs = np.stack((np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)), axis=1)
            into.append(pairs.ravel())
    if not kept[0]:
        return Traces(np.empty(0), np.empty(0), np.empty(0))
    return Traces(np.repeat(np.concatenate(kept[0]), 2), np.concatenate(kept[1]), np.concatenate(kept[2]))


def look_closer(path: Path, from_s: float, to_s: float) -> Traces:
    """The traces of a part of a run: every sample where they are few enough to be seen.

    Raises:
        RunError: it cannot be read; the sentence says why.
    """
    try:
        with Run(path) as run:
            trace = run.trace
            rows = range(trace.samples)

            def scanned(row: int) -> float:
                return float(trace.time_s(row, row + 1)[0])

            start, stop = bisect_left(rows, from_s, key=scanned), bisect_right(rows, to_s, key=scanned)
            return read_traces(trace, max(start - 1, 0), stop + 1)
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        raise RunError(f"{path} is damaged inside: {error}") from None


def _points(run: Run, kind: type[Protocol] | None) -> list[Any]:
    columns = run.points()
    if kind is not None and not draws(columns) and {f.name for f in fields(kind.point_type)} <= columns.keys():
        return [point for _, point in points_of(run, kind.point_type)]
    rows = zip(*columns.values(), strict=True)
    points = [SimpleNamespace(**dict(zip(columns, row, strict=True))) for row in rows]
    for point in points:
        point.quality = int(getattr(point, "quality", 0))
    return points


def _message(event: Happened, begun: datetime, protocol: type[Protocol] | None) -> Message | None:
    """The event as the log told it, or none where it told nothing."""
    kind: Any = EVENTS.get(event.kind)  # None for a type that only a newer version of this program knows
    at = begun + timedelta(seconds=event.time_s)
    try:
        if event.kind == PointMeasured.kind:
            make = SimpleNamespace if protocol is None or draws(event.fields["point"]) else protocol.point_type
            return Message(at, Level.PLAIN, point_words(make(**event.fields["point"])))
        if event.kind == Asked.kind:
            return Message(at, Level.ATTENTION, f"Asked: {event.fields['prompt']['text']}")
        if kind in (None, Playing, Recorded, BlockTaken):
            return None
        said = sentence(kind(**event.fields))
    except (TypeError, KeyError, AttributeError, ValueError):  # an event of another version: its name at least
        return Message(at, Level.PLAIN, event.kind)
    return None if said is None else Message(at, *said)


def draws(columns: Mapping[str, object]) -> bool:
    """Whether points are amplitudes over frequency, which are drawn and told also where a column is missing."""
    return "frequency" in columns and "peak_to_peak" in columns
