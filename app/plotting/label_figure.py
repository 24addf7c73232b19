"""Printable labels of specimens: QR code, name, batch, serial number and hash of the sheet; a page each, or A4 sheets (matplotlib)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import segno

from app.identification import SpecimenLabel
from app.plotting.panels import new_figure

INCH_MM = 25.4
MARGIN_MM = 1.5
RESOLUTION_DPI = 600
QUIET_MODULES = 4
"""Free width around the code that ISO/IEC 18004 requires, in modules."""
LINE_HEIGHT = 1.25


A4_MM = (210.0, 297.0)
ROUNDING_MM = 0.05
"""Makers of sheets round their sizes: three labels of 70 mm still fit on 210 mm."""


def draw_labels(labels: Sequence[SpecimenLabel], size_mm: tuple[float, float], path: Path) -> None:
    """Draw labels into a PDF file with a page each; one label also into a PNG or SVG file.

    Raises:
        OSError: the file cannot be written.
    """
    figures = []
    for label in labels:
        figures.append(_page(size_mm))
        _draw(figures[-1], label, size_mm, (0.0, 0.0))
    if path.suffix.casefold() != ".pdf":
        (figure,) = figures
        figure.savefig(path, dpi=RESOLUTION_DPI)
        return
    _save(figures, path)


def draw_label_sheets(
    labels: Sequence[SpecimenLabel],
    size_mm: tuple[float, float],
    gap_mm: tuple[float, float],
    used: int,
    path: Path,
) -> int:
    """Draw labels onto A4 sheets, as many as fit, in the middle of the sheet; return the number of labels on a sheet.

    Args:
        labels: in the order of the places.
        size_mm: width and height of a label.
        gap_mm: between two labels, across and down.
        used: places of the first sheet that are left free, row by row from the top left.
        path: of the PDF file.

    Raises:
        ValueError: not one label fits.
        OSError: the file cannot be written.
    """
    columns, rows = (
        int((page + gap + ROUNDING_MM) // (each + gap)) for page, each, gap in zip(A4_MM, size_mm, gap_mm, strict=True)
    )
    if not columns * rows:
        raise ValueError(f"a label of {size_mm[0]:g} x {size_mm[1]:g} mm does not fit on A4")
    left, top = (
        (page - count * each - (count - 1) * gap) / 2
        for page, each, gap, count in zip(A4_MM, size_mm, gap_mm, (columns, rows), strict=True)
    )
    figures: list[Any] = []
    for place, label in enumerate(labels, start=used):
        at = place % (columns * rows)
        if not figures or at == 0:
            figures.append(_page(A4_MM))
        row, column = divmod(at, columns)
        x = left + column * (size_mm[0] + gap_mm[0])
        y = A4_MM[1] - top - (row + 1) * size_mm[1] - row * gap_mm[1]
        _draw(figures[-1], label, size_mm, (x, y))
    _save(figures, path)
    return columns * rows


def _page(size_mm: tuple[float, float]) -> Any:
    return new_figure(figsize=(size_mm[0] / INCH_MM, size_mm[1] / INCH_MM))


def _save(figures: Sequence[Any], path: Path) -> None:
    from matplotlib.backends.backend_pdf import PdfPages

    with PdfPages(path, metadata={"Title": "Labels of specimens", "CreationDate": None}) as pages:
        for figure in figures:
            pages.savefig(figure)


def _draw(figure: Any, label: SpecimenLabel, size_mm: tuple[float, float], corner_mm: tuple[float, float]) -> None:
    """Draw a label with its lower left corner at a place of the page."""
    width, height = size_mm
    page = [INCH_MM * inches for inches in figure.get_size_inches()]
    code = segno.make(label.text, micro=False, error="m")
    modules = np.array([[bool(each) for each in row] for row in code.matrix_iter(border=QUIET_MODULES)])
    side = min(height, width / 2)
    x, y = corner_mm[0] / page[0], (corner_mm[1] + (height - side) / 2) / page[1]
    axes = figure.add_axes((x, y, side / page[0], side / page[1]))
    axes.set_axis_off()
    axes.imshow(~modules, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    lines = [(label.specimen, 1.7, "bold")]
    lines += [
        (text, 1.0, "normal")
        for text in (
            label.batch and f"batch {label.batch}",
            label.serial and f"serial {label.serial}",
            label.sheet_hash and f"#{label.sheet_hash}",
        )
        if text
    ]
    _write_lines(figure, lines, (side, width - MARGIN_MM), height, corner_mm)


def _write_lines(
    figure: Any,
    lines: Sequence[tuple[str, float, str]],
    span_mm: tuple[float, float],
    height_mm: float,
    corner_mm: tuple[float, float],
) -> None:
    """Write lines of relative sizes at the middle of the label, as large as width and height allow."""
    page = [INCH_MM * inches for inches in figure.get_size_inches()]
    left, right = span_mm
    room = (height_mm - 2 * MARGIN_MM) / (LINE_HEIGHT * sum(size for _, size, _ in lines))
    # a character of DejaVu Sans is at most about 0.7 of its size wide, a bold one 0.8
    widest = max(len(text) * size * (0.8 if weight == "bold" else 0.68) for text, size, weight in lines)
    unit = min(room, (right - left) / widest, 4.0)
    y = height_mm / 2 + LINE_HEIGHT * unit * sum(size for _, size, _ in lines) / 2
    for text, size, weight in lines:
        y -= LINE_HEIGHT * unit * size
        figure.text(
            (corner_mm[0] + left) / page[0],
            (corner_mm[1] + y + 0.3 * unit * size) / page[1],
            text,
            fontsize=unit * size * 72 / INCH_MM,
            weight=weight,
            parse_math=False,
        )
