"""Run file reader: a run that is finished, still being written, or left by a crash."""

import math
import socket
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers import Closeable, LaserSensor
from model import AmplifierMap, Array, current_name
from protocols.base import (
    EntryStarted,
    EstimatedQuantity,
    InterferenceMeasured,
    Recording,
    ReferenceModel,
    RunConditions,
    RunStatus,
    Series,
    Verdict,
    parse_json_object,
    visible_text,
)
from protocols.base.events import INTERFERENCE_AT_REST
from protocols.runfile.fields import (
    ROWS_PER_READ,
    attribute_integer,
    attribute_text,
    column,
    quantity_columns,
    read_integer,
    read_number,
    read_object,
    read_raw_text,
    read_text,
    subgroup,
    table,
)
from protocols.runfile.open import (
    NewerFormatError,
    NotARunError,
    RunReadError,
    open_run,
    reads_run,
    translate_read_errors,
)
from protocols.runfile.presence import writer_is_alive
from protocols.runfile.schema import CONTINUED_EVENT, ENTRY_COLUMN, EVENT_DTYPE, REPAIRED, VERDICT_VERSION
from protocols.runfile.series import SERIES_GROUP, read_series
from protocols.runfile.structure import StructureError, is_run_beside
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


MAX_EARLIER_RUNS = 1000
"""Runs that one run continues, one after the other."""


