"""Campaign texts for window and terminal: the next step, progress, and details of an item."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from app.campaign.series import varied_label
from app.campaign.status import HAS_VALID_RUN, ItemState, ItemStatus, NextAction
from app.campaign.summary import CampaignSummary, ItemSummary
from app.common import format_bytes, format_duration, pluralize, sentence_case
from app.session import format_voltage_range
from model import format_value, quantity_label
from protocols import Rehearsal
from protocols.base import EstimatedQuantity

if TYPE_CHECKING:
    from app.campaign.summary import CampaignEstimates


STATUS_MARKS = {
    ItemStatus.DONE: "✓",
    ItemStatus.STALE: "↻",
    ItemStatus.FAILED: "✗",
    ItemStatus.UNFINISHED: "…",
    ItemStatus.RUNNING: "▶",
    ItemStatus.SKIPPED: "–",
}

ACTION_LABELS = {NextAction.RUN: "Measure", NextAction.REPEAT: "Measure again", NextAction.RESUME: "Go on with"}
"""Verb for the next action of an item."""


def format_named_estimate(estimate: EstimatedQuantity) -> str:
    """`natural frequency: 158.350 ± 0.010 Hz`."""
    return f"{quantity_label(estimate.name)}: {format_value(estimate)}"


def next_action_reason(state: ItemState) -> str:
    """Return why this item is next."""
    needs = " and ".join(state.item.needs)
    match state.next_action:
        case NextAction.RESUME if state.status is ItemStatus.STALE:
            return "It is to be measured again, and the run that does so was interrupted. Its points are kept."
        case NextAction.RESUME:
            return f"The last run {first_clause(state.reason)}. The points that are there are kept."
        case NextAction.REPEAT if state.status is ItemStatus.STALE:
            return f"It was done, but {state.reason}."
        case NextAction.REPEAT:
            return f"The last run {first_clause(state.reason).replace('unsafe: UNSAFE', 'ended UNSAFE')}."
        case _:
            rests = f"; it depends on {needs}, which is done" if needs else ""
            return f"It is the first in the list that is not measured yet{rests}."


def first_clause(reason: str) -> str:
    """Return the first clause of a reason: the event, without remedy and library messages."""
    return re.split(r"; |\. | \((?=NI )", reason, maxsplit=1)[0].rstrip(".")


def format_rehearsal(rehearsal: Rehearsal, time_scale: float = 1.0) -> str:
    """Return duration, prompts, voltages and file size of an item in one line; `time_scale`: real seconds per bench second."""
    prompts = {0: "no prompts", 1: "1 prompt"}.get(rehearsal.prompts, f"{rehearsal.prompts} prompts")
    volts = format_voltage_range(rehearsal.lowest_specimen_v, rehearsal.highest_specimen_v)
    return f"about {format_duration(time_scale * rehearsal.duration_s)}, {prompts}, {volts} on the specimen, file about {format_bytes(rehearsal.file_bytes)}"


MAX_ESTIMATES = 6


class CampaignAction(StrEnum):
    """Actions of the operator; the first of a step is the default."""

    RUN = "run"
    RUN_HANDS_FREE = "run without hands"
    ACCEPT = "accept"
    REJECT = "reject"
    HALT_QUEUE = "halt the queue"


@dataclass(frozen=True, slots=True)
class NextStep:
    """The next step, shown above the list of items."""

    heading: str
    reason: str = ""
    detail: str = ""
    actions: tuple[CampaignAction, ...] = ()
    item_name: str = ""
    """Item of the step."""


def next_step(summary: CampaignSummary, running: str = "", busy: bool = False, queue: bool = False) -> NextStep:
    """Return the next step.

    Args:
        summary: the campaign now.
        running: item of this campaign that is being measured; empty for none.
        busy: whether any run is in progress.
        queue: whether hands-free items follow automatically.
    """
    if running or busy:
        return _running_step(summary, running, queue)
    if (item := summary.awaiting_acceptance) is not None:
        return _acceptance_step(summary, item)
    if summary.refusal:
        return NextStep("The bench cannot run the remaining items", summary.refusal)
    if (row := summary.next_item) is not None:
        return _run_step(summary, row)
    return _idle_step(summary)


def format_progress(summary: CampaignSummary, running: str = "", run_left_s: float = 0.0, answered: int = 0) -> str:
    """`3 of 7 done, about 1 h 05 min and 42 prompts left`, in real time; bench time left and answered prompts are the present run's."""
    text = f"{summary.done_count} of {summary.total_count} done"
    if not summary.remaining:
        return text
    left_s = summary.remaining_s(running) + summary.time_scale * run_left_s
    prompts = max(sum(rehearsal.prompts for rehearsal in summary.remaining) - answered, 0)
    return f"{text}, about {format_duration(left_s)} and {pluralize(prompts, 'prompt')} left"


