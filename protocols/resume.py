"""Resuming a stopped, failed or crashed run, or repeating some of its entries.

The new file carries over all points, links to the raw data of the old file, and appears as one run to readers. First the last
good entry is measured again, which shows drift: temperature, a moved sensor, creep.
"""

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from model import AmplifierMap
from protocols.base import (
    CyclesInterrupted,
    CycleStatistics,
    EntryStarted,
    PlanEntry,
    Prompt,
    Quality,
    Recording,
    RunStatus,
    Series,
)
from protocols.registry import ENDURANCE, PROTOCOLS
from protocols.runfile import AIR_COLUMNS, ENTRY_COLUMN, RunReadError

if TYPE_CHECKING:
    from protocols.base import Protocol
    from protocols.runfile import Run, RunRecord

DRIFT_SIGMAS, DRIFT_FRACTION = 4.0, 0.02
"""A change larger than both counts as drift: significant, and large enough to matter."""


@dataclass(frozen=True, slots=True)
class ResumableRun:
    """A run that can be resumed.

    Attributes:
        points: carried-over points, with their entries.
        drift_check_entry: the last good entry, which is measured again first; None where entries are repeated.
        repeat_entries: entries to repeat.
        message: what is continued, as a sentence.
        series: curves of the carried-over entries.
        driven: cycles of interrupted blocks, by entry.
        air: values of the air of the carried-over points, by entry and column.
    """

    path: Path
    protocol: "Protocol"
    record: "RunRecord"
    points: tuple[tuple[int, Any], ...] = ()
    drift_check_entry: int | None = None
    repeat_entries: frozenset[int] = frozenset()
    message: str = ""
    series: tuple[Series, ...] = ()
    driven: Mapping[int, CycleStatistics] = field(default_factory=dict)
    air: Mapping[int, Mapping[str, float]] = field(default_factory=dict)

    def assess_drift(self, label: str, first: Any, second: Any) -> tuple[str, Prompt | None]:
        """Compare two measurements of an entry; return a message, and a prompt if the drift is too large."""
        column = self.protocol.axes[1]
        old, new = float(getattr(first, column)), float(getattr(second, column))
        error = math.hypot(
            float(getattr(first, f"{column}_errors", 0.0)), float(getattr(second, f"{column}_errors", 0.0))
        )
        change = new - old
        relative = abs(change / old) if old else math.inf
        sigmas = abs(change) / error if error > 0 else math.inf
        note = f"Drift check at {label}: {column} changed by {100 * math.copysign(relative, change):+.2f} %"
        note += f" ({sigmas:.1f} standard errors)" if math.isfinite(sigmas) else ""
        if relative <= DRIFT_FRACTION or sigmas <= DRIFT_SIGMAS:
            return note, None
        question = f"{note}. More than errors explain: was the sensor or the specimen moved? Go on, or stop?"
        return note, Prompt("drifted", question, choices=("go on", "stop"))


def protocol_of_run(run: "Run", run_name: str) -> "Protocol":
    """Return the protocol of a run with its parameters; `run_name` names the run in messages.

    Raises:
        RunReadError: the protocol is unknown, or this version rejects its parameters.
    """
    from pydantic import ValidationError  # slow to import; a list of runs does not need it

    kind = PROTOCOLS.get(run.record.protocol)
    if kind is None:
        raise RunReadError(
            f"{run_name} is a run of '{run.record.protocol}', an unknown protocol; load its file as well"
        )
    try:
        return kind(**run.record.parameters)
    except ValidationError as error:
        raise RunReadError(
            f"{run_name} has parameters that this version rejects: {error.errors()[0]['msg']}"
        ) from error


