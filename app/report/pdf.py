"""PDF report: layout of text, tables and drawings on A4 pages (reportlab).

All lengths are in points unless named otherwise.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.utils import ImageReader
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import (
    BaseDocTemplate,
    CondPageBreak,
    Flowable,
    Frame,
    KeepTogether,
    NextPageTemplate,
    PageBreak,
    PageTemplate,
    Spacer,
)
from reportlab.platypus import Paragraph as TextLines
from reportlab.platypus import Table as Grid

from app.common import Table, sentence_case
from app.plotting import ReportPlot, VectorDrawing, embedded_font, legend_height_in, matplotlib_folder
from app.report.document import MARGIN_IN, PAGE_IN, WIDTH_IN, Block, Paragraph, Photograph, Report, ReportSection
from app.report.drawings import Drawings
from protocols.base import replacing

INCH = 72.0
PAGE, LEFT, WIDTH = (INCH * PAGE_IN[0], INCH * PAGE_IN[1]), INCH * MARGIN_IN, INCH * WIDTH_IN
TOP, BOTTOM = 0.75 * INCH, 0.7 * INCH
SIGNATURE_HEIGHT = 0.5 * INCH
"""Height reserved at the bottom of the first page."""
LOGO = (1.6 * INCH, 0.6 * INCH)
"""Largest width and height of the laboratory's picture."""
MIN_PLOT_HEIGHT_IN, MIN_SKIN_HEIGHT_IN = 1.0, 0.9
"""Smallest height of a plot on the first page, and of the last plot of the second."""
LOW_PLOT_IN = 1.9
"""Height of a plot below which a strip of residuals would leave too little of it."""
TITLE_SIZES = (18, 16, 14, 12)
"""Of the heading: the largest one in which it is one line."""
SECTION_SPACE = 1.5 * INCH
"""A section begins on a new page where less is left."""
LINE_SPACING, TABLE_SPACING = 1.25, 1.15
"""Ratio of line height to font size, of texts and of tables."""
COLUMN_GAP = 0.12 * INCH
SHRINK_STEP = 0.05 * INCH
MOST_BALANCED_ROWS = 40
"""Rows of a table whose columns are shrunk by the number of lines; a longer one takes too long."""
MAX_FONT = MIN_FONT = 8.0
"""Of tables; nothing is smaller."""
RED, GREY = "#C00018", "#444444"
TONE_STYLES = {"plain": ("#000000", ""), "good": ("#006030", "-Bold"), "bad": ("#B00018", "-Bold"), "small": (GREY, "")}
text_width = lru_cache(maxsize=1 << 14)(stringWidth)
"""Width of a text in a font of a size; the layout of a table asks for the same ones again and again."""
REST_OF_FOOTER = "footer"
"""Footer behind the page number, drawn last, with the number of pages."""


@cache
def font(style: str = "") -> str:
    """Return reportlab's name of matplotlib's DejaVu font in a style: "-Bold", "Mono" or none."""
    return embedded_font(f"{matplotlib_folder()}/mpl-data/fonts/ttf/DejaVuSans{style}.ttf")


def write_pdf(report: Report, drawings: Drawings, path: Path) -> None:
    """Write the report.

    Raises:
        OSError: it cannot be written; an existing file is unchanged then.
    """
    with replacing(path) as working:
        document = BaseDocTemplate(
            str(working), pagesize=PAGE, title=" - ".join((report.title, *report.page_marks)), creator=report.software_version, invariant=1,
            pageCompression=1, author="", subject="",
        )  # fmt: skip
        on_text, on_pictures = partial(_decorate_page, report, True), partial(_decorate_page, report, False)
        document.addPageTemplates(
            [
                PageTemplate("first", [_frame(SIGNATURE_HEIGHT)], onPage=partial(_decorate_first_page, report)),
                PageTemplate("text", [_frame()], onPage=on_text),
                PageTemplate("pictures", [_frame()], onPage=on_pictures),
            ]
        )
        footer = f"of {{}}   fingerprint of the run files {report.fingerprint}   {report.software_version}"
        document.build(list(_flow(report, drawings)), canvasmaker=partial(_NumberedCanvas, footer))


