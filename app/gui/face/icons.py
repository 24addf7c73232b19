"""Icons: outlines on a grid of 24 units, drawn in any size and colour by one painter."""

import re
from functools import cache

from PySide6.QtCore import QPointF, QRect, QRectF, QSize, Qt
from PySide6.QtGui import QBrush, QColor, QIcon, QIconEngine, QPainter, QPainterPath, QPen, QPixmap

from app.gui.face.tokens import tokens

UNITS = 24.0
STROKE = 1.75 * UNITS / 20.0
"""Width of the lines in units: 1.75 at a size of 20."""

ICONS: dict[str, str] = {
    # pages
    "measure": "M2 12 H6 L9 4 L14 20 L17 12 H22",
    "campaign": "M3 6 L5 8 L8 4 M12 6 H21 M3 13 L5 15 L8 11 M12 13 H21 M3 20 L5 22 L8 18 M12 20 H21",
    "explore": "M3 6 H14 M18 6 H21 M16 4 V8 M3 12 H7 M11 12 H21 M9 10 V14 M3 18 H12 M16 18 H21 M14 16 V20",
    "runs": "M3 4 H21 V20 H3 Z M3 9.5 H21 M3 14.5 H21 M8 4 V20",
    "bench": "M2 8 H8 V16 H2 Z M16 8 H22 V16 H16 Z M8 12 H16 O12 12 1.6",
    "laboratory": "M3 3 V20 H21 M7 15 L11 10 L14 13 L20 6",
    "help": "O12 12 9 M9.2 9.2 C9.2 5.6 14.8 5.6 14.8 9.2 C14.8 11.6 12 11.4 12 14 M12 17.2 V17.4",
    # states of the strip
    "connect": "A12 12 9 20 50 A12 12 9 92 50 A12 12 9 164 50 A12 12 9 236 50 A12 12 9 308 50",
    "not-armed": "M4 4 H20 V20 H4 Z",
    "arming": "M6 3 H18 M6 21 H18 M7 3 V6 C7 10 17 14 17 18 V21 M17 3 V6 C17 10 7 14 7 18 V21",
    "live": "M12 3 L22.5 21 H1.5 Z M12.6 8.6 L9.8 14 H13.6 L11.2 18.4",
    "pause": "O12 12 9 M9.6 8.5 V15.5 M14.4 8.5 V15.5",
    "hv-off": "O4.5 15 2 O19.5 15 2 M6.5 15 H8 L16 7 M16 15 H17.5",
    "danger": "M8 2 H16 L22 8 V16 L16 22 H8 L2 16 V8 Z M12 7 V13 M12 16.6 V16.8",
    "to-rest": "M12 3 V16 M6 10.5 L12 16.5 L18 10.5 M3 21 H21",
    "rest": "O12 12 9 M7.6 12.3 L10.8 15.4 L16.6 9",
    "no-bench": "M9 7 H7 C0 7 0 17 7 17 H9 M15 7 H17 C24 7 24 17 17 17 H15 M12 3 V6 M12 18 V21",
    # marks
    "good": "*O12 12 11 !M6.8 12.4 L10.4 16 L17.2 8.6",
    "warning": "*M12 1 L23.5 22 H0.5 Z !M12 8 V15 M12 18.4 V18.6",
    "error": "*M7.4 1 H16.6 L23 7.4 V16.6 L16.6 23 H7.4 L1 16.6 V7.4 Z !M8 8 L16 16 M16 8 L8 16",
    "waiting": "O12 12 8.5",
    "hand": "M7 12 V6.5 C7 4.5 9.8 4.5 9.8 6.5 V11 V4.5 C9.8 2.5 12.6 2.5 12.6 4.5 V11 V5.5 C12.6 3.5 15.4 3.5 15.4 5.5 V12 V8.5 "
    "C15.4 6.5 18.2 6.5 18.2 8.5 V15 C18.2 19.5 15.6 22 12 22 C8.6 22 7 20 5.4 17 L3.6 13.4 C3 12 5 11 6 12.4 L7 14",
    "question": "M9.2 8.2 C9.2 4.2 14.8 4.2 14.8 8.2 C14.8 10.8 12 10.8 12 13.6 M12 18.2 V18.4",
    # actions
    "zoom": "O10.5 10.5 6.5 M15.5 15.5 L21 21 M10.5 7.8 V13.2 M7.8 10.5 H13.2",
    "cursor": "M10 2 V22 M3 12 H10 M10 12 H21 M15 9 V15",
    "copy": "M9 9 H21 V21 H9 Z M6 15 H3 V3 H15 V6",
    "more": "*O5 12 1.7 *O12 12 1.7 *O19 12 1.7",
    "down": "M5 9 L12 16 L19 9",
    "play": "*M6 3 L20 12 L6 21 Z",
    "again": "A12 12 8.5 60 290 M11.5 0.5 L16.3 4.6 L11.5 8.4",
    "nothing": "O12 12 9 M6 18 L18 6",
}
"""By name: M, L, H, V, C and Z as in SVG; O: circle by centre and radius; A: arc by centre, radius, start and span in degrees.

`*` fills the part up to the next mark, `!` draws it in the ground's colour over what is filled.
"""

