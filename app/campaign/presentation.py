"""The next step of a campaign as a person is told it: what, why, what it will take, and what can be answered. No Qt.

A campaign in words, alike in window and terminal.

All that is told about one item of a campaign, in sections. No Qt, no terminal.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from app.campaign.status import GOOD, Listed, Next, Standing
from app.campaign.summary import Row, Sheet
from app.common.formatting import duration, quantity, size
from app.session.state import volts_between
from protocols.base.records import Estimate
from protocols.rehearsal import Rehearsal

if TYPE_CHECKING:
    from app.campaign.summary import Known
    from model.identification.calibration import Estimate as ModelEstimate


MARKS = {
    Standing.DONE: "✓",
    Standing.STALE: "↻",
    Standing.FAILED: "✗",
    Standing.UNFINISHED: "…",
    Standing.RUNNING: "▶",
    Standing.SKIPPED: "–",
}

DOES = {Next.RUN: "Measure", Next.AGAIN: "Measure again", Next.RESUME: "Go on with"}
"""What is done with an item that comes next."""


def estimate_words(estimate: Estimate | ModelEstimate) -> str:
    """`k2: 31.2 ± 0.4 N/m`."""
    return f"{estimate.name}: {quantity(estimate.value, estimate.standard_error, estimate.unit)}"


def why_next(line: Listed) -> str:
    """Why this is what comes next."""
    needs = " and ".join(line.item.needs)
    match line.next:
        case Next.RESUME:
            return f"The last run {shortly(line.reason)}. The points that are there are kept."
        case Next.AGAIN if line.standing is Standing.STALE:
            return f"It was done, but {line.reason}."
        case Next.AGAIN:
            return f"The last run {shortly(line.reason).replace('unsafe: UNSAFE', 'ended UNSAFE')}."
        case _:
            rests = f"; what it rests on, {needs}, is done" if needs else ""
            return f"It is the first in the list that is not measured yet{rests}."


def shortly(reason: str) -> str:
    """The first clause of a reason: what happened, without what to do and without the library's own words."""
    return re.split(r"; |\. | \((?=NI )", reason, maxsplit=1)[0].rstrip(".")


def rehearsal_words(told: Rehearsal) -> str:
    """What an item will ask of bench and people, in a line."""
    prompts = {0: "no prompts", 1: "1 prompt"}.get(told.prompts, f"{told.prompts} prompts")
    volts = volts_between(told.lowest_specimen_v, told.highest_specimen_v)
    return f"about {duration(told.duration_s)}, {prompts}, {volts} on the specimen, file about {size(told.file_bytes)}"


MOST_ESTIMATES = 6


class Do(StrEnum):
    """What a person may do about it; the first of a step is what is wanted."""

    RUN = "run"
    FREE = "run without hands"
    ACCEPT = "accept"
    REJECT = "reject"
    HALT = "halt the queue"


@dataclass(frozen=True, slots=True)
class Step:
    """What stands large above the list."""

    heading: str
    why: str = ""
    detail: str = ""
    does: tuple[Do, ...] = ()
    about: str = ""
    """The item it is about."""


def step_of(sheet: Sheet, running: str = "", busy: bool = False, queue: bool = False) -> Step:
    """What comes next.

    Args:
        sheet: the campaign now.
        running: the item whose run this campaign has begun and that goes on; empty for none.
        busy: whether any run goes on.
        queue: whether what needs no hands follows by itself.
    """
    if running or busy:
        return _going_on(sheet, running, queue)
    if (found := sheet.pending) is not None:
        return _to_accept(sheet, found)
    if sheet.refusal:
        return Step("The bench cannot do what is left", sheet.refusal)
    if (row := sheet.next) is not None:
        return _to_run(sheet, row)
    return _nothing(sheet)


def progress_words(sheet: Sheet, running: str = "", run_left_s: float = 0.0) -> str:
    """`3 of 7 done, about 1 h 05 min and 42 prompts left`."""
    words = f"{sheet.done} of {sheet.wanted} done"
    if not sheet.left:
        return words
    left_s = sheet.left_s(running) + run_left_s
    prompts = sum(told.prompts for told in sheet.left)
    return f"{words}, about {duration(left_s)} and {prompts} prompt{'s' * (prompts != 1)} left"


