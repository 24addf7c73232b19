"""Run file reader: a finished, growing or crashed run."""

import math
import socket
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers import Closeable
from model import Array, current_column, current_name
from protocols.base import (
    INTERFERENCE_AT_REST,
    MOUNTING_ACTIONS,
    EntryStarted,
    EstimatedQuantity,
    InterferenceMeasured,
    PromptAnswered,
    PromptShown,
    Recording,
    RunConditions,
    RunStatus,
    Series,
    SpecimenMounted,
    Verdict,
    last_mountings,
    parse_json_object,
    usable_mask,
    visible_text,
)
from protocols.runfile.errors import NewerFormatError, NotARunError, NotesError, RunReadError
from protocols.runfile.fields import (
    ROWS_PER_READ,
    attribute_integer,
    attribute_text,
    quantity_columns,
    read_integer,
    read_number,
    read_object,
    read_raw_text,
    read_text,
    subgroup,
    table,
)
from protocols.runfile.foreign_file_check import StructureError, is_run_beside
from protocols.runfile.mountings import read_mounting_state
from protocols.runfile.names import notes_path
from protocols.runfile.open import open_run, reads_run, translate_read_errors
from protocols.runfile.presence import writer_is_alive
from protocols.runfile.record import LargestPoint, RunRecord, current_parameters
from protocols.runfile.schema import AIR_COLUMNS, CONTINUED_EVENT, ENTRY_COLUMN, EVENT_DTYPE, REPAIRED, VERDICT_VERSION
from protocols.runfile.series import SERIES_GROUP, read_series
from protocols.runfile.sidecar import read_notes, with_later_verdict
from protocols.runfile.trace import RestRecord, RunTrace, read_sensor

if TYPE_CHECKING:
    import h5py

__all__ = ["LoggedEvent", "NewerFormatError", "NotARunError", "Run", "RunReadError", "translate_read_errors"]


@dataclass(frozen=True, slots=True)
class LoggedEvent:
    """One event as stored in the file."""

    time_s: float
    row: int
    kind: str
    fields: dict[str, Any]


@dataclass(frozen=True, slots=True)
class StartedEntry:
    """A started entry of the plan."""

    label: str
    key: tuple[float | str, ...]


LARGEST_POINT_COLUMNS = ("frequency", "peak_to_peak", "peak_to_peak_errors", "drive_amplitude", "quality")
"""Columns of points with the largest response."""

MAX_EARLIER_RUNS = 1000
"""Largest number of runs that a run continues in succession."""