def fit_first_page(report: Report) -> Report:
    """Return the report with the plots of its first page as high as the space that its other blocks leave; also the last plot, where the rest of its pages leaves it one.

    Low plots of the first page are without the strip of residuals.
    """
    first = _fit_plots(
        report.first_page, [*_headings(report)], PAGE[1] - TOP - BOTTOM - SIGNATURE_HEIGHT, MIN_PLOT_HEIGHT_IN
    )
    first = tuple(
        block.without_residuals() if isinstance(block, ReportPlot) and block.row_height_in < LOW_PLOT_IN else block
        for block in first
    )
    report = replace(report, first_page=first)
    if not report.appendix or report.appendix[-1].own_page:
        return report
    *before, last = report.appendix
    others = [part for section in before for part in (*_section(section, None), Spacer(0, 6))] + [_section_title(last)]
    fitted = _fit_plots(last.blocks, others, PAGE[1] - TOP - BOTTOM, MIN_SKIN_HEIGHT_IN, titled=False)
    return replace(report, appendix=(*before, replace(last, blocks=fitted)))


def _fit_plots(
    blocks: Sequence[Block], others: list[Any], available: float, smallest_in: float, titled: bool = True
) -> tuple[Block, ...]:
    """Return the blocks with plots of the height that `others` and the other blocks leave of an available height, no higher than they are.

    Where the smallest height does not fit either, as in a report of many pages, the plots of an appendix stay as they are.
    """
    plots = [block for block in blocks if isinstance(block, ReportPlot)]
    for block in blocks:
        others += _plot_texts(block)[not titled :] if isinstance(block, ReportPlot) else _block(block, None)
    left_in = (available - _height(others)) / INCH / max(len(plots), 1)

    def height_in(plot: ReportPlot) -> float:
        fitting = (left_in - legend_height_in(plot) - 0.05) / plot.rows
        return plot.row_height_in if fitting < smallest_in and not titled else max(fitting, smallest_in)

    return tuple(
        replace(b, row_height_in=min(height_in(b), b.row_height_in)) if isinstance(b, ReportPlot) else b for b in blocks
    )


def _height(parts: Sequence[Any]) -> float:
    return float(sum(each.wrap(WIDTH, 1e6)[1] + each.getSpaceBefore() + each.getSpaceAfter() for each in parts))


def _frame(reserved: float = 0.0) -> Any:
    height = PAGE[1] - TOP - BOTTOM - reserved
    return Frame(LEFT, BOTTOM + reserved, WIDTH, height, leftPadding=0, rightPadding=0, topPadding=0, bottomPadding=0)


