"""Run file reader: a run that is finished, still being written, or left behind by a crash."""

import json
import os
import socket
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers import Closeable, LaserSensor
from model import AmplifierMap, Array
from protocols.base import CurveColumn, EntryStarted, EstimatedQuantity, Recording, ResultCurve, RunStatus, Verdict
from protocols.runfile.open import NewerFormatError, NotARunError, RunReadError, open_run, translate_read_errors
from protocols.runfile.schema import ENTRY_COLUMN, FORMAT, FORMAT_VERSION, VERDICT_VERSION
from protocols.runfile.trace import RunTrace, read_sensor

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


class Run(Closeable):
    """An open run file, read-only.

    Raises:
        RunReadError: the file is missing, is no run, or comes from a newer version of this program.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = open_run(path)
        try:
            with translate_read_errors(path):
                kind, version = self._file.attrs.get("format"), int(self._file.attrs.get("format_version", 0))
        except RunReadError:
            self.close()
            raise
        if kind != FORMAT or version > FORMAT_VERSION:
            self.close()
            if kind != FORMAT:
                raise NotARunError(f"{path} is an HDF5 file, but not a run of this program")
            raise NewerFormatError(
                f"{path} has run format {version}; this program reads up to {FORMAT_VERSION}: install a newer version"
            )

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def status(self) -> RunStatus:
        """Status as stored in the file."""
        return RunStatus(self._text("status"))

    @property
    def crashed(self) -> bool:
        """Whether the status is `running` but the writing process is gone (known on the same computer only)."""
        if self.status is not RunStatus.RUNNING or self._text("host") != socket.gethostname():
            return False
        return not _process_is_alive(int(self._entry["process_id"][()]))

    @property
    def state(self) -> str:
        """The status as text, including `crashed`; `imported` for an imported run."""
        if self.imported and self.status is RunStatus.COMPLETED:
            return "imported"
        return "crashed" if self.crashed else str(self.status)

    @property
    def imported(self) -> dict[str, Any]:
        """Source files, hashes and columns of an imported run; empty for a measured one."""
        return dict(json.loads(self._text("imported"))) if "imported" in self._entry else {}

    @property
    def reason(self) -> str:
        """How and why it ended; empty until then."""
        return self._text("reason")

    @property
    def verdict(self) -> Verdict:
        """What the run is worth; not judged if it is of an earlier version, imported, or has not ended.

        Raises:
            RunReadError: the stored verdict is damaged.
        """
        if "verdict_details" not in self._entry:
            if self._file.attrs["format_version"] >= VERDICT_VERSION and self.status not in (
                RunStatus.RUNNING,
                RunStatus.COMPLETED,
            ):
                return Verdict.of_status(self.status, self.reason)
            return Verdict()
        with translate_read_errors(self.path):
            return Verdict.from_record(json.loads(self._text("verdict_details")))

    @property
    def resumed_from(self) -> Path | None:
        """The run that this one resumed."""
        earlier = self._text("continues") if "continues" in self._entry else ""
        return self.path.parent / earlier if earlier else None

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
        return dict(json.loads(self._text("parameters")))

    @property
    def configuration(self) -> dict[str, Any]:
        """The bench file's tables at the time of the run."""
        return dict(json.loads(self._text("configuration")))

    @property
    def amplifier_map(self) -> AmplifierMap:
        """The amplifier's static map as it was then."""
        table = self.configuration.get("amplifier", {})
        return AmplifierMap(**{f.name: float(table[f.name]) for f in fields(AmplifierMap) if f.name in table})

    @property
    def software(self) -> dict[str, str]:
        """Versions of the software that computed the results, by name."""
        return dict(json.loads(self._text("software")))

    @property
    def simulated(self) -> bool:
        """Whether the bench was simulated."""
        return bool(self._entry["simulated"][()])

    @property
    def sensor(self) -> LaserSensor:
        """The displacement sensor with its calibration."""
        return read_sensor(self._entry)

    @property
    def trace(self) -> RunTrace:
        """The sampled data."""
        return RunTrace(self._entry, lambda: self.sensor)

    def recordings(self) -> Iterator[Recording]:
        """Yield the recordings, in order, exactly as in the live run; those of the resumed run first."""
        if (earlier := self.resumed_from) is not None and earlier.exists():
            with Run(earlier) as before:
                yield from before.recordings()
        yield from self.trace.recordings()

    def points(self) -> dict[str, Array]:
        """Return the points' columns by name, of equal length; `entry` is the plan entry each belongs to."""
        datasets = _columns(self._entry["points"])
        length = min((data.shape[0] for data in datasets.values()), default=0)
        columns = {name: np.asarray(data[:length]) for name, data in datasets.items()}
        columns.setdefault(ENTRY_COLUMN, np.arange(length))  # format 1: in order
        return columns

    @property
    def point_count(self) -> int:
        """Number of points, without reading them."""
        return next((int(column.shape[0]) for column in _columns(self._entry["points"]).values()), 0)

    @property
    def entry_count(self) -> int:
        """How many entries of the plan have a point."""
        entries = self._entry["points"].get(ENTRY_COLUMN)
        return self.point_count if entries is None else len(set(entries[: self.point_count].tolist()))

    @property
    def axes(self) -> tuple[str, str]:
        """The columns that are plotted: x and y."""
        group = self._entry["points"]
        return str(group.attrs["axes"][0]), str(group.attrs["signal"])

    def units(self) -> dict[str, str]:
        """Return the units of the points' columns."""
        return {name: str(data.attrs["units"]) for name, data in _columns(self._entry["points"]).items()}

    def events(self) -> Iterator[LoggedEvent]:
        """Yield the logged events, in order."""
        texts: list[tuple[Any, bytes]] = []
        for row in self._entry["events"][:]:
            first, text = texts.pop() if texts and row["kind"] == b"+" else (row, b"")
            texts.append((first, text + row["text"]))
        for row, text in texts:
            event = json.loads(text.decode())
            yield LoggedEvent(float(row["time_s"]), int(row["row"]), row["kind"].decode(), dict(event))

    def entries(self) -> dict[int, StartedEntry]:
        """Return the started entries by their index in the plan, including those of the resumed run."""
        found: dict[int, StartedEntry] = {}
        if (earlier := self.resumed_from) is not None and earlier.exists():
            with Run(earlier) as before:
                found = before.entries()
        for event in self.events():
            if event.kind == EntryStarted.kind:
                found[event.fields["index"]] = StartedEntry(event.fields["label"], tuple(event.fields["key"]))
        return found

    def curves(self) -> tuple[ResultCurve, ...]:
        """Return the result curves; none in a run that was never finished."""
        return tuple(
            ResultCurve(
                name=str(group.attrs["name"]),
                label=str(group.attrs["label"]),
                x=str(group.attrs["axes"][0]),
                y=str(group.attrs["signal"]),
                columns={
                    name: CurveColumn(
                        np.asarray(data[:], float),
                        str(data.attrs["units"]),
                        str(data.attrs["long_name"]).rpartition(" (")[0],
                    )
                    for name, data in _columns(group).items()
                },
                entry=int(group.attrs["entry"]),
            )
            for group in self._entry.get("curves", {}).values()
        )

    def estimates(self) -> tuple[EstimatedQuantity, ...]:
        group = self._entry.get("estimates", {})
        return tuple(
            EstimatedQuantity(
                name.replace("_", " "),
                float(one["value"][()]),
                float(one["standard_error"][()]),
                str(one["value"].attrs["units"]),
                one["source"].asstr()[()],
            )
            for name, one in group.items()
        )

    @property
    def _entry(self) -> "h5py.Group":
        return self._file["entry"]

    def _text(self, name: str) -> str:
        value = self._entry[name][()]
        return value.decode() if isinstance(value, bytes) else str(value)


def _columns(group: "h5py.Group") -> "dict[str, h5py.Dataset]":
    """Return the columns of a table: its datasets with units. Anything else in the group is ignored."""
    return {name: data for name, data in group.items() if "units" in data.attrs}


def _process_is_alive(pid: int) -> bool:
    if os.name == "nt":  # no harmless signal there: a stale number is then taken for a living program
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