@reads_run
class Run(Closeable):
    """An open run file, read-only.

    Raises:
        RunReadError: the file is missing, is not a run, is damaged or hostile, or comes from a newer version of this program.
            Every property and method raises it for damage detected later.
    """

    def __init__(self, path: Path, file: "h5py.File | None" = None) -> None:
        """Open a run.

        Args:
            path: the run file.
            file: the same file, already open.
        """
        self.path = path
        self._file = open_run(path) if file is None else file

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @cached_property
    def record(self) -> RunRecord:
        """All facts of the run, at the time of the first access.

        A verdict stored after the end replaces the verdict, unless the file has changed since: then `caution` has a text.
        """
        record = self.stored_record()
        try:
            return with_later_verdict(record, self.path, read_notes(notes_path(self.path)))
        except NotesError as error:
            return replace(record, caution=str(error))

    @cached_property
    def setup(self) -> RunRecord:
        """The record without results: specimen, conditions, mountings, bench and parameters, read in half the time of all facts."""
        return self.stored_setup()

    @cached_property
    def bench_record(self) -> RunRecord:
        """A record of the bench's configuration alone, which is read in a tenth of the time of all facts."""
        return RunRecord(
            simulated=bool(read_integer(self._entry, "simulated")),
            configuration=read_object(self._entry, "configuration"),
        )

    @property
    def resumed_from(self) -> Path | None:
        """The run that this run resumes."""
        earlier = read_raw_text(self._entry, "continues") if "continues" in self._entry else ""
        if earlier and not is_run_beside(earlier):
            raise StructureError(f"it continues '{visible_text(earlier)}'")
        return self.path.parent / earlier if earlier else None

    def earlier_runs(self) -> list[Path]:
        """Return the runs that this run continues, the oldest first, as far back as their files exist."""
        runs: list[Path] = []
        visited = {self.path.resolve()}
        earlier = self.resumed_from
        while earlier is not None and earlier.exists():
            if earlier.resolve() in visited or len(runs) == MAX_EARLIER_RUNS:
                raise StructureError(f"it continues {earlier.name}, which continues this run in its turn")
            visited.add(earlier.resolve())
            runs.append(earlier)
            with Run(earlier) as before:
                earlier = before.resumed_from
        return runs[::-1]

    @cached_property
    def trace(self) -> RunTrace:
        """The sampled data."""
        return RunTrace(
            self.path, self._entry, lambda: self.setup.sensor, self._rest_record, lambda: self.setup.configuration
        )

    def recordings(self) -> Iterator[Recording]:
        """Yield the recordings, in order, exactly as in the live run; recordings of the resumed run first."""
        for earlier in self.earlier_runs():
            with Run(earlier) as before:
                yield from before.trace.recordings()
        yield from self.trace.recordings()

    def points(self) -> dict[str, Array]:
        """Return the points' columns by name, of equal length; `entry` is the plan entry of each point."""
        return self._stored_points()

    @cached_property
    def mountings(self) -> tuple[SpecimenMounted, ...]:
        """The last mounting of each part before the first entry; in files of earlier versions, by the answered prompts."""
        if "mountings" in self._entry:
            return self.setup.mountings
        found, prompt = [], {}
        for event in self.events():
            if event.kind == EntryStarted.kind:
                break
            if event.kind == PromptShown.kind:
                prompt = dict(event.fields["prompt"])
            elif event.kind == PromptAnswered.kind and (part := MOUNTING_ACTIONS.get(str(prompt.get("action")))):
                found.append(SpecimenMounted(part, self.setup.start_time))
        return last_mountings(found)

    def _stored_points(self) -> dict[str, Array]:
        datasets = self._point_columns
        length = min((data.shape[0] for data in datasets.values()), default=0)
        columns = {name: np.asarray(data[:length]) for name, data in datasets.items()}
        columns.setdefault(ENTRY_COLUMN, np.arange(length))  # format 1: entries in order
        return columns

    def units(self) -> dict[str, str]:
        """Return the units of the points' columns."""
        return {name: attribute_text(data, "units") for name, data in self._point_columns.items()}

    @cached_property
    def _point_columns(self) -> "dict[str, h5py.Dataset]":
        columns = quantity_columns(subgroup(self._entry, "points"))
        return {current_column(name, columns): data for name, data in columns.items()}

    def events(self, *kinds: str) -> Iterator[LoggedEvent]:
        """Yield the logged events of these kinds, or all, in order."""
        events, wanted = table(self._entry, "events", EVENT_DTYPE.names or ()), {kind.encode() for kind in kinds}

        def is_wanted(row: Any) -> bool:
            return row is not None and (not wanted or row["kind"] in wanted)

        first: Any = None
        texts: list[bytes] = []
        for start in range(0, len(events), ROWS_PER_READ):
            for row in events[start : start + ROWS_PER_READ]:
                if row["kind"] != CONTINUED_EVENT:
                    if is_wanted(first):
                        yield _event(first, texts)
                    first, texts = row, []
                first = row if first is None else first
                texts.append(row["text"])
        if is_wanted(first):
            yield _event(first, texts)

    def entries(self) -> dict[int, StartedEntry]:
        """Return the started entries by their index in the plan, including those of the resumed run."""
        entries: dict[int, StartedEntry] = {}
        for earlier in self.earlier_runs():
            with Run(earlier) as before:
                entries |= before._own_entries()
        return entries | self._own_entries()

    def series(self) -> tuple[Series, ...]:
        """Return the series of the entries; none in an unfinished run."""
        every = subgroup(self._entry, SERIES_GROUP) if SERIES_GROUP in self._entry else {}
        return tuple(series for name in every for series in read_series(subgroup(every, name)))

    def stored_setup(self) -> RunRecord:
        """Return the record of the file without results.

        Raises:
            RunReadError: a field is damaged.
        """
        entry = self._entry
        return RunRecord(
            protocol=self._text("protocol"),
            title=self._text("title"),
            specimen=self._text("specimen"),
            start_time=self._text("start_time"),
            simulated=self.bench_record.simulated,
            parameters=current_parameters(read_object(entry, "parameters")),
            imported=read_object(entry, "imported") if "imported" in entry else {},
            continues=self._text("continues") if "continues" in entry else "",
            conditions=_with_measured_air(_read_conditions(entry), _read_estimates(entry, AIR_COLUMNS)),
            mountings=read_mounting_state(entry),
            configuration=self.bench_record.configuration,
            sensor=read_sensor(entry),
        )

    def stored_record(self) -> RunRecord:
        """Return the record of the file.

        Raises:
            RunReadError: a field is damaged.
        """
        entry, points = self._entry, self._stored_points()
        plotted = subgroup(entry, "points")
        status, reason = RunStatus(self._text("status")), self._text("reason")
        return replace(
            self.setup,
            requested=read_object(entry, "requested") if "requested" in entry else {},
            reference=read_object(entry, "reference") if "reference" in entry else {},
            software=read_object(entry, "software"),
            axes=(attribute_text(plotted, "axes"), current_column(attribute_text(plotted, "signal"), plotted)),
            default_plot=_default_plot(entry),
            status=status,
            crashed=status is RunStatus.RUNNING and self._is_abandoned(),
            reason=reason,
            verdict=self._read_verdict(status, reason),
            estimates=_read_estimates(entry),
            series=_series_names(entry),
            point_count=len(points[ENTRY_COLUMN]),
            entry_count=len(set(points[ENTRY_COLUMN].tolist())),
            duration_s=self.trace.duration_s,
            largest=_largest_point(points),
        )

    def _is_abandoned(self) -> bool:
        """Whether the writing process of the file has ended."""
        if REPAIRED in self._entry:
            return True
        own = self._text("host") == socket.gethostname()
        return own and not writer_is_alive(self.path, read_integer(self._entry, "process_id"))

    def _read_verdict(self, status: RunStatus, reason: str) -> Verdict:
        if "verdict_details" not in self._entry:
            judged = attribute_integer(self._file, "format_version") >= VERDICT_VERSION
            ended_early = judged and status not in (RunStatus.RUNNING, RunStatus.COMPLETED)
            return Verdict.of_status(status, reason) if ended_early else Verdict()
        verdict = Verdict.from_record(read_object(self._entry, "verdict_details"))
        verdict.describe("".join(check.text for check in verdict.failed_checks))  # raises for a wrong type
        return verdict

    def _rest_record(self) -> RestRecord | None:
        """Return the record of interference at rest; None if not measured."""
        record = None
        for event in self.events(InterferenceMeasured.kind):
            first, last = event.fields["rows"]
            folded = {
                float(line["frequency_hz"]): float(true_hz)
                for line in event.fields["lines"]
                if isinstance(line, dict)
                and isinstance(true_hz := line.get("folded_from_hz"), float)
                and math.isfinite(true_hz)
            }
            # Measured again after the run, if lines are folded.
            record = RestRecord((int(first), int(last)), folded)
        return record

    def _own_entries(self) -> dict[int, StartedEntry]:
        started = (event.fields for event in self.events(EntryStarted.kind))
        return {
            int(each["index"]): StartedEntry(visible_text(str(each["label"])), tuple(each["key"])) for each in started
        }

    @cached_property
    def _entry(self) -> "h5py.Group":
        return subgroup(self._file, "entry")

    def _text(self, name: str) -> str:
        return read_text(self._entry, name)


