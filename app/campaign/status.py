"""Status of campaign items, computed from run summaries and the basis of each run."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

from app.archive import RunState, RunSummary, read_run_summary
from app.campaign.plan import CampaignItem
from app.common import format_outcome
from model import current_name
from protocols.base import EstimatedQuantity, Outcome


class CampaignRuns:
    """Summaries of a folder's run files, in memory; files are read again when they have changed.

    Not the index of `app.archive.catalogue`: a campaign is evaluated while its run is being made, and must not wait for
    another thread's lock on a database.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._cache: dict[Path, RunSummary] = {}

    def begun_since(self, since: str, exclude: Path | None = None) -> list[RunSummary]:
        """Return all runs begun since (ISO, UTC), oldest first; `exclude` is being written and is not opened.

        A file that cannot be read is left out: `tactor-bench runs` gives the reason.
        """
        stamp = since.translate({ord(c): None for c in "-:"})[:15]  # 20261121T091502, as file names begin
        files = self.folder.glob("*.h5") if self.folder.is_dir() else ()
        runs = [self._summary(path) for path in files if path != exclude and path.name[: len(stamp)] >= stamp]
        recent = [run for run in runs if run is not None and run.readable and run.start_time >= since]
        return sorted(recent, key=lambda run: (run.start_time, run.name))

    def _summary(self, path: Path) -> RunSummary | None:
        try:
            stat = path.stat()
        except OSError:
            return None
        summary = self._cache.get(path)
        # A file marked `running` does not change when its writer is killed.
        if (
            summary is None
            or summary.running
            or (summary.modified_ns, summary.size) != (stat.st_mtime_ns, stat.st_size)
        ):
            summary = read_run_summary(path, path.name) or RunSummary(path.name, RunState.DAMAGED)
            self._cache[path] = summary._replace(modified_ns=stat.st_mtime_ns, size=stat.st_size)
        return summary


REPEAT_REASON = "it is to be measured again; this result counts until then"

RELATIVE_TOLERANCE = 1e-9
"""Relative difference below which estimates are equal."""

Basis = Mapping[str, Mapping[str, Any]]
"""Run and estimates that a run was based on, by item name."""


class ItemStatus(StrEnum):
    """Status of an item."""

    DONE = "done"
    STALE = "stale"
    """Done, but its basis has changed since."""
    MISSING = "missing"
    WAITING = "waiting"
    """Missing, and a dependency is not done."""
    UNFINISHED = "unfinished"
    """Interrupted with points that a resumed run keeps."""
    FAILED = "failed"
    RUNNING = "running"
    SKIPPED = "skipped"


HAS_VALID_RUN = (ItemStatus.DONE, ItemStatus.STALE)
"""Statuses with a valid run."""


class NextAction(StrEnum):
    """Next action of an item."""

    NONE = ""
    RUN = "run"
    RESUME = "resume"
    REPEAT = "run again"
    WAIT = "wait"


@dataclass(frozen=True, slots=True)
class ItemState:
    """Status of one item with reason and next action."""

    item: CampaignItem
    title: str
    status: ItemStatus
    reason: str
    next_action: NextAction
    run: Path | None = None
    """The valid run, or the one to resume."""
    started_at: str = ""
    """Start time of that run, ISO, UTC."""
    estimates: tuple[EstimatedQuantity, ...] = ()
    """Estimates of the valid run, the basis of later items."""
    resumed_run: Path | None = None
    """The run that `NextAction.RESUME` continues."""
    candidate: RunSummary | None = None
    """A later run that counts once it is accepted; until then the accepted one counts."""
    results: tuple[RunSummary, ...] = ()
    """Every run with a result, also the rejected ones, oldest first."""
    step: CampaignItem | None = None
    """Of a series: the item of the value that is measured next."""
    steps: tuple["ItemState", ...] = ()
    """States of the values of a series."""

    @property
    def pending(self) -> tuple[CampaignItem, ...]:
        """Remaining measurements: the item itself, or values of a series."""
        if not self.steps:
            return (self.item,) if self.next_action is not NextAction.NONE else ()
        return tuple(step.item for step in self.steps if step.next_action is not NextAction.NONE)

    @property
    def is_ready(self) -> bool:
        """Whether the item can be measured now."""
        return self.next_action not in (NextAction.NONE, NextAction.WAIT)

    @property
    def accepted(self) -> bool:
        """Whether the operator has accepted the estimates of the valid run, or of every value of a series."""
        if self.steps:
            return all(step.accepted for step in self.steps)
        return self.run is not None and self.run.name in self.item.accepted

    @property
    def awaits_acceptance(self) -> bool:
        """Whether the result of the candidate or of the valid run is to be accepted."""
        return self.candidate is not None or (self.status is ItemStatus.DONE and not self.accepted)

    @property
    def reviewed_estimates(self) -> tuple[EstimatedQuantity, ...]:
        """Estimates of the run that is accepted or rejected next."""
        return self.estimates if self.candidate is None else self.candidate.record.estimates

    @property
    def reviewed_run(self) -> Path | None:
        """The run that is accepted or rejected next: the candidate, or else `run`."""
        if self.candidate is None or self.run is None:
            return self.run
        return self.run.parent / self.candidate.name


