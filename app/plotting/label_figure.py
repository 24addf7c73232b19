"""Printable labels of specimens: QR code, name, batch, serial number and hash of the sheet, a page each (matplotlib)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import segno

from app.identification.specimen_label import SpecimenLabel
from app.plotting.panels import new_figure

INCH_MM = 25.4
MARGIN_MM = 1.5
RESOLUTION_DPI = 600
QUIET_MODULES = 4
"""Free width around the code that ISO/IEC 18004 requires, in modules."""
LINE_HEIGHT = 1.25


def draw_labels(labels: Sequence[SpecimenLabel], size_mm: tuple[float, float], path: Path) -> None:
    """Draw labels into a PDF file with a page each; one label also into a PNG or SVG file.

    Raises:
        OSError: the file cannot be written.
    """
    figures = [_draw(label, size_mm) for label in labels]
    if path.suffix.casefold() != ".pdf":
        (figure,) = figures
        figure.savefig(path, dpi=RESOLUTION_DPI)
        return
    from matplotlib.backends.backend_pdf import PdfPages

    with PdfPages(path, metadata={"Title": "Labels of specimens", "CreationDate": None}) as pages:
        for figure in figures:
            pages.savefig(figure)


def _draw(label: SpecimenLabel, size_mm: tuple[float, float]) -> Any:
    width, height = size_mm
    figure = new_figure(figsize=(width / INCH_MM, height / INCH_MM))
    code = segno.make(label.text, micro=False, error="m")
    modules = np.array([[bool(each) for each in row] for row in code.matrix_iter(border=QUIET_MODULES)])
    side = min(height, width / 2)
    axes = figure.add_axes((0, (height - side) / 2 / height, side / width, side / height))
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
    _write_lines(figure, lines, (side, width - MARGIN_MM), size_mm)
    return figure


def _write_lines(
    figure: Any, lines: Sequence[tuple[str, float, str]], span_mm: tuple[float, float], size_mm: tuple[float, float]
) -> None:
    """Write lines of relative sizes at the middle of the label, as large as width and height allow."""
    width, height = size_mm
    left, right = span_mm
    room = (height - 2 * MARGIN_MM) / (LINE_HEIGHT * sum(size for _, size, _ in lines))
    # a character of DejaVu Sans is at most about 0.7 of its size wide, a bold one 0.8
    widest = max(len(text) * size * (0.8 if weight == "bold" else 0.68) for text, size, weight in lines)
    unit = min(room, (right - left) / widest, 4.0)
    y = height / 2 + LINE_HEIGHT * unit * sum(size for _, size, _ in lines) / 2
    for text, size, weight in lines:
        y -= LINE_HEIGHT * unit * size
        figure.text(
            left / width,
            (y + 0.3 * unit * size) / height,
            text,
            fontsize=unit * size * 72 / INCH_MM,
            weight=weight,
            parse_math=False,
        )
