"""How each measurement of a campaign stands: computed from its run files and from what each run was based on. Pure.

What the run files of a specimen tell a campaign; each is read once, and again only when it has changed.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from app.campaign.plan import Item
from app.common.formatting import ended
from protocols.base.events import Status
from protocols.base.records import Estimate
from protocols.registry import PROTOCOLS
from protocols.resume import points_of
from protocols.runfile.reader import Run, RunError

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


SAME = 1e-9
"""Estimates that differ by less, relatively, are the same."""

Basis = Mapping[str, Mapping[str, Any]]
"""By name of an item that a run rested on: which run of it, and what came out of that."""


class Standing(StrEnum):
    """How an item stands."""

    DONE = "done"
    STALE = "stale"
    """Done, but what it was based on has changed since."""
    MISSING = "missing"
    WAITING = "waiting"
    """Missing, and what it needs is not done."""
    UNFINISHED = "unfinished"
    """Broken off with points that a resumed run keeps."""
    FAILED = "failed"
    RUNNING = "running"
    SKIPPED = "skipped"


GOOD = (Standing.DONE, Standing.STALE)
"""There is a run that counts."""


class Next(StrEnum):
    """What an item asks for."""

    NOTHING = ""
    RUN = "run"
    RESUME = "resume"
    AGAIN = "run again"
    WAIT = "wait"


@dataclass(frozen=True, slots=True)
class Listed:
    """One line of a campaign: how an item stands, why, and what comes next. All a window needs to draw it."""

    item: Item
    title: str
    standing: Standing
    reason: str
    next: Next
    run: Path | None = None
    """The run that counts, or the one to go on with."""
    begun: str = ""
    """When that run was begun, ISO, UTC."""
    estimates: tuple[Estimate, ...] = ()
    """Of the run that counts; what the items after it are based on."""

    @property
    def accepted(self) -> bool:
        """Whether a person has looked at what the run that counts found, and taken it."""
        return self.run is not None and self.run.name in self.item.accepted


def stand(
    items: Sequence[Item],
    titles: Mapping[str, str],
    runs: Mapping[str, Sequence[Made]],
    based_on: Mapping[str, Basis],
) -> tuple[Listed, ...]:
    """Every item, in order.

    Args:
        items: of the campaign; each comes after what it needs.
        titles: of the protocols, by their names.
        runs: of each item by its name, oldest first.
        based_on: what each run was based on, by its file's name; nothing for a run that was made by hand.
    """
    found: dict[str, Listed] = {}
    for item in items:
        title = titles.get(item.protocol, item.protocol)
        found[item.name] = _one(item, title, runs.get(item.name, ()), found, based_on)
    return tuple(found.values())


def _one(
    item: Item, title: str, runs: Sequence[Made], before: Mapping[str, Listed], based_on: Mapping[str, Basis]
) -> Listed:
    if item.skipped:
        return Listed(item, title, Standing.SKIPPED, item.skipped, Next.NOTHING)
    last = runs[-1] if runs else None
    if last is not None and last.running:
        return Listed(item, title, Standing.RUNNING, f"{last.name} is being written", Next.WAIT, last.path)
    waits = [need for need in item.needs if before[need].standing not in (Standing.DONE, Standing.SKIPPED)]
    do = Next.WAIT if waits else Next.AGAIN
    if done := next((run for run in reversed(runs) if run.completed), None):
        why = _why_stale(item, done, before, based_on.get(done.name))
        later = f"; a later run is {last.state}" if last is not None and last is not done else ""
        standing, reason = (Standing.STALE, why) if why else (Standing.DONE, done.reason)
        return Listed(
            item,
            title,
            standing,
            reason + later,
            do if why else Next.NOTHING,
            done.path,
            done.start_time,
            done.estimates,
        )  # fmt: skip
    if last is None:
        if waits:
            return Listed(item, title, Standing.WAITING, f"needs {', '.join(waits)}", Next.WAIT)
        return Listed(item, title, Standing.MISSING, "not measured yet", Next.RUN)
    if last.resumable:
        reason = f"{last.state} with {last.points} points: {last.reason or 'its program is gone'}"
        do = Next.WAIT if waits else Next.RESUME
        return Listed(item, title, Standing.UNFINISHED, reason, do, last.path, last.start_time)
    reason = f"did not pass: {', '.join(last.failing)}" if last.failing else ended(last.state, last.reason)
    standing = Standing.MISSING if last.state in (Status.STOPPED, CRASHED) else Standing.FAILED
    return Listed(item, title, standing, reason, do, last.path, last.start_time)


def _why_stale(item: Item, done: Made, before: Mapping[str, Listed], basis: Basis | None) -> str:
    """Why a run does not hold any more, from what it was based on; empty where it does."""
    for need in item.needs:
        line = before[need]
        if line.standing is Standing.SKIPPED:
            continue
        if line.standing is not Standing.DONE:
            return f"{need} is {line.standing}"
        if basis is None:  # made by hand: all that can be said is what came first
            if line.begun > done.start_time:
                return f"{need} was measured after it"
        elif need in basis and (why := _changed(need, basis[need], basis_of(line))):
            return why
    return ""


def basis_of(line: Listed) -> dict[str, Any]:
    """What an item after this one rests on: which run, and what came out of it."""
    estimates = {estimate.name: estimate.value for estimate in line.estimates if math.isfinite(estimate.value)}
    return {"run": line.run.name if line.run else "", "estimates": estimates}


def _changed(need: str, was: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """What has changed between two bases, in words; empty where nothing has."""
    if was["run"] != now["run"]:
        return f"{need} was measured again"
    old, new = was["estimates"], now["estimates"]
    for name in sorted(old.keys() | new.keys()):
        if name not in old or name not in new:
            return f"{name} of {need} {'is new' if name in new else 'is not there any more'}"
        if abs(new[name] - old[name]) > SAME * abs(old[name]):
            return f"{name} of {need} changed from {old[name]:.6g} to {new[name]:.6g}"
    return ""