def evaluate_item(
    folder: Path,
    item: CampaignItem,
    title: str,
    runs: Sequence[RunSummary],
    previous: Mapping[str, ItemState],
    based_on: Mapping[str, Basis],
) -> ItemState:
    """Return the state of an item that is a single run; `previous` are the states of the items before it."""
    if item.skipped:
        return ItemState(item, title, ItemStatus.SKIPPED, item.skipped, NextAction.NONE)
    results = tuple(run for run in runs if run.has_result)
    # Runs before a request to measure again are not resumed; their results count until there is another.
    since = [run for run in runs if (run.running or run.start_time >= item.since) and run.name not in item.rejected]
    last = since[-1] if since else None
    state = partial(ItemState, item, title, results=results)
    if last is not None and last.running:
        return state(ItemStatus.RUNNING, f"{last.name} is being written", NextAction.WAIT, folder / last.path)
    waits = [need for need in item.needs if previous[need].status not in (ItemStatus.DONE, ItemStatus.SKIPPED)]
    if (done := _valid_run(item, results, previous, based_on)) is None:
        return _state_without_result(state, folder, last, waits)
    stale = _stale_reason(item, done, previous, based_on.get(done.name))
    return _state_with_result(state, folder, item, done, stale, last, waits)


def _resumes(last: RunSummary | None) -> bool:
    """Whether the last run of an item is resumed."""
    return last is not None and not last.has_result and last.resumable and last.state != RunState.UNSAFE


def _state_with_result(
    state: partial[ItemState],
    folder: Path,
    item: CampaignItem,
    done: RunSummary,
    stale: str,
    last: RunSummary | None,
    waits: Sequence[str],
) -> ItemState:
    """Return the state of an item with a valid run; `stale` is why that is stale, `last` and `waits` as below."""
    newest = [run for run in state.keywords["results"] if run.name not in item.rejected][-1]
    candidate = newest if newest is not done and newest.name not in item.accepted else None
    requested = bool(item.since) and newest.start_time < item.since
    why = REPEAT_REASON if requested else stale
    if candidate is not None:
        why, later = "", "; a later run is to be accepted"
    else:
        later = "" if last is None or last.has_result else f"; a later run {_later_text(last)}"
    action = NextAction.RESUME if requested and _resumes(last) else NextAction.REPEAT
    return state(
        ItemStatus.STALE if why else ItemStatus.DONE,
        (why or _result_text(done)) + later,
        NextAction.NONE if not why else NextAction.WAIT if waits else action,
        folder / done.path,
        done.start_time,
        done.record.estimates,
        folder / last.path if last is not None and not waits and action is NextAction.RESUME else None,
        candidate,
    )


