"""The report as PDF: A4 pages that are filled from the top, then one page for every run.

How wide text is, where its lines break, and how wide the columns of a table must be; in inches.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from app.report.charts import LEGEND, draw
from app.report.document import Block, Grid, Plot, Report, Words

LINE = 1.32
"""Line height over letter size."""
GAP = 0.12
"""Between two columns."""
STEP = 0.05
LARGEST, SMALLEST = 8.0, 6.0


@dataclass(frozen=True, slots=True)
class Row:
    """A table's row: the lines of each cell."""

    cells: tuple[tuple[str, ...], ...]
    height: float


@dataclass(frozen=True, slots=True)
class Set:
    """A table as it is set."""

    size: float
    left: tuple[float, ...]
    rows: tuple[Row, ...]

    @property
    def height(self) -> float:
        return sum(row.height for row in self.rows)


@lru_cache(maxsize=20_000)
def width_of(text: str, size: float, weight: str = "normal", family: str = "sans-serif") -> float:
    """Inches."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    if not text:
        return 0.0
    prop = FontProperties(family=family, weight=weight, size=size)
    return float(text_to_path.get_text_width_height_descent(text, prop, False)[0]) / 72


def height_of(size: float) -> float:
    """Of one line, inches."""
    return LINE * size / 72


def wrapped(text: str, width: float, size: float, weight: str = "normal", family: str = "sans-serif") -> list[str]:
    """The lines of a text; a word that is wider than a line is broken anywhere."""
    lines, line = [], ""
    for each in text.split(" "):
        word = each
        longer = f"{line} {word}" if line else word
        if width_of(longer, size, weight, family) <= width:
            line = longer
            continue
        if line:
            lines.append(line)
        while width_of(word, size, weight, family) > width:
            cut = next((n for n in range(len(word) - 1, 1, -1) if width_of(word[:n], size, weight, family) <= width), 1)
            lines.append(word[:cut])
            word = word[cut:]
        line = word
    return [*lines, line]


def table_of(grid: Grid, width: float) -> Set:
    """Columns as wide as what stands in them; letters shrink a little and then words break where that is too wide."""
    every = (grid.heads, *grid.rows)
    family = "monospace" if grid.code else "sans-serif"
    columns = range(len(grid.heads))
    size = LARGEST
    while True:
        natural = [max(width_of(row[i], size, "bold", family) for row in every) for i in columns]
        if sum(natural) + GAP * (len(natural) - 1) <= width or size <= SMALLEST:
            break
        size -= 0.5
    least = [max(width_of(word, size, "bold", family) for row in every for word in row[i].split(" ")) for i in columns]
    widths = _squeezed(natural, least, width - GAP * (len(natural) - 1))
    rows = []
    for row in every:
        cells = tuple(
            tuple(wrapped(cell, w + 0.005, size, "bold", family)) for cell, w in zip(row, widths, strict=True)
        )
        rows.append(Row(cells, height_of(size) * max(map(len, cells)) + 0.05))
    left, x = [], 0.0
    for w in widths:
        left.append(x)
        x += w + GAP
    return Set(size, tuple(left), tuple(rows))


def _squeezed(natural: Sequence[float], least: Sequence[float], room: float) -> list[float]:
    """The widest columns give way until all fit, none below its longest word; where that is not enough, all alike."""
    widths = list(natural)
    while (over := sum(widths) - room) > 1e-9:
        free = [i for i, (w, low) in enumerate(zip(widths, least, strict=True)) if w > low + 1e-9]
        if not free:
            return [w * room / sum(widths) for w in widths]
        widest = max(free, key=lambda i: widths[i])
        widths[widest] = max(widths[widest] - min(over, STEP), least[widest])
    return widths


PAGE = (8.27, 11.69)
LEFT, RIGHT, TOP, BOTTOM = 0.75, 0.75, 0.95, 0.75
WIDTH = PAGE[0] - LEFT - RIGHT
TONES = {
    "plain": ("black", "normal"),
    "good": ("#006030", "bold"),
    "bad": ("#B00018", "bold"),
    "small": ("#444444", "normal"),
}
RED = "#C00018"
SIGNATURE = 0.35
"""Room for it at the foot of the first page."""
SIGNED = "Measured by ________________________   Checked by ________________________   Date ______________"
LOWEST = 1.9
"""Inches that a plot needs."""


class Pdf:
    """Writes the report page by page; `close` puts the file in its place, which until then is untouched.

    Raises:
        OSError: it cannot be written.
    """

    def __init__(self, report: Report, path: Path, pictures: int) -> None:
        import matplotlib as mpl
        from matplotlib.backends.backend_pdf import PdfPages

        self._report, self._path, self._working = report, path, path.with_name(f"{path.name}.part")
        title = f"Specimen {report.specimen}" + "".join(f" - {mark}" for mark in report.marks)
        about = {"Title": title, "Creator": report.code, "CreationDate": None, "ModDate": None}
        self._pages = _Flow(report).pages()
        self._of, self._written = len(self._pages) + pictures, 0
        self._look = ExitStack()
        # Fonts as they are: text can be searched and copied. They are written when the file is closed.
        self._look.enter_context(mpl.rc_context({"pdf.fonttype": 42}))
        self._pdf = self._look.enter_context(PdfPages(self._working, metadata=about))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._look.close()
        if kind is None:
            self._working.replace(self._path)
        else:
            self._working.unlink(missing_ok=True)

    def text(self) -> None:
        """The page to sign and the appendix but for the runs."""
        for page in self._pages:
            self._write(page)

    def picture(self, name: str, figure: Any) -> None:
        """A run's own page: a figure that `laid_out` has put in its place."""
        _text(figure, LEFT, PAGE[1] - TOP + 0.12, f"Run {name}", size=8)
        self._write(figure)

    def _write(self, page: Any) -> None:
        self._written += 1
        _headed(page, self._report, f"page {self._written} of {self._of}")
        self._pdf.savefig(page)


