"""PDF report: layout of text, tables and plots on A4 pages, and one page for every run (matplotlib).

All lengths are in inches.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from io import BytesIO
from itertools import accumulate, count
from pathlib import Path
from typing import Any

from app.common import Table
from app.plotting.panels import LEGEND_IN, ReportPlot, draw_plot, new_figure
from app.report.document import Block, Paragraph, Report

LINE_SPACING = 1.32
"""Ratio of line height to font size."""
COLUMN_GAP_IN = 0.12
"""Gap between two columns."""
SHRINK_STEP_IN = 0.05
MAX_FONT_PT, MIN_FONT_PT = 8.0, 6.0


@dataclass(frozen=True, slots=True)
class LaidOutTable:
    """A table with font size, column positions and the lines of each cell, row by row."""

    font_size: float
    column_left: tuple[float, ...]
    rows: tuple[tuple[list[str], ...], ...]

    def row_height(self, row: tuple[list[str], ...]) -> float:
        """Return the height of a row in inches."""
        return line_height(self.font_size) * max(map(len, row)) + 0.05


def text_width(text: str, size: float, weight: str = "normal", family: str = "sans-serif") -> float:
    """Return the width of a text in inches."""
    return size * _relative_width(text, weight, family)


@lru_cache(maxsize=20_000)
def _relative_width(text: str, weight: str, family: str) -> float:
    """Return the width of a text in inches for each point of its size."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    if not text:
        return 0.0
    size = 10.0
    prop = FontProperties(family=family, weight=weight, size=size)
    return float(text_to_path.get_text_width_height_descent(text, prop, False)[0]) / 72 / size


def line_height(size: float) -> float:
    """Return the height of one line in inches."""
    return LINE_SPACING * size / 72


def wrap_text(text: str, width: float, size: float, weight: str = "normal", family: str = "sans-serif") -> list[str]:
    """Wrap a text into lines; words wider than a line are broken anywhere."""
    if text_width(text, size, weight, family) <= width:
        return [text]
    lines, line = [], ""
    for each in text.split(" "):
        word = each
        longer = f"{line} {word}" if line else word
        if text_width(longer, size, weight, family) <= width:
            line = longer
            continue
        if line:
            lines.append(line)
        while text_width(word, size, weight, family) > width:
            cut = next(
                (n for n in range(len(word) - 1, 1, -1) if text_width(word[:n], size, weight, family) <= width), 1
            )
            lines.append(word[:cut])
            word = word[cut:]
        line = word
    return [*lines, line]


def lay_out_table(table: Table, width: float) -> LaidOutTable:
    """Lay out a table with columns as wide as their content; if too wide, reduce the font size, then wrap cells."""
    every = (table.headings, *table.text_rows)
    family = "monospace" if table.monospace else "sans-serif"
    columns = range(len(table.headings))
    size = MAX_FONT_PT
    while True:
        natural = [max(text_width(row[i], size, "bold", family) for row in every) for i in columns]
        if sum(natural) + COLUMN_GAP_IN * (len(natural) - 1) <= width or size <= MIN_FONT_PT:
            break
        size -= 0.5
    least = [
        max(text_width(word, size, "bold", family) for row in every for word in row[i].split(" ")) for i in columns
    ]
    widths = _shrink_columns(natural, least, width - COLUMN_GAP_IN * (len(natural) - 1))
    rows = tuple(
        tuple(wrap_text(cell, w + 0.005, size, "bold", family) for cell, w in zip(row, widths, strict=True))
        for row in every
    )
    left = accumulate((w + COLUMN_GAP_IN for w in widths[:-1]), initial=0.0)
    return LaidOutTable(size, tuple(left), rows)


def _shrink_columns(natural: Sequence[float], min_widths: Sequence[float], available: float) -> list[float]:
    """Shrink the widest columns until all fit, down to their longest words; then shrink all in proportion."""
    widths = list(natural)
    while (over := sum(widths) - available) > 1e-9:
        free = [i for i, (w, low) in enumerate(zip(widths, min_widths, strict=True)) if w > low + 1e-9]
        if not free:
            return [w * available / sum(widths) for w in widths]
        widest = max(free, key=lambda i: widths[i])
        widths[widest] = max(widths[widest] - min(over, SHRINK_STEP_IN), min_widths[widest])
    return widths


PAGE = (8.27, 11.69)
LEFT, RIGHT, TOP, BOTTOM = 0.75, 0.75, 0.95, 0.75
WIDTH = PAGE[0] - LEFT - RIGHT
TONE_STYLES = {
    "plain": ("black", "normal"),
    "good": ("#006030", "bold"),
    "bad": ("#B00018", "bold"),
    "small": ("#444444", "normal"),
}
RED = "#C00018"
SIGNATURE_HEIGHT_IN = 0.35
"""Height reserved at the bottom of the first page."""
LOGO_IN = (1.6, 0.6)
"""Largest width and height of the laboratory's picture."""
MIN_PLOT_HEIGHT_IN = 1.9
"""Smallest height of a plot."""


