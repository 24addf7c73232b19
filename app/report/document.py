"""Report document: paragraphs, tables and plots as plain data, before layout."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from app.common import Table, pluralize
from app.config import Laboratory
from app.plotting import ReportPlot

PAGE_IN = (8.27, 11.69)
"""Width and height of a page (A4)."""
MARGIN_IN = 0.6
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


@dataclass(frozen=True, slots=True)
class Photograph:
    """A photograph, PNG or JPEG, right of the table behind it."""

    data: bytes
    description: str


Block = Paragraph | Table | ReportPlot | Photograph


@dataclass(frozen=True, slots=True)
class ReportSection:
    """A section behind the first page."""

    title: str
    blocks: Sequence[Block]
    own_page: bool = False
    """Whether it begins on a new page."""


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
    measured_by: str = ""
    """Operators of the runs."""

    @property
    def signatures(self) -> tuple[str, ...]:
        """Texts of the lines to sign."""
        signed = (f"Signed by {self.signed_by}",) if self.signed_by else ()
        return (*signed, f"Measured by {self.measured_by}".rstrip(), "Checked by", "Date")

    record: dict[str, object] = field(default_factory=dict)
    """The content for JSON, SI units."""

    @property
    def title(self) -> str:
        """Heading of the first page."""
        specimens = self.record.get("specimens")
        return pluralize(len(specimens), "specimen") if isinstance(specimens, list) else f"Specimen {self.specimen}"

    @property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks, in their order."""
        return (*self.first_page, *(block for section in self.appendix for block in section.blocks))

    @property
    def passed(self) -> bool:
        """Whether all limits are met."""
        return all(outcome.verdict == "pass" for outcome in self.limit_outcomes)
