"""All that is told about one item of a campaign, in sections. No Qt, no terminal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.campaign_standing import GOOD
from app.campaign_words import estimate_words, rehearsal_words

if TYPE_CHECKING:
    from app.campaign_sheet import Known, Row


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