def page_to_sign(report: Report) -> Any:
    """The first page, as a matplotlib figure."""
    page = _Flow(report).pages()[0]
    _headed(page, report, "page 1")
    return page


def _headed(page: Any, report: Report, number: str) -> None:
    """What stands on every page: whose it is, SIMULATED and the like, and which files it belongs to."""
    marked = any(text.get_text() in report.marks for text in page.texts)  # a run's picture says it itself
    top = PAGE[1] - 0.5
    _text(page, LEFT, top, f"Specimen {report.specimen}", size=8, color="#444444")
    _text(page, PAGE[0] - RIGHT, top, "  ".join(report.marks), size=9, color=RED, weight="bold", ha="right")
    foot = f"{number}   fingerprint of the run files {report.fingerprint}   {report.code}"
    _text(page, LEFT, 0.42, foot, size=7, color="#444444")
    if report.marks and not marked:
        page.text(
            0.5, 0.5, "\n".join(report.marks), fontsize=64 if len(max(report.marks, key=len)) < 12 else 44, color="red",
            alpha=0.12, ha="center", va="center", rotation=25,
        )  # fmt: skip


def laid_out(figure: Any) -> Any:
    """A run's picture on a page of its own, its axes where they stay: to be drawn more than once."""
    figure.set_size_inches(*PAGE)
    title = figure.get_suptitle()
    figure.suptitle(title, y=0.915, fontsize=10)
    figure.get_layout_engine().set(rect=(0.07, 0.07, 0.86, 0.82))
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine("none")
    return figure


