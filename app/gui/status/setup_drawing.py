"""Drawing of the set-up in a prompt: tactor, clamps, weight, mass, membrane and wires."""

from collections.abc import Callable

from PySide6.QtCore import QLineF, QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QBrush, QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from app.gui.face import draw_box, painting, px, set_length, text_font
from model import format_quantity
from protocols.base import Prompt

INK, MFC, METAL, SKIN, WEIGHT = "#12161c", "#8a5a2b", "#505a68", "#5a6b9a", "#12161c"
GROUND = "#f2f4f7"
SIZE = QSize(190, 92)
"""In which the set-ups are drawn; they are enlarged to the widget."""


class SetupDrawing(QWidget):
    """Hidden for actions that need no drawing."""

    def __init__(self) -> None:
        super().__init__()
        set_length(self, 298, 164)
        self._prompt: Prompt | None = None

    def show_prompt(self, prompt: Prompt) -> bool:
        """Draw the set-up of a prompt; return whether it has a drawing."""
        self._prompt = prompt
        self.setAccessibleName(prompt.text)
        self.update()
        return prompt.action in DRAWINGS

    def paintEvent(self, _event: QPaintEvent) -> None:
        if self._prompt is None or self._prompt.action not in DRAWINGS:
            return
        scale = min(self.width() / (SIZE.width() + 20), self.height() / (SIZE.height() + 16))
        font = text_font()
        font.setPixelSize(max(round(font.pixelSize() / scale), 1))
        with painting(self) as painter:
            draw_box(painter, QRectF(self.rect()), px(8), GROUND)
            painter.translate((self.width() - scale * SIZE.width()) / 2, (self.height() - scale * SIZE.height()) / 2)
            painter.scale(scale, scale)
            painter.setFont(font)
            painter.setPen(QPen(QColor(INK), 1.5))
            DRAWINGS[self._prompt.action](painter, dict(self._prompt.values))


def _fill_rectangle(painter: QPainter, color: str, box: QRectF) -> None:
    painter.setBrush(QBrush(QColor(color)))
    painter.drawRect(box)


def _draw_clamps(painter: QPainter, y: float) -> None:
    for x in (8, 160):
        _fill_rectangle(painter, METAL, QRectF(x, y - 12, 22, 24))


def _draw_skin(painter: QPainter, *lines: QLineF) -> None:
    painter.setPen(QPen(QColor(SKIN), 3))
    painter.drawLines(lines)
    painter.setPen(QPen(QColor(INK), 1.5))


def _draw_tactor(painter: QPainter, side: float = 1.0, y: float = 60.0) -> None:
    """Aluminium strip between two clamps, the MFC patch in its middle: above, or below where the side is turned."""
    _draw_clamps(painter, y)
    _fill_rectangle(painter, "#d8dde2", QRectF(30, y - 3, 130, 6))
    patch = QRectF(60, y - 8 if side > 0 else y + 3, 70, 5)
    _fill_rectangle(painter, MFC, patch)


def _draw_text(painter: QPainter, box: QRectF, text: str, color: str = INK) -> None:
    painter.save()
    painter.setPen(QColor(color))
    font = painter.font()
    font.setBold(True)
    painter.setFont(font)
    painter.drawText(box, Qt.AlignmentFlag.AlignCenter, text)
    painter.restore()


def _draw_arrow(painter: QPainter, start: QPointF, end: QPointF) -> None:
    back = QLineF(end, start)
    painter.drawLine(back)
    for turn in (30, -30):
        painter.drawLine(QLineF.fromPolar(8, back.angle() + turn).translated(end))


def _draw_place_weight(painter: QPainter, values: dict[str, float]) -> None:
    _draw_tactor(painter, values.get("side", 1.0), 74)
    _fill_rectangle(painter, WEIGHT, QRectF(68, 18, 54, 30))
    _draw_text(painter, QRectF(68, 18, 54, 30), format_quantity(values.get("mass_kg", 0.0), 0.0, "kg"), "white")
    _draw_arrow(painter, QPointF(95, 50), QPointF(95, 64))