class _NumberedCanvas(Canvas):  # type: ignore[misc]
    """Canvas that adds the number of pages to every footer when it is saved."""

    def __init__(self, rest: str, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._rest = rest

    def save(self) -> None:
        self.beginForm(REST_OF_FOOTER, 0, -8, PAGE[0], 8)  # a form is clipped to its box: descenders are below 0
        self.setFillColor(GREY)
        self.setFont(font(), 8)
        self.drawString(0, 0, self._rest.format(self.getPageNumber() - 1))
        self.endForm()
        super().save()


class _Picture(Flowable):  # type: ignore[misc]
    """A drawing in the flow of the text."""

    def __init__(self, drawing: VectorDrawing) -> None:
        super().__init__()
        self.drawing, self.width, self.height = drawing, drawing.width, drawing.height

    def draw(self) -> None:
        self.drawing.paint(self.canv)


def _pictures(report: Report) -> Iterator[tuple[Any, float, float]]:
    """Yield the pictures beside the heading, from the right, with width and height."""
    photographs = (block.data for block in report.first_page if isinstance(block, Photograph))
    for data in filter(None, (report.logo, *photographs)):
        picture = ImageReader(BytesIO(data))
        width, height = picture.getSize()
        scale = min(LOGO[0] / width, LOGO[1] / height)
        yield picture, scale * width, scale * height


def _decorate_first_page(report: Report, canvas: Any, document: Any) -> None:
    right = PAGE[0] - LEFT
    for picture, width, height in _pictures(report):
        canvas.drawImage(picture, right - width, PAGE[1] - TOP - height + 0.1 * INCH, width, height, mask="auto")
        right -= width + COLUMN_GAP
    step = WIDTH / len(report.signatures)
    for at, text in enumerate(report.signatures):
        x = LEFT + at * step
        _write(canvas, x, BOTTOM, shorten(text, step - COLUMN_GAP), 8.5)
        canvas.setLineWidth(0.5)
        canvas.line(x, BOTTOM + 12, x + step - COLUMN_GAP, BOTTOM + 12)
    _decorate_page(report, True, canvas, document)


def _decorate_page(report: Report, marked: bool, canvas: Any, _: Any) -> None:
    """Draw header, footer and, on a page without pictures that are `marked` themselves, the marks across it."""
    top = PAGE[1] - 0.5 * INCH
    _write(canvas, LEFT, top, report.title, 8, color=GREY)
    _write(canvas, LEFT, top + 0.18 * INCH, report.laboratory.header, 8, color=GREY)
    _write(canvas, LEFT, 0.27 * INCH, report.laboratory.footer, 8, color=GREY)
    marks = "  ".join(report.page_marks)
    _write(canvas, PAGE[0] - LEFT - text_width(marks, font("-Bold"), 9), top, marks, 9, "-Bold", RED)
    number = f"page {canvas.getPageNumber()} "
    _write(canvas, LEFT, 0.42 * INCH, number, 8, color=GREY)
    canvas.saveState()
    canvas.translate(LEFT + text_width(number, font(), 8), 0.42 * INCH)
    canvas.doForm(REST_OF_FOOTER)
    canvas.restoreState()
    if not (marked and report.page_marks):
        return
    size = 64 if len(max(report.page_marks, key=len)) < 12 else 44
    canvas.saveState()
    canvas.translate(PAGE[0] / 2, PAGE[1] / 2)
    canvas.rotate(25)
    canvas.setFillColorRGB(1, 0, 0, alpha=0.12)
    canvas.setFont(font(), size)
    for i, mark in enumerate(report.page_marks):
        canvas.drawCentredString(0, -size * (i + 0.5 - len(report.page_marks) / 2) * LINE_SPACING, mark)
    canvas.restoreState()


def shorten(text: str, width: float, size: float = 8.5) -> str:
    """Return a text that fits one line of a width; without its end if it is longer."""
    return text if text_width(text, font(), size) <= width else f"{wrap_text(text, width - 10, size, font())[0]} …"


def _write(canvas: Any, x: float, y: float, text: str, size: float, style: str = "", color: str = "#000000") -> None:
    if text:
        canvas.setFont(font(style), size)
        canvas.setFillColor(color)
        canvas.drawString(x, y, text)


def _flow(report: Report, drawings: Drawings) -> Iterator[Any]:
    """Yield everything in its order."""
    plots = iter(drawings.plots)
    yield NextPageTemplate("text")
    yield from _headings(report)
    for block in report.first_page:
        yield from _block(block, plots)
    for at, section in enumerate(report.appendix):
        yield from (PageBreak(),) if at == 0 or section.own_page else (CondPageBreak(SECTION_SPACE), Spacer(0, 6))
        yield from _section(section, plots)
    if drawings.runs:
        yield NextPageTemplate("pictures")
    for name, drawing in drawings.runs:
        yield PageBreak()
        yield _lines(f"Run {name}", 8)
        yield _Picture(drawing)


def _section(section: ReportSection, plots: Iterator[Sequence[VectorDrawing]] | None) -> Iterator[Any]:
    """Yield title and blocks of a section; without drawings, space in place of its plots."""
    yield _section_title(section)
    for number, block in enumerate(section.blocks):
        named = number > 0 or not isinstance(block, Table | ReportPlot)
        yield from _block(block, plots, titled=named or section.own_page)


def _section_title(section: ReportSection) -> Any:
    return _lines(section.title, 11.5, "-Bold", after=4, keep=True)


def _headings(report: Report) -> Iterator[Any]:
    if report.laboratory.name:
        yield _lines(report.laboratory.name, 10, "-Bold", after=3)
    pictures = sum(width + COLUMN_GAP for _, width, _ in _pictures(report))
    fitting = (size for size in TITLE_SIZES if text_width(report.title, font("-Bold"), size) <= WIDTH - pictures)
    yield _lines(report.title, next(fitting, TITLE_SIZES[-1]), "-Bold", after=4, right=pictures)


def _block(block: Block, plots: Iterator[Sequence[VectorDrawing]] | None, titled: bool = True) -> list[Any]:
    """Return a block in the flow of the text; not `titled`: without the title of a plot or table, whose section has one.

    Without drawings, `plots` None, space stands in the place of a plot.
    """
    match block:
        case Paragraph():
            color, style = TONE_STYLES[block.tone]
            return [_lines(block.text, 8.5, style, color)]
        case ReportPlot():
            title, *caption = _plot_texts(block)
            if plots is None:
                height_in = block.row_height_in * block.rows + legend_height_in(block)
                return [*([title] if titled else ()), Spacer(0, INCH * height_in), *caption]
            first, *others = next(plots)
            return [
                KeepTogether([title, _Picture(first)] if titled else [_Picture(first)]),
                *map(_Picture, others),
                *caption,
            ]
        case Photograph():
            return []  # beside the heading of the page
        case Table() if block.vertical:
            rows = zip(map(sentence_case, block.headings), block.text_rows[0], strict=True)
            return [_grid(Table.of_rows(block.title, ("", ""), tuple(rows)), headed=False), Spacer(0, 4)]
        case Table():
            note = [_lines(block.note, 8, color=GREY)] if block.note else []
            title = _lines(block.title, 9.5, "-Bold", before=5, after=2, keep=True)
            return [*([title] if titled else ()), _grid(block), Spacer(0, 2), *note, Spacer(0, 3)]


def _plot_texts(plot: ReportPlot) -> list[Any]:
    caption = [_lines(plot.caption, 8, color=GREY, after=6)] if plot.caption else []
    return [_lines(plot.title, 9.5, "-Bold", after=2, keep=True), *caption]


def _lines(
    text: str, size: float, style: str = "", color: str = "#000000", after: float = 4, before: float = 0, keep: bool = False, right: float = 0
) -> Any:  # fmt: skip
    look = ParagraphStyle(
        "", fontName=font(style), fontSize=size, leading=LINE_SPACING * size, textColor=color, spaceBefore=before,
        spaceAfter=after, keepWithNext=keep, rightIndent=right,
    )  # fmt: skip
    return TextLines(escape(text), look)


def _grid(table: Table, headed: bool = True) -> Any:
    """Return a table in the flow of the text; not `headed`: without its headings, and with names in its first column."""
    laid_out = lay_out_table(table, WIDTH)
    size = laid_out.font_size
    style: list[tuple[Any, ...]] = [
        ("FONT", (0, 0), (-1, -1), font("Mono" if table.monospace else ""), size, TABLE_SPACING * size),
        ("FONT", (0, 0), (-1, 0) if headed else (0, -1), font("-Bold"), size, TABLE_SPACING * size),
        ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ("LEFTPADDING", (0, 0), (-1, -1), 0),
        ("RIGHTPADDING", (0, 0), (-1, -1), 0),
        ("TOPPADDING", (0, 0), (-1, -1), 0.6),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 1.1),
        *([("LINEBELOW", (0, 0), (-1, 0), 0.7, "#888888")] if headed else ()),
        ("LINEBELOW", (0, int(headed)), (-1, -1), 0.3, "#888888"),
    ]
    for row in table.highlighted_rows:
        style.append(("FONT", (0, row + 1), (-1, row + 1), font("-Bold"), size, TABLE_SPACING * size))
        style.append(("TEXTCOLOR", (0, row + 1), (-1, row + 1), RED))
    cells = [["\n".join(lines) for lines in row] for row in laid_out.rows[0 if headed else 1 :]]
    return Grid(cells, laid_out.column_widths, style=style, hAlign="LEFT", repeatRows=int(headed))


