"""The book of a run's entries: which are planned, what each has given, and which are left."""

from collections.abc import Collection
from typing import Any

from protocols.base.events import PointMeasured, Progressed
from protocols.base.protocol import Protocol, extended
from protocols.base.records import Curve, Planned
from protocols.base.steps import Redo
from protocols.runfile.writer import RunFile


class Ledger:
    """Keeps the points of one run, in memory by entry and in its file by row; an entry measured again supersedes.

    Args:
        rest_v: the level of rest at the amplifier's input, which plans depend on.
    """

    def __init__(self, protocol: Protocol, store: RunFile, rest_v: float) -> None:
        self._protocol, self._store, self._rest_v = protocol, store, rest_v
        self._plan: list[Planned] = []
        self._left: list[int] = []
        self._measured: dict[int, tuple[int, Any]] = {}
        """Row in the file and point, by entry."""
        self._curves: dict[int, list[Curve]] = {}
        self._without: list[str] = []
        """Labels of the entries that gave no point."""
        self._remarked: set[str] = set()

    @property
    def planned(self) -> int:
        """How many entries the plan has so far."""
        return len(self._plan)

    @property
    def measured(self) -> int:
        """How many of them have a point."""
        return len(self._measured)

    @property
    def points(self) -> list[Any]:
        """The points that count, by their place in the plan."""
        return [self._measured[i][1] for i in sorted(self._measured)]

    @property
    def curves(self) -> list[Curve]:
        """What the entries gave beside their points, by their place in the plan."""
        return [curve for i in sorted(self._curves) for curve in self._curves[i]]

    def entry(self, index: int) -> Planned:
        """An entry of the plan."""
        return self._plan[index]

    def point(self, index: int) -> Any:
        """The point of an entry that has one."""
        return self._measured[index][1]

    # -- what is left --------------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Open the plan as it is known beforehand."""
        self._plan = list(self._protocol.plan(self._rest_v))

    def leave(self, again: Collection[int]) -> None:
        """All that has no point yet is left to be measured, and the entries `again`."""
        self._extend()
        self._left = [i for i in range(len(self._plan)) if i not in self._measured or i in again]

    def next(self) -> int | None:
        """The entry to measure now; None where nothing is left."""
        return self._left.pop(0) if self._left else None

    def done(self, index: int, redo: Redo | None) -> None:
        """An entry is through; what follows it may be the entry before once more, or what the points now ask for."""
        if redo is Redo.PREVIOUS and index > 0:
            self._left[:0] = [index - 1, index]
        if not self._left:
            known = len(self._plan)
            self._extend()
            self._left = list(range(known, len(self._plan)))

    def _extend(self) -> None:
        """Ask the protocol for further entries while all so far are measured."""
        points = {entry: point for entry, (_, point) in self._measured.items()}
        self._plan = list(extended(self._protocol, self._plan, points, self._rest_v))

    # -- what was measured ---------------------------------------------------------------------------------------------

    def keep(self, index: int, point: Any) -> PointMeasured:
        """Append a point to the file, flagging the one that it supersedes; what is to be published.

        Raises:
            StoreError: the file cannot be written.
        """
        row = self._store.point(point, index)
        replaces, _ = self._measured.get(index, (None, None))
        if replaces is not None:
            self._store.supersede(replaces)
        self._measured[index] = (row, point)
        self._curves[index] = []  # those of an older point fell with it
        return PointMeasured(row, point, index, replaces)

    def keep_curve(self, curve: Curve) -> None:
        """Keep what an entry gave beside its point. The file gets it when the run ends."""
        self._curves[curve.entry].append(curve)

    def give_up(self, index: int) -> None:
        """Note that an entry gave no point."""
        self._without.append(self._plan[index].label)

    # -- what is said of it --------------------------------------------------------------------------------------------

    def remarks(self) -> list[str]:
        """What the protocol says of the points so far and was not said before."""
        new = [words for words in dict.fromkeys(self._protocol.remarks(self.points)) if words not in self._remarked]
        self._remarked.update(new)
        return new

    def progress(self) -> Progressed:
        """Where the run stands; what is to be published."""
        left = [self._plan[i] for i in self._left]
        left_s = sum(entry.expected_s for entry in left)
        return Progressed(len(self._plan) - len(left), len(self._plan), left_s, left[0].label if left else "done")

    def outcome(self) -> str:
        """What a run that came to its end has measured, in words."""
        if not self._without:
            return "all points measured"
        return f"{len(self._measured)} of {len(self._plan)} points; none from {', '.join(self._without)}"