def load_resumable(path: Path, repeat_entries: Sequence[int] = ()) -> ResumableRun:
    """Load a run to resume it, or to measure `repeat_entries` again.

    Raises:
        RunReadError: the file is not a run, still being written, complete with nothing to repeat, or of an unknown protocol.
    """
    from protocols.base import extend_plan
    from protocols.runfile import Run, translate_read_errors  # a new run reads no file

    with Run(path) as run, translate_read_errors(path):
        _check_measured(path, run)
        protocol = protocol_of_run(run, str(path))
        rest_v = float(run.record.configuration.get("amplifier", {}).get("rest_v", AmplifierMap().rest_v))
        measured = {int(entry): point for entry, point in measured_points(run, protocol.point_type)}
        plan = extend_plan(protocol, protocol.plan(rest_v), measured, rest_v)
        points = _points_of_plan(run, measured, plan)
        stale = len(measured) - len(points)
        if unknown := [i for i in repeat_entries if not 0 <= i < len(plan)]:
            raise RunReadError(
                f"{path} has no point of entry {', '.join(map(str, unknown))}; it has {len(points)} points"
            )
        if repeat_entries and not protocol.repeatable:
            raise RunReadError(
                f"{path.name} is a run of {protocol.title.lower()}: each entry wears the specimen and is counted once; start a new run "
                "with the number of cycles so far"
            )
        if run.record.status is RunStatus.COMPLETED and not repeat_entries and not stale and len(points) == len(plan):
            raise RunReadError(f"{path} is complete: there is nothing to resume")
        note = f"Continues {path.name} ({run.record.state}), {len(points)} points carried over"
        if stale:
            note += f", {stale} dropped: the plan has other entries in their place now"
        check = max(points) if points and not repeat_entries and protocol.repeatable else None
        begun = {i: entry for i, entry in enumerate(plan) if i not in points}
        driven, lost = _interrupted_blocks(run, begun)
        note += "".join(f". {text}" for text in (protocol.uncounted(begun[i]) for i in lost) if text)
        series = run.series() or _recompute_series(run, protocol, plan)
        kept = tuple(one for one in series if one.entry in points)
        carried, repeated = tuple(sorted(points.items())), frozenset(repeat_entries)
        columns = run.points()
        air = {
            int(entry): {name: float(columns[name][row]) for name in AIR_COLUMNS if name in columns}
            for row, entry in enumerate(columns[ENTRY_COLUMN])
        }
        return ResumableRun(path, protocol, run.record, carried, check, repeated, note, kept, driven, air)


def _interrupted_blocks(
    run: "Run", entries: Mapping[int, PlanEntry]
) -> tuple[dict[int, CycleStatistics], tuple[int, ...]]:
    """Return the cycles of the entries that an interruption has counted, and the entries begun after it without a count."""
    driven: dict[int, CycleStatistics] = {}
    uncounted: set[int] = set()
    for event in run.events():
        index = int(event.fields.get("index" if event.kind == EntryStarted.kind else "entry", -1))
        if index not in entries:
            continue
        if event.kind == EntryStarted.kind:
            uncounted.add(index)
        elif event.kind == CyclesInterrupted.kind:
            driven[index] = CycleStatistics.from_record(event.fields["driven"])
            uncounted.discard(index)
    return driven, tuple(sorted(uncounted))


def counted_cycles(folder: Path, specimen: str) -> float:
    """Return the cycles of a specimen by its newest run of endurance in a folder; 0 without one that can be read."""
    from protocols.runfile import Run, safe_name

    paths = sorted(folder.glob(f"*_{safe_name(specimen)}_{ENDURANCE}*.h5"))
    for path in reversed(paths):
        with contextlib.suppress(RunReadError, OSError), Run(path) as run:
            return float(np.max(run.points().get("cycles", [0.0]), initial=0.0))
    return 0.0


def _check_measured(path: Path, run: "Run") -> None:
    if run.record.status is RunStatus.RUNNING and not run.record.crashed:
        raise RunReadError(f"{path} is still being written; stop that run first")
    if run.record.imported:
        raise RunReadError(f"{path} was imported, not measured, and cannot be resumed; start a new run")


