"""Signs that are read from two metres: a symbol, a word as large as its place allows, and a note below it."""

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFont, QFontMetricsF, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.gui.bench.symbols import SYMBOLS

LARGEST_PX, SMALLEST_PX = 110, 9
NOTE_SHARE = 0.30
"""Of the sign's height."""


class Sign(QWidget):
    """Paints words in the largest type that fits; on two lines where that is larger."""

    def __init__(self, width: int, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._words, self._note, self._symbol = "", "", ""
        self._ground, self._ink = "#808080", "#ffffff"
        self._striped = False
        self._width = width
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Expanding)

    def say(self, words: str, note: str = "", symbol: str = "") -> None:
        """What shall be read."""
        if (words, note, symbol) != (self._words, self._note, self._symbol):
            self._words, self._note, self._symbol = words, note, symbol
            self.setAccessibleName(f"{words} {note}".strip())
            self.update()

    def colour(self, ground: str, ink: str, striped: bool = False) -> None:
        """Ground ("" for none) and writing; `striped` paints the warning stripes of live machinery at both ends."""
        if (ground, ink, striped) != (self._ground, self._ink, self._striped):
            self._ground, self._ink, self._striped = ground, ink, striped
            self.update()

    @property
    def words(self) -> str:
        return self._words

    @property
    def note(self) -> str:
        return self._note

    def sizeHint(self) -> QSize:
        return QSize(self._width, 84)

    def minimumSizeHint(self) -> QSize:
        return QSize(self._width, 40)

    def paintEvent(self, _event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        area = QRectF(self.rect())
        if self._ground:
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(self._ground))
            painter.drawRoundedRect(area, 6, 6)
            area = area.adjusted(10, 6, -10, -6)
        if self._striped:
            self._stripes(painter)
            area = area.adjusted(12, 0, -12, 0)
        painter.setPen(QColor(self._ink))
        if self._symbol:
            side = min(area.height() * 0.72, area.width() * 0.22)
            box = QRectF(area.left(), area.center().y() - side / 2, side, side)
            painter.save()
            SYMBOLS[self._symbol](painter, box)
            painter.restore()
            area = area.adjusted(side + 10, 0, 0, 0)
        if self._note:
            note = QRectF(
                area.left(), area.bottom() - NOTE_SHARE * area.height(), area.width(), NOTE_SHARE * area.height()
            )
            self._write(painter, note, self._note, bold=False, most=26)
            area = area.adjusted(0, 0, 0, -note.height())
        self._write(painter, area, self._words, bold=True, most=LARGEST_PX)
        painter.end()

    def _write(self, painter: QPainter, area: QRectF, words: str, *, bold: bool, most: int) -> None:
        lines, font = _fit(self.font(), words, area, bold, most)
        painter.setFont(font)
        flags = Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft
        painter.drawText(area, int(flags), "\n".join(lines))

    def _stripes(self, painter: QPainter) -> None:
        painter.save()
        painter.setPen(QPen(QColor(self._ink), 6))
        height = self.height()
        for left in (0, self.width() - 14):
            painter.setClipRect(QRectF(left, 0, 14, height))
            for y in range(-20, height + 20, 17):
                painter.drawLine(QPointF(left - 4, y + 22), QPointF(left + 18, y))
        painter.restore()


def _fit(font: QFont, words: str, area: QRectF, bold: bool, most: int) -> tuple[list[str], QFont]:
    """Lines and font: the largest type in which the words fit on one line, or on two."""
    parts = words.split()
    halves = [[" ".join(parts[:i]), " ".join(parts[i:])] for i in range(1, len(parts))]
    one, two = [words], min(halves, key=lambda lines: max(map(len, lines)), default=[words])
    px, px_of_two = (_largest(font, lines, area, bold, most) for lines in (one, two))
    if px_of_two > px + 2:
        px, one = px_of_two, two
    return one, _sized(font, max(px, SMALLEST_PX), bold)


def _largest(font: QFont, lines: list[str], area: QRectF, bold: bool, most: int) -> int:
    """In pixels; 0 where nothing fits. Type grows almost evenly with its size: one look tells nearly where to end."""

    def scale(px: int) -> float:
        metrics = QFontMetricsF(_sized(font, px, bold))
        wide = max(metrics.horizontalAdvance(line) for line in lines)
        return min(area.width() / max(wide, 1e-9), 1.06 * area.height() / (metrics.lineSpacing() * len(lines)))

    if (room := scale(most)) >= 1.0:
        return most
    px = int(most * max(room, 0.0)) + 1
    while px > 0 and scale(px) < 1.0:
        px -= 1
    return px


def _sized(font: QFont, px: int, bold: bool) -> QFont:
    sized = QFont(font)
    sized.setPixelSize(max(px, 1))
    sized.setBold(bold)
    return sized
