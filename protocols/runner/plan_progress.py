"""Plan progress: planned, measured and remaining entries of a run, and their points."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from protocols.base import (
    ALL_MEASURED,
    LevelExceeded,
    PlanEntry,
    PointMeasured,
    ProgressUpdated,
    Protocol,
    Quality,
    Repeat,
    Series,
    extend_plan,
    point_quality,
)
from protocols.runfile import RunFileWriter


class PlanProgress:
    """Plan, queue and points of one run; a repeated entry supersedes its earlier point.

    Args:
        rest_v: rest level at the amplifier's input, on which plans depend.

    Attributes:
        plan: the entries so far.
        measured: row in the file and point, by entry.
    """

    def __init__(self, protocol: Protocol, run_file: RunFileWriter, rest_v: float) -> None:
        self._protocol, self._run_file, self._rest_v = protocol, run_file, rest_v
        self.plan: list[PlanEntry] = []
        self._queue: list[int] = []
        self.measured: dict[int, tuple[int, Any]] = {}
        self._series: dict[int, list[Series]] = {}
        self._failed_labels: list[str] = []
        """Labels of the entries without a point."""
        self._limits: set[str] = set()
        self.warnings: tuple[str, ...] = ()
        """The reported warnings of the protocol."""

    @property
    def points(self) -> list[Any]:
        """The valid points, in the order of the plan."""
        return [self.measured[i][1] for i in sorted(self.measured)]

    @property
    def series(self) -> list[Series]:
        """The series of the entries, in the order of the plan."""
        return [one for i in sorted(self._series) for one in self._series[i]]

    # -- plan and queue ------------------------------------------------------------------------------------------------

    def build_plan(self) -> None:
        """Build the part of the plan that is fixed in advance."""
        self.plan = list(self._protocol.plan(self._rest_v))

    def queue_remaining(self, repeat_entries: Collection[int]) -> None:
        """Queue all entries without a point, and `repeat_entries`."""
        self._extend_plan()
        self._queue = [i for i in range(len(self.plan)) if i not in self.measured or i in repeat_entries]

    def next_entry(self) -> int | None:
        """Return the next entry to measure; None if nothing is left."""
        return self._queue.pop(0) if self._queue else None

    def complete(self, index: int, repeat: Repeat | None) -> None:
        """Complete an entry; queue a repeat of the previous entry, or the refinements that follow from the points."""
        if repeat is Repeat.PREVIOUS and index > 0:
            self._queue[:0] = [index - 1, index]
        if not self._queue:
            planned = len(self.plan)
            self._extend_plan()
            self._queue = list(range(planned, len(self.plan)))

    def _extend_plan(self) -> None:
        """Append the protocol's refinements after all present entries."""
        points = {entry: point for entry, (_, point) in self.measured.items()}
        self.plan = list(extend_plan(self._protocol, self.plan, points, self._rest_v))

    # -- points and series ---------------------------------------------------------------------------------------------

    def add_point(self, index: int, point: Any, air: Mapping[str, float] = MappingProxyType({})) -> PointMeasured:
        """Append a point with its values of the air to the file, flag the one it supersedes, and return the event to publish.

        Raises:
            StorageError: the file cannot be written.
        """
        if air and not np.isfinite([*air.values()]).any() and hasattr(point, "quality"):
            point = replace(point, quality=int(point_quality(point) | Quality.AIR_UNKNOWN))
        row = self._run_file.append_point(point, index, air)
        replaces, _ = self.measured.get(index, (None, None))
        if replaces is not None:
            self._run_file.flag_point(replaces, Quality.SUPERSEDED)
        self.measured[index] = (row, point)
        self._series[index] = []  # drops the series of a superseded point
        return PointMeasured(row, point, index, replaces)

    def flag_points(self, flag: Quality, affected: Callable[[Any], bool]) -> list[str]:
        """Add a flag to the points that `affected` selects, also in the file; return the labels of their entries.

        Raises:
            StorageError: the file cannot be written.
        """
        labels = []
        for index, (row, point) in self.measured.items():
            if affected(point) and flag not in point_quality(point):
                self._run_file.flag_point(row, flag)
                self.measured[index] = (row, replace(point, quality=int(point_quality(point) | flag)))
                labels.append(self.plan[index].label)
        return labels

    def add_series(self, series: Series) -> None:
        """Keep a series until it is written at the end of the run."""
        self._series[series.entry].append(series)

    def mark_failed(self, index: int) -> None:
        """Note that an entry has no point."""
        self._failed_labels.append(self.plan[index].label)

    # -- messages ------------------------------------------------------------------------------------------------------

    def new_warnings(self) -> list[str]:
        """Return the protocol's new warnings."""
        warnings = dict.fromkeys(self._protocol.warnings(self.points))
        new = [warning for warning in warnings if warning not in self.warnings]
        self.warnings += tuple(new)
        return new

    def new_limits(self) -> list[LevelExceeded]:
        """Return the limits of the protocol's figures that are exceeded for the first time in this run."""
        new = [each for each in self._protocol.limits_exceeded(self.points) if each.level not in self._limits]
        self._limits |= {each.level for each in new}
        return new

    def drifts(self) -> tuple[Series, ...]:
        """Return the series over all points so far, and keep them with the first entry; none if none has grown."""
        series = [replace(one, entry=0) for one in self._protocol.drifts(self.points)]
        if sum(one.x.size for one in series) <= sum(one.x.size for one in self._series.get(0, [])):
            return ()
        self._series[0] = series
        return tuple(series)

    def progress_event(self) -> ProgressUpdated:
        """Return the progress as an event to publish."""
        left = [self.plan[i] for i in self._queue]
        left_s = sum(entry.expected_s for entry in left)
        label, then = left[0].label if left else "done", left[1].label if len(left) > 1 else ""
        return ProgressUpdated(len(self.plan) - len(left), len(self.plan), left_s, label, then)

    def outcome_message(self) -> str:
        """Return the outcome of a completed run as a message."""
        if not self._failed_labels:
            return ALL_MEASURED
        return f"{len(self.measured)} of {len(self.plan)} points; none from {', '.join(self._failed_labels)}"
