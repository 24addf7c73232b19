"""Report document: paragraphs, tables and plots as plain data, before layout."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from app.common import Table
from app.config import Laboratory
from app.plotting import ReportPlot

PAGE_IN = (8.27, 11.69)
"""Width and height of a page (A4)."""
MARGIN_IN = 0.75
"""To the left and right of the text."""
WIDTH_IN = PAGE_IN[0] - 2 * MARGIN_IN
"""Width of the text and of the drawings."""

Tone = Literal["plain", "good", "bad", "small"]
Verdict = Literal["pass", "fail", "cannot tell"]


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph of text."""

    text: str
    tone: Tone = "plain"


Block = Paragraph | Table | ReportPlot


@dataclass(frozen=True, slots=True)
class ReportSection:
    """A section behind the first page."""

    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True, slots=True)
class LimitOutcome:
    """A limit with the measured value and the verdict."""

    name: str
    asked: str
    found: str
    verdict: Verdict
    why: str = ""
    source: str = ""
    """Run with the measured value, or the identified model."""


@dataclass(frozen=True, slots=True)
class Report:
    """A report before layout."""

    specimen: str
    subtitle: str
    page_marks: tuple[str, ...]
    """Marks on every page: SIMULATED, IMPORTED."""
    first_page: tuple[Block, ...]
    """The page that is signed."""
    appendix: tuple[ReportSection, ...]
    limit_outcomes: tuple[LimitOutcome, ...] = ()
    fingerprint: str = ""
    """Hash of the hashes of all run files."""
    software_version: str = ""
    laboratory: Laboratory = field(default_factory=Laboratory)
    """Its name, on the first page, and a line at the top and at the foot of every page."""
    logo: bytes = b""
    """The laboratory's picture on the first page, PNG; empty for none."""
    signed_by: str = ""
    """Who signs; empty where it is written by hand."""
    record: dict[str, object] = field(default_factory=dict)
    """The content for JSON, SI units."""

    @property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks, in their order."""
        return (*self.first_page, *(block for section in self.appendix for block in section.blocks))

    @property
    def passed(self) -> bool:
        """Whether all limits are met."""
        return all(outcome.verdict == "pass" for outcome in self.limit_outcomes)
