"""Status signs readable from two metres: symbol, text in the largest size that fits, note."""

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFont, QFontMetricsF, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.gui.status.symbols import SYMBOLS

LARGEST_PX, SMALLEST_PX = 110, 11
NOTE_SHARE = 0.30
"""Of the sign's height."""

TWO_LINE_HEIGHT = 64
"""Least height of a sign in which a note may take two lines."""


class StatusSign(QWidget):
    """Paints a text in the largest type that fits; on two lines where that is larger."""

    def __init__(self, width: int, least_width: int) -> None:
        super().__init__()
        self.text, self.note, self._symbol = "", "", ""
        self._background, self._foreground = "#808080", "#ffffff"
        self._striped = False
        self._width, self._least_width = width, least_width
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Expanding)

    def set_content(self, text: str, note: str = "", symbol: str = "") -> None:
        """Set the text, the note below it and the symbol."""
        if (text, note, symbol) != (self.text, self.note, self._symbol):
            self.text, self.note, self._symbol = text, note, symbol
            self.setAccessibleName(f"{text} {note}".strip())
            self.update()

    def set_colors(self, background: str, foreground: str, striped: bool = False) -> None:
        """Set background ("" for none) and text colour; `striped` paints warning stripes at both ends."""
        if (background, foreground, striped) != (self._background, self._foreground, self._striped):
            self._background, self._foreground, self._striped = background, foreground, striped
            self.update()

    def sizeHint(self) -> QSize:
        return QSize(self._width, 84)

    def minimumSizeHint(self) -> QSize:
        return QSize(self._least_width, 40)

    def paintEvent(self, _event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        area = QRectF(self.rect())
        if self._background:
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(self._background))
            painter.drawRoundedRect(area, 6, 6)
            area = area.adjusted(10, 6, -10, -6)
        if self._striped:
            self._draw_stripes(painter)
            area = area.adjusted(12, 0, -12, 0)
        painter.setPen(QColor(self._foreground))
        if self._symbol:
            side = min(area.height() * 0.72, area.width() * 0.22)
            box = QRectF(area.left(), area.center().y() - side / 2, side, side)
            painter.save()
            SYMBOLS[self._symbol](painter, box)
            painter.restore()
            area = area.adjusted(side + 10, 0, 0, 0)
        if self.note:
            height = NOTE_SHARE * area.height()
            smallest = QFontMetricsF(_font_of_size(self.font(), SMALLEST_PX, bold=False))
            if area.height() >= TWO_LINE_HEIGHT and smallest.horizontalAdvance(self.note) > area.width():
                height = max(height, 2 * smallest.lineSpacing())
            note = QRectF(area.left(), area.bottom() - height, area.width(), height)
            self._draw_text(painter, note, self.note, bold=False, max_px=26)
            area = area.adjusted(0, 0, 0, -note.height())
        self._draw_text(painter, area, self.text, bold=True, max_px=LARGEST_PX)
        painter.end()

    def _draw_text(self, painter: QPainter, area: QRectF, text: str, *, bold: bool, max_px: int) -> None:
        lines, font = _fit_text(self.font(), text, area, bold, max_px)
        painter.setFont(font)
        metrics = painter.fontMetrics()
        lines = [metrics.elidedText(line, Qt.TextElideMode.ElideRight, int(area.width()) + 1) for line in lines]
        flags = Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft
        painter.drawText(area, int(flags), "\n".join(lines))

    def _draw_stripes(self, painter: QPainter) -> None:
        painter.save()
        painter.setPen(QPen(QColor(self._foreground), 6))
        height = self.height()
        for left in (0, self.width() - 14):
            painter.setClipRect(QRectF(left, 0, 14, height))
            for y in range(-20, height + 20, 17):
                painter.drawLine(QPointF(left - 4, y + 22), QPointF(left + 18, y))
        painter.restore()


def _fit_text(font: QFont, text: str, area: QRectF, bold: bool, max_px: int) -> tuple[list[str], QFont]:
    """Return lines and font: the largest size with which the text fits on one line, or on two."""
    parts = text.split()
    halves = [[" ".join(parts[:i]), " ".join(parts[i:])] for i in range(1, len(parts))]
    one, two = [text], min(halves, key=lambda lines: max(map(len, lines)), default=[text])
    px, px_of_two = (_largest_font_px(font, lines, area, bold, max_px) for lines in (one, two))
    if px_of_two > px + 2 or px < SMALLEST_PX <= px_of_two:
        px, one = px_of_two, two
    return one, _font_of_size(font, max(px, SMALLEST_PX), bold)


def _largest_font_px(font: QFont, lines: list[str], area: QRectF, bold: bool, max_px: int) -> int:
    """Return the size in pixels, 0 if none fits. Text width grows almost linearly with size, so one estimate is near."""

    def scale(px: int) -> float:
        metrics = QFontMetricsF(_font_of_size(font, px, bold))
        wide = max(metrics.horizontalAdvance(line) for line in lines)
        return min(area.width() / max(wide, 1e-9), 1.06 * area.height() / (metrics.lineSpacing() * len(lines)))

    if (fit := scale(max_px)) >= 1.0:
        return max_px
    px = int(max_px * max(fit, 0.0)) + 1
    while px > 0 and scale(px) < 1.0:
        px -= 1
    return px


def _font_of_size(font: QFont, px: int, bold: bool) -> QFont:
    sized = QFont(font)
    sized.setPixelSize(max(px, 1))
    sized.setBold(bold)
    return sized