def _points_of_plan(run: "Run", points: Mapping[int, Any], plan: Sequence[PlanEntry]) -> dict[int, Any]:
    """Return the points of the plan's entries: refinements depend on points, and may differ after repeats of these."""
    begun = run.entries()
    return {
        i: point for i, point in points.items() if i < len(plan) and (i not in begun or begun[i].key == plan[i].key)
    }


FLAGGED_ENTRIES = "flagged"
"""Name of all entries without a usable point."""


def find_entries(path: Path, entry_names: Sequence[str]) -> tuple[int, ...]:
    """Return the entries of a run by their names: `155`, `2.54 mm`, `2.54 mm, 155 Hz`, or `flagged`.

    A number means all entries with a part of their label that begins with it.

    Raises:
        RunReadError: the file is not a run, or has no such entry; the message lists the entries.
    """
    from protocols.runfile import Run, translate_read_errors  # a new run reads no file

    with Run(path) as run, translate_read_errors(path):
        begun, columns = run.entries(), run.points()
        good = {
            int(entry)
            for entry, quality in zip(
                columns[ENTRY_COLUMN], columns.get("quality", [0] * len(columns[ENTRY_COLUMN])), strict=True
            )
            if Quality(int(quality)).usable
        }
    entries: set[int] = set()
    for entry_name in entry_names:
        if entry_name == FLAGGED_ENTRIES:
            entries |= begun.keys() - good
            continue
        meant = {i for i, entry in begun.items() if _label_matches(entry.label, entry_name)}
        if not meant:
            labels = "; ".join(entry.label for _, entry in sorted(begun.items())) or "none"
            raise RunReadError(f"{path} has no entry '{entry_name}'; it has: {labels}")
        entries |= meant
    if not entries:
        raise RunReadError(f"{path} has no flagged points: there is nothing to measure again")
    return tuple(sorted(entries))


def _label_matches(label: str, text: str) -> bool:
    parts = [part.casefold() for part in (label, *label.split(", "))]
    text = text.strip().casefold()
    if text in parts:
        return True
    try:
        number = float(text)
    except ValueError:
        return False
    for part in parts:
        with contextlib.suppress(ValueError):
            if math.isclose(float(part.split()[0]), number, rel_tol=1e-9, abs_tol=1e-12):
                return True
    return False


def _recompute_series(run: "Run", protocol: "Protocol", plan: Sequence[PlanEntry]) -> tuple[Series, ...]:
    """Recompute the series of an unfinished run from its raw data."""
    from protocols.base import Protocol

    if type(protocol).series is Protocol.series:
        return ()
    latest: dict[int, list[Recording]] = {}
    for recording in run.recordings():
        of_entry = latest.setdefault(recording.entry, [])
        if of_entry and of_entry[-1].index + 1 != recording.index:
            of_entry.clear()  # the entry was measured again later
        of_entry.append(recording)
    recomputed: list[Series] = []
    for entry, recordings in sorted(latest.items()):
        with contextlib.suppress(ValueError):
            recomputed += [replace(one, entry=entry) for one in protocol.series(plan[entry].key, recordings)]
    return tuple(recomputed)


def measured_points(run: "Run", point_type: type) -> Sequence[tuple[int, Any]]:
    """Return points with their entries, in order of measurement; the last point of an entry is valid."""
    columns = run.points()
    entries = columns.pop(ENTRY_COLUMN)
    points = []
    for row, entry in enumerate(entries):
        values: dict[str, Any] = {}
        for column in fields(point_type):
            # A file of an earlier version.
            value = np.asarray(columns[column.name][row] if column.name in columns else math.nan)
            values[column.name] = tuple(value.tolist()) if value.ndim else float(value)
        if "quality" in values:
            values["quality"] = int(values["quality"])
        points.append((int(entry), point_type(**values)))
    return points