@reads_run
class Run(Closeable):
    """An open run file, read-only.

    Raises:
        RunReadError: the file is missing, is not a run, is damaged or hostile, or comes from a newer version of this
            program. Every property and method raises it where the damage is met only then.
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

    @property
    def status(self) -> RunStatus:
        """Status as stored in the file."""
        return RunStatus(self._text("status"))

    @property
    def crashed(self) -> bool:
        """Whether the status is `running` but the writing process is gone (known on the same computer, or once repaired)."""
        if self.status is not RunStatus.RUNNING:
            return False
        if REPAIRED in self._entry:
            return True
        if self._text("host") != socket.gethostname():
            return False
        return not writer_is_alive(self.path, read_integer(self._entry, "process_id"))

    @property
    def state(self) -> str:
        """The status as text, including `crashed`; `imported` for an imported run."""
        if self.imported and self.status is RunStatus.COMPLETED:
            return "imported"
        return "crashed" if self.crashed else str(self.status)

    @property
    def imported(self) -> dict[str, Any]:
        """Source files, hashes and columns of an imported run; empty for a measured one."""
        return read_object(self._entry, "imported") if "imported" in self._entry else {}

    @property
    def reason(self) -> str:
        """How and why it ended; empty until then."""
        return self._text("reason")

    @property
    def verdict(self) -> Verdict:
        """Verdict on the run; not judged if it is of an earlier version, imported, or has not ended.

        Raises:
            RunReadError: the stored verdict is damaged.
        """
        if "verdict_details" not in self._entry:
            if attribute_integer(self._file, "format_version") >= VERDICT_VERSION and self.status not in (
                RunStatus.RUNNING,
                RunStatus.COMPLETED,
            ):
                return Verdict.of_status(self.status, self.reason)
            return Verdict()
        verdict = Verdict.from_record(read_object(self._entry, "verdict_details"))
        verdict.describe("".join(check.text for check in verdict.failed_checks))  # raises for values of a wrong type
        return verdict

    @property
    def reference(self) -> ReferenceModel | None:
        """Model of the free specimen that the verdict compares with; None in runs of earlier versions and imports.

        Raises:
            RunReadError: the stored model is damaged.
        """
        if "reference" not in self._entry:
            return None
        with translate_read_errors(self.path):
            return ReferenceModel.from_record(parse_json_object(self._text("reference")))

    @property
    def resumed_from(self) -> Path | None:
        """The run that this one resumed."""
        earlier = read_raw_text(self._entry, "continues") if "continues" in self._entry else ""
        if earlier and not is_run_beside(earlier):
            raise StructureError(f"it continues '{visible_text(earlier)}'")
        return self.path.parent / earlier if earlier else None

    def earlier_runs(self) -> list[Path]:
        """Return the runs that this one continues, the oldest first, as far back as their files are there."""
        found: list[Path] = []
        known = {self.path.resolve()}
        earlier = self.resumed_from
        while earlier is not None and earlier.exists():
            if earlier.resolve() in known or len(found) == MAX_EARLIER_RUNS:
                raise StructureError(f"it continues {earlier.name}, which continues this run in its turn")
            known.add(earlier.resolve())
            found.append(earlier)
            with Run(earlier) as before:
                earlier = before.resumed_from
        return found[::-1]

    @property
    def protocol(self) -> str:
        """Name of the protocol."""
        return self._text("protocol")

    @property
    def specimen(self) -> str:
        """Name of the specimen."""
        return self._text("specimen")

    @property
    def title(self) -> str:
        """Title: protocol and specimen."""
        return self._text("title")

    @property
    def start_time(self) -> str:
        """Start time, ISO 8601, UTC."""
        return self._text("start_time")

    @property
    def parameters(self) -> dict[str, Any]:
        """The protocol's parameters by name, SI."""
        return read_object(self._entry, "parameters")

    @property
    def requested(self) -> dict[str, Any]:
        """The requested values of the parameters that were adapted to the source; empty if none was."""
        return read_object(self._entry, "requested") if "requested" in self._entry else {}

    @property
    def configuration(self) -> dict[str, Any]:
        """The bench file's tables at the time of the run."""
        return read_object(self._entry, "configuration")

    @property
    def bench_name(self) -> str:
        """Name of the bench; empty in an imported run."""
        return str(self.configuration.get("name", ""))

    @property
    def identities(self) -> dict[str, Any]:
        """Identities of the instruments with serial numbers, by role; empty in an imported run."""
        return dict(self.configuration.get("identities", {}))

    @property
    def amplifier_map(self) -> AmplifierMap:
        """The amplifier's static map as it was then."""
        table = self.configuration.get("amplifier", {})
        return AmplifierMap(**{f.name: float(table[f.name]) for f in fields(AmplifierMap) if f.name in table})

    @property
    def software(self) -> dict[str, str]:
        """Versions of the software that computed the results, by name."""
        return read_object(self._entry, "software")

    @property
    def simulated(self) -> bool:
        """Whether the bench was simulated."""
        return bool(read_integer(self._entry, "simulated"))

    @property
    def sensor(self) -> LaserSensor:
        """The displacement sensor with its calibration."""
        return read_sensor(self._entry)

    @property
    def conditions(self) -> RunConditions:
        """Who measured, and the state of the air; empty in runs of earlier versions."""
        entry = self._entry
        user = subgroup(entry, "operator") if "operator" in entry else None
        air = subgroup(entry, "instrument") if "instrument" in entry else {}
        temperature_c, humidity = (
            read_number(subgroup(air, name), "value") if name in air else None
            for name in ("air_temperature", "air_humidity")
        )
        return RunConditions(
            "" if user is None else read_text(user, "name"),
            "" if user is None else read_text(user, "origin"),
            temperature_c,
            humidity,
            self._text("air_origin") if "air_origin" in entry else "",
        )

    @property
    def trace(self) -> RunTrace:
        """The sampled data."""
        return self._trace

    @cached_property
    def _trace(self) -> RunTrace:
        return RunTrace(self.path, self._entry, lambda: self.sensor, self._rest_record)

    def recordings(self) -> Iterator[Recording]:
        """Yield the recordings, in order, exactly as in the live run; those of the resumed run first."""
        for earlier in self.earlier_runs():
            with Run(earlier) as before:
                yield from before.trace.recordings()
        yield from self.trace.recordings()

    def points(self) -> dict[str, Array]:
        """Return the points' columns by name, of equal length; `entry` is the plan entry each belongs to."""
        datasets = quantity_columns(subgroup(self._entry, "points"))
        length = min((data.shape[0] for data in datasets.values()), default=0)
        columns = {name: np.asarray(data[:length]) for name, data in datasets.items()}
        columns.setdefault(ENTRY_COLUMN, np.arange(length))  # format 1: in order
        return columns

    @property
    def point_count(self) -> int:
        """Number of points, without reading them."""
        return next((int(column.shape[0]) for column in quantity_columns(subgroup(self._entry, "points")).values()), 0)

    @property
    def entry_count(self) -> int:
        """How many entries of the plan have a point."""
        points = subgroup(self._entry, "points")
        if ENTRY_COLUMN not in points:
            return self.point_count
        return len(set(column(points, ENTRY_COLUMN)[: self.point_count].tolist()))

    @property
    def axes(self) -> tuple[str, str]:
        """The columns that are plotted: x and y."""
        group = subgroup(self._entry, "points")
        return attribute_text(group, "axes"), attribute_text(group, "signal")

    def units(self) -> dict[str, str]:
        """Return the units of the points' columns."""
        columns = quantity_columns(subgroup(self._entry, "points"))
        return {name: attribute_text(data, "units") for name, data in columns.items()}

    def events(self) -> Iterator[LoggedEvent]:
        """Yield the logged events, in order."""
        events = table(self._entry, "events", EVENT_DTYPE.names or ())
        first: Any = None
        texts: list[bytes] = []
        for start in range(0, len(events), ROWS_PER_READ):
            for row in events[start : start + ROWS_PER_READ]:
                if row["kind"] != CONTINUED_EVENT:
                    if first is not None:
                        yield _event(first, texts)
                    first, texts = row, []
                first = row if first is None else first
                texts.append(row["text"])
        if first is not None:
            yield _event(first, texts)

    def entries(self) -> dict[int, StartedEntry]:
        """Return the started entries by their index in the plan, including those of the resumed run."""
        found: dict[int, StartedEntry] = {}
        for earlier in self.earlier_runs():
            with Run(earlier) as before:
                found |= before._own_entries()
        return found | self._own_entries()

    def series(self) -> tuple[Series, ...]:
        """Return the series of the entries; none in a run that was never finished."""
        every = subgroup(self._entry, SERIES_GROUP) if SERIES_GROUP in self._entry else {}
        return tuple(series for name in every for series in read_series(subgroup(every, name)))

    def estimates(self) -> tuple[EstimatedQuantity, ...]:
        """Return the quantities in their stored order; in files without one by their names, interference last."""
        estimates = subgroup(self._entry, "estimates") if "estimates" in self._entry else {}
        found = (
            EstimatedQuantity(
                visible_text(current_name(name)),
                read_number(one, "value"),
                read_number(one, "standard_error"),
                attribute_text(one["value"], "units"),
                read_text(one, "source"),
            )
            for name in estimates
            for one in (subgroup(estimates, name),)
        )
        return tuple(sorted(found, key=lambda estimate: estimate.name == INTERFERENCE_AT_REST))

    def _rest_record(self) -> RestRecord | None:
        """Return where interference was measured at rest; None where it was not."""
        found = None
        for event in self.events():
            if event.kind == InterferenceMeasured.kind:
                first, last = event.fields["rows"]
                folded = {
                    float(line["frequency_hz"]): float(true_hz)
                    for line in event.fields["lines"]
                    if isinstance(line, dict)
                    and isinstance(true_hz := line.get("folded_from_hz"), float)
                    and math.isfinite(true_hz)
                }
                found = RestRecord((int(first), int(last)), folded)  # again after the run, where lines are folded
        return found

    def _own_entries(self) -> dict[int, StartedEntry]:
        return {
            int(event.fields["index"]): StartedEntry(
                visible_text(str(event.fields["label"])), tuple(event.fields["key"])
            )
            for event in self.events()
            if event.kind == EntryStarted.kind
        }

    @property
    def _entry(self) -> "h5py.Group":
        return subgroup(self._file, "entry")

    def _text(self, name: str) -> str:
        return read_text(self._entry, name)


def _event(row: Any, texts: list[bytes]) -> LoggedEvent:
    fields = parse_json_object(b"".join(texts).decode())
    return LoggedEvent(float(row["time_s"]), int(row["row"]), visible_text(row["kind"].decode()), fields)