_MARK = re.compile(r"[*!]|[MLHVCZOA][^MLHVCZOA*!]*")


@cache
def _parts(name: str) -> tuple[tuple[str, QPainterPath], ...]:
    """Return the parts of an icon: how they are drawn (a line, `*` or `!`), and their outlines."""
    parts: list[tuple[str, QPainterPath]] = []
    how, path = "", QPainterPath()
    for mark in _MARK.findall(ICONS[name]):
        if mark in "*!":
            if not path.isEmpty():
                parts.append((how, path))
            how, path = mark, QPainterPath()
            continue
        _add(path, mark[0], [float(each) for each in mark[1:].split()])
    return (*parts, (how, path))


def _add(path: QPainterPath, command: str, numbers: list[float]) -> None:
    at = path.currentPosition()
    match command:
        case "M":
            path.moveTo(*numbers)
        case "L":
            path.lineTo(*numbers)
        case "H":
            path.lineTo(numbers[0], at.y())
        case "V":
            path.lineTo(at.x(), numbers[0])
        case "C":
            path.cubicTo(*numbers)
        case "Z":
            path.closeSubpath()
        case "O":
            x, y, radius = numbers
            path.addEllipse(QPointF(x, y), radius, radius)
        case "A":
            x, y, radius, start, span = numbers
            box = QRectF(x - radius, y - radius, 2 * radius, 2 * radius)
            path.arcMoveTo(box, start)
            path.arcTo(box, start, span)


def draw_icon(painter: QPainter, name: str, box: QRectF, color: str | QColor, ground: str | QColor = "white") -> None:
    """Draw an icon into a square; `ground` is the colour of what lies over a filled part."""
    painter.save()
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.translate(box.topLeft())
    painter.scale(box.width() / UNITS, box.height() / UNITS)
    for how, path in _parts(name):
        if how == "*":
            painter.fillPath(path, QBrush(QColor(color)))
            continue
        line = QPen(QColor(ground if how == "!" else color), STROKE * (1.2 if how == "!" else 1.0))
        line.setCapStyle(Qt.PenCapStyle.RoundCap)
        line.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
        painter.strokePath(path, line)
    painter.restore()


class PaintedIcon(QIconEngine):
    """Icon that is painted whenever it is shown; subclasses implement `paint` and `clone`."""

    def pixmap(self, size: QSize, mode: QIcon.Mode, state: QIcon.State) -> QPixmap:
        pixmap = QPixmap(size)
        pixmap.fill(Qt.GlobalColor.transparent)
        painter = QPainter(pixmap)
        self.paint(painter, QRect(0, 0, size.width(), size.height()), mode, state)
        painter.end()
        return pixmap


class _Engine(PaintedIcon):
    def __init__(self, name: str, color: str) -> None:
        super().__init__()
        self._name, self._color = name, color

    def paint(self, painter: QPainter, rect: QRect, mode: QIcon.Mode, _state: QIcon.State) -> None:
        colors = tokens()
        name = "outline" if mode is QIcon.Mode.Disabled else self._color
        color = "white" if name == "white" else str(getattr(colors, name))
        draw_icon(painter, self._name, QRectF(rect), color)

    def clone(self) -> QIconEngine:
        return _Engine(self._name, self._color)


def icon(name: str, color: str = "text") -> QIcon:
    """Return an icon of `ICONS` in the colour of a color, or "white"; it follows the tokens in use."""
    return QIcon(_Engine(name, color))
