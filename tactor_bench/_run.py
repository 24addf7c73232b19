"""A run file as numpy arrays: points, curves, estimates, samples in SI units, log."""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Generic, TypeVar, cast, overload

import numpy as np

from drivers import Closeable, Drive
from model import Array
from protocols.base import Outcome, Quality, Recording, Verdict
from protocols.runfile import LoggedEvent, Run, RunReadError, RunRecord, RunTrace, translate_read_errors
from tactor_bench._tables import CurveTable, EstimateTable, Points

__all__ = ["MeasuredRun", "Quality", "RunReadError", "Samples", "open_run"]

S = TypeVar("S")
T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples of the card in SI units, converted from its raw counts.

    Attributes:
        time_s: time since the begin of the stream, (N,).
        drive_v: volts at the amplifier's input, (N,).
        displacement_m: displacement of the tactor's centre, measured by the sensor, (N,).
        rate_hz: scans per second.
        quality: flags of the recording; `Quality.GOOD` for a part of the trace.
        drive: the drive of the source, None for a part of the trace.
        entry: entry of the protocol's plan, None for a part of the trace.
        sensor_delay_s: delay of `displacement_m` against `drive_v`.
        channels: further inputs by name in the unit of the bench file, (N,) each, for example `amplifier_voltage`.
    """

    time_s: Array
    drive_v: Array
    displacement_m: Array
    rate_hz: float
    quality: Quality = Quality.GOOD
    drive: Drive | None = None
    entry: int | None = None
    sensor_delay_s: float = 0.0
    channels: Mapping[str, Array] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.time_s.size


class Fact(Generic[S, T]):
    """An attribute read on demand from another one, `source`."""

    source: ClassVar[str]

    def __init__(self, read: Callable[[S], T]) -> None:
        self._read = read

    def __get__(self, owner: object | None, kind: type | None = None) -> T:
        if owner is None:
            return cast(T, self)  # attribute of the class, for documentation
        return self._read(getattr(owner, self.source))


class _Fact(Fact[RunRecord, T]):
    source = "record"


class MeasuredRun(Closeable):
    """A run file, read on demand. The file is closed after every read and needs no closing.

    Data are cached: open a growing run again to read its new data. `with` is possible, and only frees the cached arrays.

    Attributes:
        path: the file.
        record: all facts of the run except points, series, log and samples; the following attributes are some of them.
        protocol: name of the protocol, for example `sine-dwell`.
        title: protocol and specimen as text.
        specimen: name of the specimen.
        status: `completed`, `stopped`, `failed`, `unsafe`, `running`, `crashed` or `imported`.
        reason: kind and reason of the end, in a sentence.
        verdict: outcome, reasons and checks. Runs of earlier versions and imports are not judged.
        simulated: whether it was measured on the simulated bench.
        start_time: begin of the run, with time zone.
        parameters: the protocol's parameters by name, SI.
        configuration: the bench file's tables at the time of the run.
        software: versions of the measuring programs, by name.
        sample_rate_hz: scans per second of the card.
        duration_s: length of the sampled data.
    """

    protocol = _Fact(lambda record: record.protocol)
    title = _Fact(lambda record: record.title)
    specimen = _Fact(lambda record: record.specimen)
    status = _Fact(lambda record: record.state)
    reason = _Fact(lambda record: record.reason)
    verdict = _Fact(lambda record: record.verdict)
    simulated = _Fact(lambda record: record.simulated)
    parameters = _Fact(lambda record: record.parameters)
    configuration = _Fact(lambda record: record.configuration)
    software = _Fact(lambda record: record.software)
    duration_s = _Fact(lambda record: record.duration_s)

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with Run(self.path) as run, translate_read_errors(self.path):
            self.record = run.record
            self.start_time = datetime.fromisoformat(self.record.start_time)
            self.sample_rate_hz, self._recordings = run.trace.rate_hz, run.trace.recording_count

    def __repr__(self) -> str:
        simulated = ", SIMULATED" if self.simulated else ""
        return f"<{self.title}, {self.start_time:%Y-%m-%d %H:%M}, {self._outcome}{simulated}>"

    @property
    def _outcome(self) -> str:
        """The verdict; for a run without one, also its end."""
        outcome = self.verdict.outcome
        return f"{self.status}, {outcome}" if outcome is Outcome.NOT_JUDGED else str(outcome)

    def judge(self, store: bool = False) -> Verdict:
        """Judge the run by its points and the checks of this version; `verdict` is the result afterwards.

        For runs of earlier versions and imported runs, which have no verdict yet. A free tactor is compared with a calibration of
        the specimen in the same folder.

        Args:
            store: whether to store the verdict in `RUN.notes.json` beside the file, in place of an earlier one; the audit
                trail of the folder, if there is one, has an entry of it.

        Raises:
            RunReadError: the run is still being written, is damaged, or of an unknown protocol.
            OSError: the verdict cannot be written.

        Example:
            >>> open_run("old.h5").judge().outcome  # doctest: +SKIP
            <Outcome.GOOD: 'good'>
        """
        from app.common import record_audit
        from app.identification import reference_model
        from protocols import judge_file
        from protocols.runfile import NotesError, notes_path

        try:
            verdict = judge_file(self.path, reference_model(self.path.parent, self.specimen), store)
        except NotesError as error:
            raise OSError(str(error)) from error
        self.record = replace(self.record, verdict=verdict)
        if store:
            record_audit("judge", notes_path(self.path), subject=self.specimen, verdict=str(verdict.outcome))
            self.record = replace(self.record, caution="")
        return verdict

    def close(self) -> None:
        """Free the cached arrays."""
        for name in ("points", "series", "estimates", "log"):
            self.__dict__.pop(name, None)

    @cached_property
    def points(self) -> Points:
        """The points: `run.points["frequency"]` is an array, `run.points.unit("frequency")` its unit."""
        return self._read(lambda run: Points(run.points(), run.units()))

    @cached_property
    def estimates(self) -> EstimateTable:
        """Identified quantities by name: value, standard error and unit."""
        return EstimateTable(self.record.estimates)

    @cached_property
    def series(self) -> tuple[CurveTable, ...]:
        """Curves of entries in addition to their points, for example frequency responses; empty before the end of a run."""
        return self._read(lambda run: tuple(map(CurveTable, run.series())))

    @cached_property
    def log(self) -> tuple[LoggedEvent, ...]:
        """Logged events in order: `time_s` since the begin of the run, `kind`, and `fields` by name."""
        return self._read(lambda run: tuple(run.events()))

    @property
    def traces(self) -> "Traces":
        """The recordings of the points: `run.traces[0].displacement_m`, read one at a time."""
        return Traces(self)

    def trace(self, start_s: float = 0.0, stop_s: float | None = None) -> Samples:
        """Read all samples between two times, in seconds since the begin of the stream; the end is excluded.

        Raises:
            RunReadError: the file is damaged or missing.

        Example:
            >>> samples = open_run("run.h5").trace(0.1, 0.2)  # doctest: +SKIP
            >>> samples.displacement_m.max() - samples.displacement_m.min()  # doctest: +SKIP
            0.00088
        """

        def read(run: Run) -> Samples:
            trace = run.trace
            rows = range(trace.sample_count)
            begin = bisect_left(rows, start_s, key=lambda row: _scanned_s(trace, row))
            end = len(rows) if stop_s is None else bisect_left(rows, stop_s, key=lambda row: _scanned_s(trace, row))
            end = max(begin, end)
            time_s = trace.time_s(begin, end) if end > begin else np.empty(0)
            return Samples(
                time_s,
                trace.drive_v(begin, end),
                trace.displacement_m(begin, end),
                trace.rate_hz,
                channels=_channels(trace, begin, end),
            )

        return self._read(read)

    def _recording(self, index: int) -> Samples:
        def read(run: Run) -> Samples:
            recording: Recording = run.trace.recording(index)
            return Samples(
                run.trace.time_s(*recording.rows),
                recording.drive_v,
                recording.displacement_m,
                recording.rate_hz,
                recording.quality,
                recording.drive,
                recording.entry,
                recording.sensor_delay_s,
                _channels(run.trace, *recording.rows),
            )

        return self._read(read)

    def _read(self, take: Callable[[Run], T]) -> T:
        with Run(self.path) as run, translate_read_errors(self.path):
            return take(run)


class Traces(Sequence[Samples]):
    """The recordings of a run, read from its file one at a time."""

    def __init__(self, run: MeasuredRun) -> None:
        self._run = run

    def __len__(self) -> int:
        return self._run._recordings  # noqa: SLF001 - the other half of this class

    @overload
    def __getitem__(self, index: int) -> Samples: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Samples, ...]: ...

    def __getitem__(self, index: int | slice) -> Samples | tuple[Samples, ...]:
        at = range(len(self))[index]
        return tuple(map(self._run._recording, at)) if isinstance(at, range) else self._run._recording(at)  # noqa: SLF001


def open_run(path: str | Path) -> MeasuredRun:
    """Open a run file: finished, growing or crashed.

    Raises:
        RunReadError: the file is missing, is not a run, is damaged, or comes from a newer version.

    Example:
        >>> run = open_run("run.h5")  # doctest: +SKIP
        >>> run.points["frequency"], run.points.unit("peak_to_peak")  # doctest: +SKIP
        (array([100., 160.]), 'm')
    """
    return MeasuredRun(path)


def _channels(trace: RunTrace, start: int, stop: int) -> dict[str, Array]:
    return {name: trace.channel_values(name, start, stop) for name in trace.further_channels}


def _scanned_s(trace: RunTrace, row: int) -> float:
    return float(trace.time_s(row, row + 1)[0])
