"""What a report is made of before it is set: words, tables and plots as plain data."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Tone = Literal["plain", "good", "bad", "small"]


@dataclass(frozen=True, slots=True)
class Words:
    """A paragraph."""

    text: str
    tone: Tone = "plain"


@dataclass(frozen=True, slots=True)
class Grid:
    """A table: a title, heads, rows of text; `bad` are rows that a reader must not miss."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    bad: frozenset[int] = frozenset()
    code: bool = False
    """Letters of one width: hashes."""


@dataclass(frozen=True, slots=True)
class Dots:
    """Measured points; `half` is half of their 95 % intervals. Hollow where `good` is False."""

    label: str
    x: Array
    y: Array
    half: Array
    good: NDArray[np.bool_]
    marker: str = "o"
    model: Array | None = None
    """What the model says there; the strip below shows the difference."""


@dataclass(frozen=True, slots=True)
class Line:
    """A curve, with its 95 % band where it has one."""

    label: str
    x: Array
    y: Array
    lower: Array | None = None
    upper: Array | None = None
    style: str = "-"


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes, in the units it is read in, and a strip of residuals below where dots know their model."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...] = ()
    dots: tuple[Dots, ...] = ()
    level: tuple[float, str] | None = None
    """A horizontal line and what it means."""
    from_zero: bool = True
    unit: str = ""
    """Of y and of the residuals."""


@dataclass(frozen=True, slots=True)
class Plot:
    """Panels side by side, `columns` in a row, with a legend and a caption; `inches` is the height of one row."""

    title: str
    panels: tuple[Panel, ...]
    caption: str = ""
    columns: int = 1
    inches: float = 2.25

    @property
    def rows(self) -> int:
        return -(-len(self.panels) // self.columns)


Block = Words | Grid | Plot


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the appendix."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, slots=True)
class Outcome:
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
    marks: tuple[str, ...]
    """What must be seen on every page: SIMULATED, IMPORTED."""
    first: tuple[Block, ...]
    """The page to sign."""
    appendix: tuple[Section, ...]
    outcomes: tuple[Outcome, ...] = ()
    fingerprint: str = ""
    """Of the hashes of all its run files."""
    code: str = ""
    record: dict[str, object] = field(default_factory=dict)
    """The same for machines, SI units."""

    @property
    def passed(self) -> bool:
        """Whether everything that was asked of the specimen holds."""
        return all(outcome.verdict == "pass" for outcome in self.outcomes)
