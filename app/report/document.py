"""What a report is made of before it is set: words, tables and plots as plain data."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
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


@dataclass(frozen=True, slots=True)
class MeasuredPoints:
    """Measured points; `half` is half of their 95 % intervals. Hollow where `good` is False."""

    label: str
    x: Array
    y: Array
    half_interval: Array
    usable: NDArray[np.bool_]
    marker: str = "o"
    model_y: Array | None = None
    """What the model says there; the strip below shows the difference."""


@dataclass(frozen=True, slots=True)
class PlotLine:
    """A curve, with its 95 % band where it has one."""

    label: str
    x: Array
    y: Array
    lower: Array | None = None
    upper: Array | None = None
    style: str = "-"


@dataclass(frozen=True, slots=True)
class PlotPanel:
    """One pair of axes, in the units it is read in, and a strip of residuals below where dots know their model."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[PlotLine, ...] = ()
    points: tuple[MeasuredPoints, ...] = ()
    reference_level: tuple[float, str] | None = None
    """A horizontal line and what it means."""
    from_zero: bool = True
    unit: str = ""
    """Of y and of the residuals."""


@dataclass(frozen=True, slots=True)
class ReportPlot:
    """Panels side by side, `columns` in a row, with a legend and a caption; `inches` is the height of one row."""

    title: str
    panels: tuple[PlotPanel, ...]
    caption: str = ""
    columns: int = 1
    row_height_in: float = 2.25

    @property
    def rows(self) -> int:
        return -(-len(self.panels) // self.columns)


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