@dataclass(frozen=True, slots=True)
class LaidOutTable:
    """A table with font size, column widths with their gaps, and the lines of each cell, row by row."""

    font_size: float
    column_widths: tuple[float, ...]
    rows: tuple[tuple[list[str], ...], ...]


def lay_out_table(table: Table, width: float) -> LaidOutTable:
    """Lay out a table with columns as wide as their content; if too wide, reduce the font size, then wrap cells."""
    every = ([sentence_case(each) for each in table.headings], *table.text_rows)
    plain, wide = (font("Mono"), font("Mono-Bold")) if table.monospace else (font(), font("-Bold"))
    columns = range(len(table.headings))

    def face(row: int, column: int) -> str:
        return wide if row == 0 or row - 1 in table.highlighted_rows or column == 0 else plain

    def widest(texts: Callable[[str], list[str]], i: int) -> float:
        widths = (text_width(text, face(at, i), 1) for at, row in enumerate(every) for text in texts(row[i]))
        return float(max(widths))

    # In ems: a width is proportional to the size.
    natural_ems = [widest(lambda cell: [cell], i) for i in columns]
    word_ems = [widest(lambda cell: cell.split(" "), i) for i in columns]
    available = width - COLUMN_GAP * len(columns)
    size = min(max(available / max(sum(natural_ems), 1e-6), MIN_FONT), MAX_FONT)

    @cache
    def line_counts(column: int, width: float) -> tuple[int, ...]:
        texts = ((row[column], face(at, column)) for at, row in enumerate(every))
        return tuple(len(wrap_text(text, width + 0.5, size, of)) for text, of in texts)

    counted = line_counts if len(every) <= MOST_BALANCED_ROWS else None
    widths = _shrink_columns([size * w for w in natural_ems], [size * w for w in word_ems], available, counted)
    rows = tuple(
        tuple(wrap_text(row[i], widths[i] + 0.5, size, face(at, i)) for i in columns) for at, row in enumerate(every)
    )
    return LaidOutTable(size, tuple(w + COLUMN_GAP for w in widths), rows)