def _going_on(sheet: Sheet, running: str, queue: bool) -> Step:
    row = sheet.row(running)
    if row is None:
        return Step("A run of the Measure page is going on", "The campaign goes on when it has ended.")
    follows = "What needs no hands follows by itself." if queue else ""
    return Step(f"Measuring {row.name}: {row.line.title}", follows, "", (Do.HALT,) if queue else (), row.name)


def _to_accept(sheet: Sheet, row: Row) -> Step:
    told = [estimate_words(estimate) for estimate in row.line.estimates]
    more = f" … and {len(told) - MOST_ESTIMATES} more" if len(told) > MOST_ESTIMATES else ""
    found = (
        ";  ".join(told[:MOST_ESTIMATES]) + more if told else "It tells no parameter; its points are in the run file."
    )
    rest = [other.name for other in sheet.rows if row.name in other.line.item.needs]
    why = f"What will rest on it: {_and(rest)}." if rest else "Nothing else rests on it."
    goes = (Do.ACCEPT, Do.REJECT) + ((Do.RUN,) if sheet.next is not None else ())
    return Step(f"Accept what {row.name} found?", f"{row.line.title}. {why}", found, goes, row.name)


def _and(names: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _to_run(sheet: Sheet, row: Row) -> Step:
    heading = f"{DOES[row.line.next]} {row.name}: {row.line.title}"
    takes = f"{'at most ' * (row.line.next is Next.RESUME)}{rehearsal_words(row.told)}." if row.told else ""
    detail = takes[:1].upper() + takes[1:]
    does = (Do.RUN, Do.FREE) if sheet.free is not None else (Do.RUN,)
    return Step(heading, why_next(row.line), detail, does, row.name)


def _nothing(sheet: Sheet) -> Step:
    if all(row.line.standing in (Standing.DONE, Standing.SKIPPED) for row in sheet.rows):
        left_out = [row.name for row in sheet.rows if row.line.standing is Standing.SKIPPED]
        but = f"Left out: {', '.join(left_out)}. " if left_out else ""
        return Step("Everything is measured", f"{but}The report: tactor-bench report {sheet.specimen} --out reports")
    waits = [f"{row.name}: {row.line.reason}" for row in sheet.rows if row.line.next is Next.WAIT]
    return Step("Nothing can be measured now", "; ".join(waits))


@dataclass(frozen=True, slots=True)
class Section:
    """A heading and what stands below it."""

    heading: str
    lines: tuple[str, ...]


def details_of(row: Row, known: Known | None, specimen: str) -> tuple[Section, ...]:
    """What is known of an item; sections with nothing to tell are left out."""
    line, item = row.line, row.line.item
    counts = line.standing in GOOD
    state = [f"{row.state}{': ' if line.reason else ''}{line.reason}"]
    if line.run is not None:
        state.append(line.run.name)
    settings = tuple(f"{name} = {_value(value)}" for name, value in item.settings.items())
    told = (
        Section("State", tuple(state)),
        Section("Found" if counts else "Found, but does not count", tuple(map(estimate_words, line.estimates))),
        Section(f"Known of {specimen} from all runs that count, by the paper's chain", _known(known)),
        Section("Carried on into it", tuple(map(estimate_words, row.carried))),
        Section("Will take", (rehearsal_words(row.told),) if row.told is not None else ()),
        Section("Set up first", tuple(prompt.text for prompt in item.prepare)),
        Section("Rests on", (", ".join(item.needs),) if item.needs else ()),
        Section("Settings that differ from the protocol's", settings),
    )
    return tuple(section for section in told if section.lines)


def _known(known: Known | None) -> tuple[str, ...]:
    if known is None:
        return ()
    return (*map(estimate_words, known.estimates), *((known.why_not,) if known.why_not else ()))


def _value(value: object) -> str:
    return ", ".join(f"{v:g}" for v in value) if isinstance(value, list | tuple) else str(value)
