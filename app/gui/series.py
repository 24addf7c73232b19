"""The two ways to state an amplitude over frequency: their names, their symbols, and how a legend shows them."""

from dataclasses import dataclass

from PySide6.QtCore import QPointF, QSize, Qt
from PySide6.QtGui import QColor, QIcon, QPainter, QPen, QPixmap

from protocols.protocol import Protocol

SAMPLE = QSize(46, 14)
"""Size of a legend's sample."""


@dataclass(frozen=True, slots=True)
class Series:
    """One way to state the amplitude: its name, its symbol, its line, and its column times a factor."""

    words: str
    symbol: str
    line: Qt.PenStyle
    size_px: int
    column: str
    factor: float


SERIES = (
    Series("max − min", "o", Qt.PenStyle.SolidLine, 11, "peak_to_peak", 1e6),
    Series("2 × fundamental", "s", Qt.PenStyle.DashLine, 6, "fundamental", 2e6),
)


def draws(kind: type[Protocol]) -> bool:
    """Whether a protocol's points are amplitudes over frequency."""
    return all(hasattr(kind.point_type, series.column) for series in SERIES)


def sample(series: Series, line: str, ink: str, ratio: float) -> QIcon:
    """Symbol and line as a legend shows them, on a screen with `ratio` pixels to a point."""
    pixmap = QPixmap(SAMPLE * ratio)
    pixmap.setDevicePixelRatio(ratio)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(QPen(QColor(line), 1.8, series.line))
    painter.drawLine(QPointF(15, 7), QPointF(45, 7))
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(ink))
    if series.symbol == "o":
        painter.drawEllipse(QPointF(6, 7), 4.5, 4.5)
    else:
        painter.drawRect(3, 4, 6, 6)
    painter.end()
    return QIcon(pixmap)
