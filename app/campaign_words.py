"""A campaign in words, alike in window and terminal."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from app.campaign_standing import Listed, Next, Standing
from app.view import volts_between
from app.words import duration, quantity, size
from protocols.rehearsal import Rehearsal
from protocols.values import Estimate

if TYPE_CHECKING:
    from model.identification.estimates import Estimate as ModelEstimate

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