@contextmanager
def pdf_report(report: Report, path: Path, pictures: int) -> Iterator[Callable[[str, Any], None]]:
    """Write the text pages and yield a function that adds the page of a run, laid out by `lay_out_figure`.

    The pages go to a temporary file, which replaces the report at the end, or is deleted after an exception.

    Raises:
        OSError: it cannot be written.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_pdf import PdfPages

    partial_path = path.with_name(f"{path.name}.part")
    title = f"Specimen {report.specimen}" + "".join(f" - {mark}" for mark in report.page_marks)
    about = {"Title": title, "Creator": report.software_version, "CreationDate": None, "ModDate": None}
    pages = _PageFlow(report).pages()
    numbers = count(1)

    def write(page: Any) -> None:
        _draw_page_header(page, report, f"page {next(numbers)} of {len(pages) + pictures}")
        pdf.savefig(page)

    def add_picture(name: str, figure: Any) -> None:
        _draw_text(figure, LEFT, PAGE[1] - TOP + 0.12, f"Run {name}", size=8)
        write(figure)

    try:
        # TrueType fonts keep text searchable; they are written when the file is closed.
        with mpl.rc_context({"pdf.fonttype": 42}), PdfPages(partial_path, metadata=about) as pdf:
            for page in pages:
                write(page)
            yield add_picture
        partial_path.replace(path)
    finally:
        partial_path.unlink(missing_ok=True)


def signature_page(report: Report) -> Any:
    """Return the first page as a matplotlib figure."""
    page = _PageFlow(report).pages()[0]
    _draw_page_header(page, report, "page 1")
    return page


def _draw_page_header(page: Any, report: Report, number: str) -> None:
    """Draw header and footer: specimen, marks such as SIMULATED, page number and fingerprint."""
    marked = any(text.get_text() in report.page_marks for text in page.texts)  # pictures of runs are marked already
    top = PAGE[1] - 0.5
    _draw_text(page, LEFT, top, f"Specimen {report.specimen}", size=8, color="#444444")
    _draw_text(page, PAGE[0] - RIGHT, top, "  ".join(report.page_marks), size=9, color=RED, weight="bold", ha="right")
    _draw_text(page, LEFT, top + 0.18, report.header, size=8, color="#444444")
    _draw_text(page, LEFT, 0.27, report.footer, size=7, color="#444444")
    foot = f"{number}   fingerprint of the run files {report.fingerprint}   {report.software_version}"
    _draw_text(page, LEFT, 0.42, foot, size=7, color="#444444")
    if report.page_marks and not marked:
        page.text(
            0.5, 0.5, "\n".join(report.page_marks), fontsize=64 if len(max(report.page_marks, key=len)) < 12 else 44, color="red",
            alpha=0.12, ha="center", va="center", rotation=25,
        )  # fmt: skip


def lay_out_figure(figure: Any) -> Any:
    """Lay out a run's picture on a page and freeze the layout, as it is drawn more than once."""
    figure.set_size_inches(*PAGE)
    title = figure.get_suptitle()
    figure.suptitle(title, y=0.915, fontsize=10)
    figure.get_layout_engine().set(rect=(0.07, 0.07, 0.86, 0.82))
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine("none")
    return figure