def _read_conditions(entry: "h5py.Group") -> RunConditions:
    # A newer version may use the name for another object.
    user = subgroup(entry, "operator") if hasattr(entry.get("operator"), "keys") else None
    air = subgroup(entry, "instrument") if "instrument" in entry else {}
    temperature_c, humidity = (
        read_number(subgroup(air, name), "value") if name in air else None for name in AIR_COLUMNS
    )
    return RunConditions(
        "" if user is None else read_text(user, "name"),
        "" if user is None else read_text(user, "origin"),
        temperature_c,
        humidity,
        read_text(entry, "air_origin") if "air_origin" in entry else "",
    )


def _with_measured_air(conditions: RunConditions, estimates: tuple[EstimatedQuantity, ...]) -> RunConditions:
    """Return the conditions with the air that sensors at the card measured through the run."""
    seen = {each.name: each for each in estimates if each.name in AIR_COLUMNS}
    if not seen:
        return conditions
    temperature, humidity = seen.get("air_temperature"), seen.get("air_humidity")
    return replace(
        conditions,
        temperature_c=conditions.temperature_c if temperature is None else temperature.value,
        humidity=conditions.humidity if humidity is None else humidity.value,
        origin="; ".join(str(each.source) for each in seen.values()),
    )


def _read_estimates(entry: "h5py.Group", only: Collection[str] = ()) -> tuple[EstimatedQuantity, ...]:
    """Return the quantities, or `only` some, in their stored order; without a stored order by their names, interference last."""
    stored = subgroup(entry, "estimates") if "estimates" in entry else {}
    estimates = (
        EstimatedQuantity(
            label,
            read_number(one, "value"),
            read_number(one, "standard_error"),
            attribute_text(one["value"], "units"),
            read_text(one, "source"),
        )
        for name in stored
        for one in (subgroup(stored, name),)
        for label in (attribute_text(one, "name") if "name" in one.attrs else visible_text(current_name(name)),)
        if not only or label in only
    )
    return tuple(sorted(estimates, key=lambda estimate: estimate.name == INTERFERENCE_AT_REST))


