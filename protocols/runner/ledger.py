"""The book of a run's entries: which are planned, what each has given, and which are left."""

from collections.abc import Collection
from typing import Any

from protocols.base import PlanEntry, PointMeasured, ProgressUpdated, Protocol, Repeat, ResultCurve, extend_plan
from protocols.runfile.writer import RunFileWriter


class PlanProgress:
    """Keeps the points of one run, in memory by entry and in its file by row; an entry measured again supersedes.

    Args:
        rest_v: the level of rest at the amplifier's input, which plans depend on.
    """

    def __init__(self, protocol: Protocol, run_file: RunFileWriter, rest_v: float) -> None:
        self._protocol, self._run_file, self._rest_v = protocol, run_file, rest_v
        self._plan: list[PlanEntry] = []
        self._queue: list[int] = []
        self._measured: dict[int, tuple[int, Any]] = {}
        """Row in the file and point, by entry."""
        self._curves: dict[int, list[ResultCurve]] = {}
        self._failed_labels: list[str] = []
        """Labels of the entries that gave no point."""
        self._reported_warnings: set[str] = set()

    @property
    def planned_count(self) -> int:
        """How many entries the plan has so far."""
        return len(self._plan)

    @property
    def measured_count(self) -> int:
        """How many of them have a point."""
        return len(self._measured)

    @property
    def points(self) -> list[Any]:
        """The points that count, by their place in the plan."""
        return [self._measured[i][1] for i in sorted(self._measured)]

    @property
    def curves(self) -> list[ResultCurve]:
        """What the entries gave beside their points, by their place in the plan."""
        return [curve for i in sorted(self._curves) for curve in self._curves[i]]

    def entry(self, index: int) -> PlanEntry:
        """An entry of the plan."""
        return self._plan[index]

    def point(self, index: int) -> Any:
        """The point of an entry that has one."""
        return self._measured[index][1]

    # -- what is left --------------------------------------------------------------------------------------------------

    def build_plan(self) -> None:
        """Open the plan as it is known beforehand."""
        self._plan = list(self._protocol.plan(self._rest_v))

    def queue_remaining(self, repeat_entries: Collection[int]) -> None:
        """All that has no point yet is left to be measured, and the entries `again`."""
        self._extend_plan()
        self._queue = [i for i in range(len(self._plan)) if i not in self._measured or i in repeat_entries]

    def next_entry(self) -> int | None:
        """The entry to measure now; None where nothing is left."""
        return self._queue.pop(0) if self._queue else None

    def complete(self, index: int, repeat: Repeat | None) -> None:
        """An entry is through; what follows it may be the entry before once more, or what the points now ask for."""
        if repeat is Repeat.PREVIOUS and index > 0:
            self._queue[:0] = [index - 1, index]
        if not self._queue:
            known = len(self._plan)
            self._extend_plan()
            self._queue = list(range(known, len(self._plan)))

    def _extend_plan(self) -> None:
        """Ask the protocol for further entries while all so far are measured."""
        points = {entry: point for entry, (_, point) in self._measured.items()}
        self._plan = list(extend_plan(self._protocol, self._plan, points, self._rest_v))

    # -- what was measured ---------------------------------------------------------------------------------------------

    def add_point(self, index: int, point: Any) -> PointMeasured:
        """Append a point to the file, flagging the one that it supersedes; what is to be published.

        Raises:
            StoreError: the file cannot be written.
        """
        row = self._run_file.append_point(point, index)
        replaces, _ = self._measured.get(index, (None, None))
        if replaces is not None:
            self._run_file.flag_superseded(replaces)
        self._measured[index] = (row, point)
        self._curves[index] = []  # those of an older point fell with it
        return PointMeasured(row, point, index, replaces)

    def add_curve(self, curve: ResultCurve) -> None:
        """Keep what an entry gave beside its point. The file gets it when the run ends."""
        self._curves[curve.entry].append(curve)

    def mark_failed(self, index: int) -> None:
        """Note that an entry gave no point."""
        self._failed_labels.append(self._plan[index].label)

    # -- what is said of it --------------------------------------------------------------------------------------------

    def new_warnings(self) -> list[str]:
        """What the protocol says of the points so far and was not said before."""
        new = [
            words
            for words in dict.fromkeys(self._protocol.warnings(self.points))
            if words not in self._reported_warnings
        ]
        self._reported_warnings.update(new)
        return new

    def progress_event(self) -> ProgressUpdated:
        """Where the run stands; what is to be published."""
        left = [self._plan[i] for i in self._queue]
        left_s = sum(entry.expected_s for entry in left)
        return ProgressUpdated(len(self._plan) - len(left), len(self._plan), left_s, left[0].label if left else "done")

    def outcome_message(self) -> str:
        """What a run that came to its end has measured, in words."""
        if not self._failed_labels:
            return "all points measured"
        return f"{len(self._measured)} of {len(self._plan)} points; none from {', '.join(self._failed_labels)}"