class _PageFlow:
    """Places blocks below each other and starts a new page when the next one does not fit."""

    def __init__(self, report: Report) -> None:
        self._report, self._pages = report, list[Any]()
        self._y, self._bottom = 0.0, BOTTOM

    def pages(self) -> list[Any]:
        """Return matplotlib figures, one per page."""
        report = self._report
        self._new_page()
        if report.logo:
            _draw_logo(self._pages[0], report.logo)
        if report.laboratory:
            self._add_text(report.laboratory, 10, "bold", gap=0.04)
        self._add_text(f"Specimen {report.specimen}", 18, "bold", gap=0.06)
        self._add_text(report.subtitle, 9, gap=0.14)
        self._bottom = BOTTOM + SIGNATURE_HEIGHT_IN
        for block in report.first_page:
            self._add_block(self._fit_to_page(block))
        self._bottom = BOTTOM
        _draw_text(self._pages[0], LEFT, BOTTOM, _signature_text(report.signed_by), size=9, va="bottom")
        self._new_page()
        for section in report.appendix:
            self._require_space(4.0)
            self._y -= 0.15 if self._y < PAGE[1] - TOP else 0.0
            self._add_text(section.title, 13, "bold", gap=0.12)
            for block in section.blocks:
                self._add_block(block)
        return self._pages

    def _new_page(self) -> None:
        self._pages.append(new_figure(figsize=PAGE))
        self._y = PAGE[1] - TOP

    def _fit_to_page(self, block: Block) -> Block:
        """Limit the height of a plot to the space left, so that the signed page is one page."""
        if not isinstance(block, ReportPlot):
            return block
        space = self._y - self._bottom - 0.6 - LEGEND_IN - 0.14 * len(wrap_text(block.caption, WIDTH, 7.5))
        return replace(block, row_height_in=min(max(space, MIN_PLOT_HEIGHT_IN), block.row_height_in))

    def _require_space(self, inches: float) -> None:
        if self._y - inches < self._bottom and self._y < PAGE[1] - TOP - 0.6:
            self._new_page()

    def _add_block(self, block: Block) -> None:
        match block:
            case Paragraph():
                color, weight = TONE_STYLES[block.tone]
                self._add_text(block.text, 8.5, weight, color)
            case ReportPlot():
                self._add_plot(block)
            case Table():
                self._add_table(block)

    def _add_text(
        self, text: str, size: float, weight: str = "normal", color: str = "black", gap: float = 0.06
    ) -> None:
        for line in wrap_text(text, WIDTH, size, weight):
            self._require_space(line_height(size))
            _draw_text(self._pages[-1], LEFT, self._y, line, size=size, weight=weight, color=color, va="top")
            self._y -= line_height(size)
        self._y -= gap

    def _add_plot(self, plot: ReportPlot) -> None:
        caption = wrap_text(plot.caption, WIDTH, 7.5)
        rows = [plot.panels[i : i + plot.columns] for i in range(0, len(plot.panels), plot.columns)]
        self._require_space(0.26 + plot.row_height_in + 0.14 * len(caption))
        self._add_text(plot.title, 9.5, "bold", gap=0.03)
        legend = LEGEND_IN  # once a page
        for row in rows:
            pages = len(self._pages)
            self._require_space(plot.row_height_in + legend)
            height = plot.row_height_in + (legend := LEGEND_IN if len(self._pages) > pages else legend)
            one = ReportPlot(plot.title, row, columns=plot.columns, row_height_in=plot.row_height_in)
            draw_plot(self._pages[-1], one, (LEFT - 0.1, self._y - height, WIDTH + 0.1, height), legend)
            self._y -= height
            legend = 0.0
        self._y -= 0.05
        if plot.caption:
            self._add_text(plot.caption, 7.5, color="#444444", gap=0.18)

    def _add_table(self, block: Table) -> None:
        table = lay_out_table(block, WIDTH)
        note = wrap_text(block.note, WIDTH, 7.5) if block.note else []
        height = sum(map(table.row_height, table.rows))
        self._require_space(min(0.3 + height + 0.14 * len(note), 3.0))
        self._y -= 0.06
        self._add_text(block.title, 9.5, "bold", gap=0.03)
        for at, row in enumerate(table.rows):
            self._require_space(table.row_height(row))
            page = self._pages[-1]
            bad = at - 1 in block.highlighted_rows
            for x, lines in zip(table.column_left, row, strict=True):
                for i, line in enumerate(lines):
                    _draw_text(
                        page, LEFT + x, self._y - 0.035 - i * line_height(table.font_size), line, size=table.font_size, va="top",
                        weight="bold" if at == 0 or bad else "normal", color=RED if bad else "black",
                        family="monospace" if block.monospace and at else "sans-serif",
                    )  # fmt: skip
            self._y -= table.row_height(row)
            page.add_artist(_draw_rule(self._y, 0.7 if at == 0 else 0.3))
        self._y -= 0.06
        if block.note:
            self._add_text(block.note, 7.5, color="#444444")
        self._y -= 0.1


def _signature_text(signed_by: str) -> str:
    who = f"Signed by {signed_by}" if signed_by else "Measured by ________________________"
    return f"{who}   Checked by ________________________   Date ______________"


def _draw_logo(page: Any, png: bytes) -> None:
    """Draw a picture at the top right of the text, within `LOGO_IN`."""
    from matplotlib.image import imread

    picture = imread(BytesIO(png), format="png")
    height, width = picture.shape[:2]
    scale = min(LOGO_IN[0] / width, LOGO_IN[1] / height)
    size = (scale * width, scale * height)
    left, bottom = PAGE[0] - RIGHT - size[0], PAGE[1] - TOP - size[1] + 0.1
    axes = page.add_axes((left / PAGE[0], bottom / PAGE[1], size[0] / PAGE[0], size[1] / PAGE[1]))
    axes.imshow(picture)
    axes.set_axis_off()


def _draw_rule(y: float, width: float) -> Any:
    from matplotlib.lines import Line2D

    height = y / PAGE[1]
    return Line2D((LEFT / PAGE[0], 1 - RIGHT / PAGE[0]), (height, height), color="#888888", lw=width)


def _draw_text(page: Any, x: float, y: float, text: str, size: float, **style: Any) -> None:
    """Draw text at inches from the lower left corner; `$` is not parsed as math."""
    page.text(x / PAGE[0], y / PAGE[1], text, fontsize=size, parse_math=False, **style)
