"""What a report is made of before it is set: words, tables and plots as plain data."""

from dataclasses import dataclass, field
from typing import Literal

from app.plotting.panels import ReportPlot

Tone = Literal["plain", "good", "bad", "small"]


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph."""

    text: str
    tone: Tone = "plain"


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table: a title, heads, rows of text; `bad` are rows that a reader must not miss."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    highlighted_rows: frozenset[int] = frozenset()
    monospace: bool = False
    """Letters of one width: hashes."""


Block = Paragraph | ReportTable | ReportPlot


@dataclass(frozen=True, slots=True)
class ReportSection:
    """A part of the appendix."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, slots=True)
class LimitOutcome:
    """What somebody asked of the specimen, and whether it holds."""

    name: str
    asked: str
    found: str
    verdict: Literal["pass", "fail", "cannot tell"]
    why: str = ""


@dataclass(frozen=True, slots=True)
class Report:
    """What stands in the report, before it is set."""

    specimen: str
    subtitle: str
    page_marks: tuple[str, ...]
    """What must be seen on every page: SIMULATED, IMPORTED."""
    first_page: tuple[Block, ...]
    """The page to sign."""
    appendix: tuple[ReportSection, ...]
    limit_outcomes: tuple[LimitOutcome, ...] = ()
    fingerprint: str = ""
    """Of the hashes of all its run files."""
    software_version: str = ""
    record: dict[str, object] = field(default_factory=dict)
    """The same for machines, SI units."""

    @property
    def passed(self) -> bool:
        """Whether everything that was asked of the specimen holds."""
        return all(outcome.verdict == "pass" for outcome in self.limit_outcomes)