def _draw_remove_weight(painter: QPainter, values: dict[str, float]) -> None:
    _draw_tactor(painter, values.get("side", 1.0), 74)
    _fill_rectangle(painter, WEIGHT, QRectF(68, 34, 54, 30))
    _draw_arrow(painter, QPointF(95, 30), QPointF(95, 6))


def _draw_fix_mass(painter: QPainter, values: dict[str, float]) -> None:
    _draw_tactor(painter)
    mass = values.get("mass_kg", 0.0)
    if mass > 0:
        painter.setBrush(QBrush(QColor(WEIGHT)))
        painter.drawEllipse(QPointF(95, 42), 9, 9)
        _draw_text(painter, QRectF(106, 22, 76, 20), format_quantity(mass, 0.0, "kg"))
    else:
        _draw_text(painter, QRectF(50, 20, 90, 20), "no mass")


def _draw_turn_side(painter: QPainter, values: dict[str, float]) -> None:
    side = values.get("side", 1.0)
    _draw_tactor(painter, side)
    offset = f", {format_quantity(values['offset_kg'], 0.0, 'kg')} on it" if values.get("offset_kg") else ""
    _draw_text(painter, QRectF(0, 6, 190, 20), ("MFC up" if side > 0 else "aluminium up") + offset)
    if values.get("shorted"):
        _draw_text(painter, QRectF(0, 74, 190, 18), "wires together")
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.drawArc(QRectF(78, 26, 34, 24), 20 * 16, 300 * 16)


def _draw_short_electrodes(painter: QPainter, _values: dict[str, float]) -> None:
    _draw_tactor(painter)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.setPen(QPen(QColor(MFC), 3))
    painter.drawArc(QRectF(72, 18, 46, 70), 0, 180 * 16)
    _draw_text(painter, QRectF(20, 0, 150, 20), "wires together")


def _draw_membrane(painter: QPainter, values: dict[str, float]) -> None:
    _draw_tactor(painter, y=70)
    _draw_skin(painter, QLineF(20, 44, 170, 44), QLineF(95, 44, 95, 62))
    elongation_mm = 1e3 * values.get("elongation_m", 0.0)
    if elongation_mm > 0:
        _draw_arrow(painter, QPointF(20, 34), QPointF(2, 34))
        _draw_arrow(painter, QPointF(170, 34), QPointF(188, 34))
    _draw_text(painter, QRectF(20, 8, 150, 20), f"stretch {elongation_mm:g} mm")


def _draw_remove_membrane(painter: QPainter, _values: dict[str, float]) -> None:
    _draw_tactor(painter)
    _draw_skin(painter, QLineF(40, 20, 150, 20))
    _draw_arrow(painter, QPointF(95, 40), QPointF(95, 24))


def _draw_hang_membrane(painter: QPainter, _values: dict[str, float]) -> None:
    _draw_clamps(painter, 42)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.setPen(QPen(QColor(SKIN), 3))
    painter.drawArc(QRectF(28, 6, 134, 60), 190 * 16, 160 * 16)


def _draw_place_reference(painter: QPainter, values: dict[str, float]) -> None:
    _draw_clamps(painter, 42)
    _fill_rectangle(painter, "#d8dde2", QRectF(60, 60, 70, 14))
    painter.drawLine(QPointF(30, 42), QPointF(160, 42))
    _draw_arrow(painter, QPointF(95, 42), QPointF(95, 59))
    _draw_text(painter, QRectF(20, 6, 150, 20), f"{1e3 * values.get('reference_m', 0.0):.3f} mm deep")


DRAWINGS: dict[str, Callable[[QPainter, dict[str, float]], None]] = {
    "place-weight": _draw_place_weight,
    "remove-weight": _draw_remove_weight,
    "fix-mass": _draw_fix_mass,
    "turn-side": _draw_turn_side,
    "short-electrodes": _draw_short_electrodes,
    "stretch-membrane": _draw_membrane,
    "remove-membrane": _draw_remove_membrane,
    "place-reference": _draw_place_reference,
    "hang-membrane": _draw_hang_membrane,
}
