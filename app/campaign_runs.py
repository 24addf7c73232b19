"""What the run files of a specimen tell a campaign; each is read once, and again only when it has changed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from protocols.continuation import points_of
from protocols.events import Status
from protocols.registry import PROTOCOLS
from protocols.runreader import Run, RunError
from protocols.values import Estimate

CRASHED = "crashed"


@dataclass(frozen=True, slots=True)
class Made:
    """One run file, as a campaign sees it."""

    path: Path
    specimen: str
    protocol: str
    parameters: Mapping[str, Any]
    state: str
    reason: str = ""
    start_time: str = ""
    points: int = 0
    estimates: tuple[Estimate, ...] = ()
    simulated: bool = False
    failing: tuple[str, ...] = ()
    """What its protocol's own verdicts (a wiring check's) say did not pass."""

    @property
    def name(self) -> str:
        return self.path.name

    @property
    def completed(self) -> bool:
        return self.state == Status.COMPLETED and not self.failing

    @property
    def running(self) -> bool:
        return self.state == Status.RUNNING

    @property
    def resumable(self) -> bool:
        """Whether it can be gone on with."""
        return self.points > 0 and self.state in (Status.STOPPED, Status.FAILED, CRASHED)


class Shelf:
    """The run files of a folder, in the order in which they were begun."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read: dict[Path, tuple[tuple[int, int], Made | None]] = {}

    def runs(self, since: str, leave: Path | None = None) -> list[Made]:
        """All runs begun since (ISO, UTC) but `leave`, which this very program is writing.

        A file that cannot be read is none: `tactor-bench runs` says why.
        """
        stamp = since.translate({ord(c): None for c in "-:"})[:15]  # 20261121T091502, as file names begin
        made = [run for path in self._files(stamp) if path != leave and (run := self._made(path))]
        return sorted((run for run in made if run.start_time >= since), key=lambda run: (run.start_time, run.name))

    def _files(self, stamp: str) -> Iterator[Path]:
        if self.folder.is_dir():
            yield from (path for path in self.folder.glob("*.h5") if path.name[: len(stamp)] >= stamp)

    def _made(self, path: Path) -> Made | None:
        try:
            stat = path.stat()
        except OSError:
            return None
        seen = stat.st_mtime_ns, stat.st_size
        known, made = self._read.get(path, (None, None))
        # A file that says `running` does not change when its writer dies.
        if known != seen or (made is not None and made.running):
            try:
                made = read(path)
            except (RunError, OSError, KeyError, ValueError, RuntimeError):
                made = None
            self._read[path] = seen, made
        return made


def read(path: Path) -> Made:
    """A run file. Raises what `Run` raises where it is damaged."""
    with Run(path) as run:
        kind = PROTOCOLS.get(run.protocol)
        points = points_of(run, kind.point_type) if kind is not None else ()
        failing: tuple[str, ...] = ()
        judge = getattr(kind, "verdicts", None)
        if kind is not None and judge is not None and run.status is Status.COMPLETED:
            table = judge(kind(**run.parameters), [point for _, point in points])
            failing = tuple(verdict.name for verdict in table if not verdict.passed)
        return Made(
            path=path,
            specimen=run.specimen,
            protocol=run.protocol,
            parameters=run.parameters,
            state=run.state,
            reason=run.reason,
            start_time=run.start_time,
            points=len({entry for entry, _ in points}),
            estimates=run.estimates(),
            simulated=run.simulated,
            failing=failing,
        )