class _Flow:
    """Sets blocks one below the other and begins a new page where the next does not fit."""

    def __init__(self, report: Report) -> None:
        self._report, self._pages = report, list[Any]()
        self._y, self._bottom = 0.0, BOTTOM

    def pages(self) -> list[Any]:
        """Matplotlib figures, one a page."""
        report = self._report
        self._turn()
        self._say(f"Specimen {report.specimen}", 18, "bold", gap=0.06)
        self._say(report.subtitle, 9, gap=0.14)
        self._bottom = BOTTOM + SIGNATURE
        for block in report.first:
            self._set(self._fitted(block))
        self._bottom = BOTTOM
        _text(self._pages[0], LEFT, BOTTOM, SIGNED, size=9, va="bottom")
        self._turn()
        for section in report.appendix:
            self._room(4.0)
            self._y -= 0.15 if self._y < PAGE[1] - TOP else 0.0
            self._say(section.title, 13, "bold", gap=0.12)
            for block in section.blocks:
                self._set(block)
        return self._pages

    def _turn(self) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        page = Figure(figsize=PAGE)
        FigureCanvasAgg(page)
        self._pages.append(page)
        self._y = PAGE[1] - TOP

    def _fitted(self, block: Block) -> Block:
        """A plot on the page to sign as high as there is room, so that the page is one."""
        if not isinstance(block, Plot):
            return block
        room = self._y - self._bottom - 0.6 - LEGEND - 0.14 * len(wrapped(block.caption, WIDTH, 7.5))
        return replace(block, inches=min(max(room, LOWEST), block.inches))

    def _room(self, inches: float) -> None:
        if self._y - inches < self._bottom and self._y < PAGE[1] - TOP - 0.6:
            self._turn()

    def _set(self, block: Block) -> None:
        match block:
            case Words():
                color, weight = TONES[block.tone]
                self._say(block.text, 8.5, weight, color)
            case Plot():
                self._plot(block)
            case Grid():
                self._grid(block)

    def _say(self, text: str, size: float, weight: str = "normal", color: str = "black", gap: float = 0.06) -> None:
        for line in wrapped(text, WIDTH, size, weight):
            self._room(height_of(size))
            _text(self._pages[-1], LEFT, self._y, line, size=size, weight=weight, color=color, va="top")
            self._y -= height_of(size)
        self._y -= gap

    def _plot(self, plot: Plot) -> None:
        caption = wrapped(plot.caption, WIDTH, 7.5)
        rows = [plot.panels[i : i + plot.columns] for i in range(0, len(plot.panels), plot.columns)]
        self._room(0.26 + plot.inches + 0.14 * len(caption))
        self._say(plot.title, 9.5, "bold", gap=0.03)
        legend = LEGEND  # once a page
        for row in rows:
            pages = len(self._pages)
            self._room(plot.inches + legend)
            height = plot.inches + (legend := LEGEND if len(self._pages) > pages else legend)
            one = Plot(plot.title, row, columns=plot.columns, inches=plot.inches)
            draw(self._pages[-1], one, (LEFT - 0.1, self._y - height, WIDTH + 0.1, height), legend)
            self._y -= height
            legend = 0.0
        self._y -= 0.05
        if plot.caption:
            self._say(plot.caption, 7.5, color="#444444", gap=0.18)

    def _grid(self, grid: Grid) -> None:
        table = table_of(grid, WIDTH)
        note = wrapped(grid.note, WIDTH, 7.5) if grid.note else []
        self._room(min(0.3 + table.height + 0.14 * len(note), 3.0))
        self._y -= 0.06
        self._say(grid.title, 9.5, "bold", gap=0.03)
        for at, row in enumerate(table.rows):
            self._room(row.height)
            page = self._pages[-1]
            bad = at - 1 in grid.bad
            for x, lines in zip(table.left, row.cells, strict=True):
                for i, line in enumerate(lines):
                    _text(
                        page, LEFT + x, self._y - 0.035 - i * height_of(table.size), line, size=table.size, va="top",
                        weight="bold" if at == 0 or bad else "normal", color=RED if bad else "black",
                        family="monospace" if grid.code and at else "sans-serif",
                    )  # fmt: skip
            self._y -= row.height
            page.add_artist(_rule(self._y, 0.7 if at == 0 else 0.3))
        self._y -= 0.06
        if grid.note:
            self._say(grid.note, 7.5, color="#444444")
        self._y -= 0.1


def _rule(y: float, width: float) -> Any:
    from matplotlib.lines import Line2D

    height = y / PAGE[1]
    return Line2D((LEFT / PAGE[0], 1 - RIGHT / PAGE[0]), (height, height), color="#888888", lw=width)


def _text(page: Any, x: float, y: float, text: str, size: float, **look: Any) -> None:
    """Text at inches from the lower left corner; nothing in it is taken for a formula unless it was meant so."""
    page.text(x / PAGE[0], y / PAGE[1], text, fontsize=size, parse_math=False, **look)