def _state_without_result(
    state: partial[ItemState], folder: Path, last: RunSummary | None, waits: Sequence[str]
) -> ItemState:
    """Return the state of an item without a valid run; `last` is its last run, `waits` are the dependencies that are not done."""
    if last is None:
        if waits:
            return state(ItemStatus.WAITING, f"needs {', '.join(waits)}", NextAction.WAIT)
        return state(ItemStatus.MISSING, "not measured yet", NextAction.RUN)
    path = folder / last.path
    if _resumes(last):
        why = "its program is gone" if last.state == RunState.CRASHED else last.record.reason
        reason = f"{last.state} with {last.record.entry_count} points: {why}"
        action = NextAction.WAIT if waits else NextAction.RESUME
        return state(ItemStatus.UNFINISHED, reason, action, path, last.start_time, resumed_run=path)
    status = ItemStatus.MISSING if last.state in (RunState.STOPPED, RunState.CRASHED) else ItemStatus.FAILED
    action = NextAction.WAIT if waits else NextAction.REPEAT
    return state(status, _failure_text(last), action, path, last.start_time)


def _valid_run(
    item: CampaignItem, results: Sequence[RunSummary], previous: Mapping[str, ItemState], based_on: Mapping[str, Basis]
) -> RunSummary | None:
    """Return the valid run: the last accepted one while its basis is unchanged; otherwise the newest."""
    valid = {run.name: run for run in results if run.name not in item.rejected}
    accepted = next((valid[name] for name in reversed(item.accepted) if name in valid), None)
    if accepted is not None and not _stale_reason(item, accepted, previous, based_on.get(accepted.name)):
        return accepted
    return list(valid.values())[-1] if valid else None


def _result_text(run: RunSummary) -> str:
    """Return the verdict and its reasons; how the run ended where it is not judged."""
    return run.record.reason if run.outcome is Outcome.NOT_JUDGED else format_outcome(run.verdict, run.explanation)


def _later_text(run: RunSummary) -> str:
    """Return the end of a run without a result, as a predicate."""
    if run.outcome is Outcome.NO_RESULT:
        return "has no result"
    return str(run.verdict) if run.outcome is Outcome.DID_NOT_PASS else f"is {run.state}"


def _failure_text(run: RunSummary) -> str:
    """Return why a run has no result, with the remedy where the verdict names one."""
    if run.outcome is not Outcome.NOT_JUDGED:
        return format_outcome(run.verdict, run.explanation)
    if run.failed_checks:
        return f"{Outcome.DID_NOT_PASS}: {run.failed_checks}"
    return format_outcome(run.state, "" if run.state == RunState.CRASHED else run.record.reason)


def _stale_reason(
    item: CampaignItem, completed: RunSummary, previous: Mapping[str, ItemState], basis: Basis | None
) -> str:
    """Return why a run is stale, from its basis; empty if it is not."""
    for need in item.needs:
        line = previous[need]
        if line.status is ItemStatus.SKIPPED:
            continue
        if line.status is not ItemStatus.DONE:
            return f"{need} is {line.status}"
        if basis is None:  # made outside the campaign: only the times can be compared
            if line.started_at > completed.start_time:
                return f"{need} was measured after it"
        elif need in basis and (why := _describe_change(need, basis[need], basis_of(line))):
            return why
    return ""


def basis_of(state: ItemState) -> dict[str, Any]:
    """Return the basis that this item gives to later ones: run and estimates."""
    estimates = {estimate.name: estimate.value for estimate in state.estimates if math.isfinite(estimate.value)}
    return {"run": state.run.name if state.run else "", "estimates": estimates}


def _describe_change(need: str, old_basis: Mapping[str, Any], new_basis: Mapping[str, Any]) -> str:
    """Return the difference of two bases as text; empty if equal."""
    if old_basis["run"] != new_basis["run"]:
        return f"{need} was measured again"
    old, new = {current_name(name): value for name, value in old_basis["estimates"].items()}, new_basis["estimates"]
    for name in sorted(old.keys() | new.keys()):
        if name not in old or name not in new:
            return f"{name} of {need} {'is new' if name in new else 'is not there any more'}"
        if abs(new[name] - old[name]) > RELATIVE_TOLERANCE * abs(old[name]):
            return f"{name} of {need} changed from {old[name]:.6g} to {new[name]:.6g}"
    return ""
