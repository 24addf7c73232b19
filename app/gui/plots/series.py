"""Series of plots: named x and y values as text for the clipboard, and the two amplitudes over frequency."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from PySide6.QtCore import QPointF, QSize, Qt
from PySide6.QtGui import QColor, QIcon, QPainter, QPen, QPixmap

from app.gui.plots.items import linear_data
from model import ERRORS, Array, Series

LEGEND_ICON_SIZE = QSize(46, 14)


@dataclass(frozen=True, slots=True)
class AmplitudeSeries:
    """One of the two amplitudes: its name, symbol and line style, and the attribute that times `factor` gives it in µm."""

    label: str
    symbol: str
    line: Qt.PenStyle
    size_px: int
    column: str
    factor: float

    def values_of(self, source: Any) -> Array:
        """Return the amplitudes of a curve or run, (N,), µm."""
        values = getattr(source, self.column)
        values = values.plotted if isinstance(values, Series) else np.asarray(values)
        return self.factor * (np.abs(values) if np.iscomplexobj(values) else values)

    def errors_of(self, source: Any) -> Array | None:
        """Return their standard errors, µm; None for a curve of the model."""
        values = getattr(source, self.column)
        errors = values.errors if isinstance(values, Series) else getattr(source, self.column + ERRORS, None)
        return None if errors is None else self.factor * np.asarray(errors)


SERIES = (
    AmplitudeSeries("max − min", "o", Qt.PenStyle.SolidLine, 11, "peak_to_peak", 1e6),
    AmplitudeSeries("2 × fundamental", "s", Qt.PenStyle.DashLine, 6, "fundamental", 2e6),
)


def legend_icon(series: AmplitudeSeries, line: str, color: str, ratio: float) -> QIcon:
    """Draw line and symbol as a legend shows them, for a screen with a device pixel ratio."""
    pixmap = QPixmap(LEGEND_ICON_SIZE * ratio)
    pixmap.setDevicePixelRatio(ratio)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(QPen(QColor(line), 1.8, series.line))
    painter.drawLine(QPointF(15, 7), QPointF(45, 7))
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(color))
    if series.symbol == "o":
        painter.drawEllipse(QPointF(6, 7), 4.5, 4.5)
    else:
        painter.drawRect(3, 4, 6, 6)
    painter.end()
    return QIcon(pixmap)


def series_of(name: str, item: Any, bars: Any = None) -> Iterable[Series]:
    """Yield the series of a plot item with its error bars; nothing if the item is hidden or empty."""
    x, y = linear_data(item)
    if item.isVisible() and x is not None and len(x):
        errors = None if bars is None else bars.errors
        yield Series(np.asarray(x, float) + item.pos().x(), np.asarray(y, float), errors, name=name)


def series_as_text(series: Iterable[Series], x_label: str, y_label: str, simulated: bool) -> str:
    """Return a tab-separated table, as spreadsheets paste it; simulated data begin with a line SIMULATED."""
    lines = ["SIMULATED"] if simulated else []
    lines.append(f"series\t{x_label}\t{y_label}\tstandard error")
    for one in series:
        errors = one.total_errors if one.errors is None else one.errors
        errors = np.full(one.x.size, np.nan) if errors is None else errors
        lines += [
            f"{one.title}\t{x:.10g}\t{y:.10g}\t{'' if np.isnan(error) else f'{error:.6g}'}"
            for x, y, error in zip(one.x, one.y, errors, strict=True)
            if np.isfinite(x) and np.isfinite(y)
        ]
    return "\n".join(lines) + "\n"