def _running_step(summary: CampaignSummary, running: str, queue: bool) -> NextStep:
    row = summary.item(running)
    if row is None:
        return NextStep("A run of the Measure page is in progress", "The campaign continues when it has ended.")
    follows = "Measurements without manual steps follow automatically." if queue else _dependents_text(summary, row)
    whole = "" if row.rehearsal is None else f"In all {format_rehearsal(row.rehearsal, summary.time_scale)}."
    actions = (CampaignAction.HALT_QUEUE,) if queue else ()
    return NextStep(f"Measuring {row.name}: {row.state.title}", follows, whole, actions, row.name)


def _dependents_text(summary: CampaignSummary, item: ItemSummary) -> str:
    rest = [other.name for other in summary.items if item.name in other.state.item.needs]
    return f"Depends on it: {_join_names(rest)}." if rest else "Nothing else depends on it."


def _acceptance_step(summary: CampaignSummary, item: ItemSummary) -> NextStep:
    """Return the question whether to accept the estimates."""
    estimates = [format_named_estimate(estimate) for estimate in item.state.reviewed_estimates]
    if steps := item.state.steps:
        result = f"{len(steps)} values of {varied_label(item.state.item)}: the results are curves over it, below."
    elif estimates:
        more = f" … and {len(estimates) - MAX_ESTIMATES} more" if len(estimates) > MAX_ESTIMATES else ""
        result = ";  ".join(estimates[:MAX_ESTIMATES]) + more
    else:
        result = "It determines no parameter; its points are in the run file."
    follows = () if summary.next_item is None else (CampaignAction.RUN,)
    actions = (CampaignAction.ACCEPT, CampaignAction.REJECT, *follows)
    why = f"{item.state.title}. {_dependents_text(summary, item)}"
    return NextStep(f"Accept the result of {item.name}?", why, result, actions, item.name)


def _join_names(names: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _run_step(summary: CampaignSummary, item: ItemSummary) -> NextStep:
    heading = f"{ACTION_LABELS[item.state.next_action]} {item.name}: {item.state.title}"
    detail = ""
    if item.rehearsal is not None:
        takes = f"{format_rehearsal(item.rehearsal, summary.time_scale)}."
        at_most = item.state.next_action is NextAction.RESUME
        detail = f"At most {takes}" if at_most else sentence_case(takes)
    hands_free = () if summary.next_hands_free is None else (CampaignAction.RUN_HANDS_FREE,)
    return NextStep(heading, next_action_reason(item.state), detail, (CampaignAction.RUN, *hands_free), item.name)


def _idle_step(summary: CampaignSummary) -> NextStep:
    if all(row.state.status in (ItemStatus.DONE, ItemStatus.SKIPPED) for row in summary.items):
        left_out = [row.name for row in summary.items if row.state.status is ItemStatus.SKIPPED]
        but = f"Left out: {', '.join(left_out)}. " if left_out else ""
        return NextStep(
            "Everything is measured", f"{but}The button Report beside a result makes the report of {summary.specimen}"
        )
    waits = [f"{row.name}: {row.state.reason}" for row in summary.items if row.state.next_action is NextAction.WAIT]
    return NextStep("Nothing can be measured now", "; ".join(waits))


@dataclass(frozen=True, slots=True)
class DetailSection:
    """A heading with lines of text."""

    heading: str
    lines: tuple[str, ...]


def item_details(summary: ItemSummary, estimates: CampaignEstimates | None, specimen: str) -> tuple[DetailSection, ...]:
    """Return the details of an item; empty sections are left out."""
    line, item = summary.state, summary.state.item
    counts = line.status in HAS_VALID_RUN
    state = [f"{summary.status_text}{': ' if line.reason else ''}{line.reason}"]
    if line.run is not None:
        state.append(line.run.name)
    takes = [] if summary.rehearsal is None else [format_rehearsal(summary.rehearsal, summary.time_scale)]
    sections: dict[str, Iterable[str]] = {
        "State": state,
        "Found" if counts else "Found, but does not count": map(format_named_estimate, line.estimates),
        f"Parameters of {specimen} identified from all runs that count": _estimate_lines(estimates),
        "Carried over from earlier measurements": map(format_named_estimate, summary.accepted_estimates),
        "Will take": takes,
        "Set up first": (prompt.text for prompt in summary.prepare),
        "Depends on": filter(None, [", ".join(item.needs)]),
        "Settings that differ from the protocol's": (
            f"{name} = {_format_setting(value)}" for name, value in item.settings.items()
        ),
    }
    details = (DetailSection(heading, tuple(lines)) for heading, lines in sections.items())
    return tuple(section for section in details if section.lines)


def _estimate_lines(estimates: CampaignEstimates | None) -> tuple[str, ...]:
    if estimates is None:
        return ()
    verdict = (f"With total uncertainties. The model is {estimates.verdict}",) if estimates.estimates else ()
    problem = (estimates.problem,) if estimates.problem else ()
    return (*map(format_named_estimate, estimates.estimates), *verdict, *problem)


def _format_setting(value: object) -> str:
    return ", ".join(f"{v:g}" for v in value) if isinstance(value, list | tuple) else str(value)