def _shrink_columns(
    natural: Sequence[float],
    min_widths: Sequence[float],
    available: float,
    line_counts: Callable[[int, float], Sequence[int]] | None,
) -> list[float]:
    """Shrink columns until all fit, down to their longest words: the one that adds fewest lines to the table, or else the widest.

    Where the longest words do not fit, long ones are broken.
    """
    widths, equal = list(natural), available / len(natural)
    if sum(min_widths) > available:
        min_widths = [min(low, equal) for low in min_widths]
    while (over := sum(widths) - available) > 1e-6:
        narrower = {
            i: max(w - min(over, SHRINK_STEP), low)
            for i, (w, low) in enumerate(zip(widths, min_widths, strict=True))
            if w > low + 1e-6
        }

        def lines(column: int, shrunk: dict[int, float] = narrower) -> int:
            if line_counts is None:
                return 0
            counts = (line_counts(i, shrunk[i] if i == column else w) for i, w in enumerate(widths))
            return sum(map(max, zip(*counts, strict=True)))

        chosen = min(narrower, key=lambda i: (lines(i), -widths[i]))
        widths[chosen] = narrower[chosen]
    return widths


def wrap_text(text: str, width: float, size: float, face: str) -> list[str]:
    """Wrap a text into lines; words wider than a line are broken anywhere."""
    if text_width(text, face, size) <= width:
        return [text]
    lines, line = [], ""
    for each in text.split(" "):
        word = each
        longer = f"{line} {word}" if line else word
        if text_width(longer, face, size) <= width:
            line = longer
            continue
        if line:
            lines.append(line)
        while text_width(word, face, size) > width:
            cut = next((n for n in range(len(word) - 1, 1, -1) if text_width(word[:n], face, size) <= width), 1)
            lines.append(word[:cut])
            word = word[cut:]
        line = word
    return [*lines, line]