def _series_names(entry: "h5py.Group") -> tuple[str, ...]:
    every = subgroup(entry, SERIES_GROUP) if SERIES_GROUP in entry else {}
    return tuple(dict.fromkeys(attribute_text(subgroup(every, name), "name") for name in every))


def _default_plot(entry: "h5py.Group") -> str:
    if SERIES_GROUP not in entry or "default" not in (every := subgroup(entry, SERIES_GROUP)).attrs:
        return ""
    return attribute_text(subgroup(every, attribute_text(every, "default")), "name")


def _largest_point(points: Mapping[str, Array]) -> LargestPoint | None:
    if not all(name in points for name in LARGEST_POINT_COLUMNS):
        return None
    f, y, errors, drive, quality = (np.asarray(points[name], float) for name in LARGEST_POINT_COLUMNS)
    good = usable_mask(quality) & np.isfinite(y) & np.isfinite(errors) & (f > 0) & (drive > 0)
    if not good.any():
        return None
    top = int(np.flatnonzero(good)[y[good].argmax()])
    drives = np.sort(drive[good])  # np.median imports numpy.ma
    median = (drives[(drives.size - 1) // 2] + drives[drives.size // 2]) / 2
    return LargestPoint(float(f[top]), float(y[top]), float(errors[top]), float(median))


def _event(row: Any, texts: list[bytes]) -> LoggedEvent:
    fields = parse_json_object(b"".join(texts).decode())
    return LoggedEvent(float(row["time_s"]), int(row["row"]), visible_text(row["kind"].decode()), fields)
