"""Ribbon of the bench in the menu line: SIMULATED on a hatch, with speed and who answers; a real bench has its name."""

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QAbstractButton

from app.common import pluralize
from app.gui.face import (
    BOLD,
    CLASS_S,
    LABEL_PX,
    REGULAR,
    SEMIBOLD,
    class_of,
    draw_icon,
    px,
    text_font,
    tokens,
)
from app.gui.widgets import configure, tooltip
from app.session import AnsweredBy, SimulationSettings

WHO_ANSWERS = {
    AnsweredBy.USER: ("you answer the prompts", "you answer"),
    AnsweredBy.USER_IN_CAMPAIGN: ("you answer in a campaign", "you in campaigns"),
    AnsweredBy.SIMULATION: ("the simulation answers", "simulation answers"),
}
LEFT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter


class BenchRibbon(QAbstractButton):
    """The rest of the menu line. On the simulated bench a click opens speed, prompts and faults.

    Args:
        bench: name of the bench.
        simulated: whether it is simulated.
        simulation: its settings; None where they cannot be changed.
    """

    def __init__(self, bench: str, simulated: bool, simulation: SimulationSettings | None) -> None:
        super().__init__()
        self._bench, self._simulated, self._simulation = bench, simulated, simulation
        self._shown: tuple[float | None, AnsweredBy] | None = None
        self.fault_count = 0
        name = "SIMULATED: computed, not measured" if simulated else f"{bench}, real bench"
        configure(
            self,
            "ribbon",
            accessibleName=name,
            toolTip=tooltip("faults.toggle") if simulated else "The bench that is open",
            focusPolicy=Qt.FocusPolicy.TabFocus if simulated else Qt.FocusPolicy.NoFocus,
        )

    def tick(self) -> None:
        """Paint the settings of the simulation anew where they have changed."""
        if self._simulation is not None:
            shown = self._simulation.speed, self._simulation.answered_by
            if shown != self._shown:
                self._shown = shown
                self.update()

    def show_faults(self, count: int) -> None:
        """Show how many faults are injected: what is broken stays in sight."""
        self.fault_count = count
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(px(300), px(26))

    def paintEvent(self, _event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if self._simulated:
            self._paint_simulated(painter)
        else:
            self._paint_real(painter)
        painter.end()

    def _paint_simulated(self, painter: QPainter) -> None:
        colors = tokens()
        draw_hatch(painter, QRectF(self.rect()), colors.violet2, QColor(colors.violet))
        painter.setPen(QColor("white"))
        bold, plain = text_font(LABEL_PX, BOLD), text_font(LABEL_PX)
        bold.setLetterSpacing(bold.SpacingType.AbsoluteSpacing, px(1))
        left = self._draw_text(painter, px(12), "SIMULATED", bold)
        small = class_of(self) is CLASS_S
        right = self._draw_key(painter, "F9")
        texts = [f"{pluralize(self.fault_count, 'fault')} on" if self.fault_count else "Faults"]
        if self._simulation is not None:
            speed = self._simulation.speed
            texts += [
                WHO_ANSWERS[self._simulation.answered_by][small],
                f"Speed {'max' if speed is None else f'{speed:g}×'}",
            ]
        for text in texts:
            width = QFontMetricsF(plain).horizontalAdvance(text)
            if right - width < left + px(8):
                break
            self._draw_text(painter, right - width, text, plain)
            right -= width + px(16)
        note = "Computed, not measured"
        if left + px(16) + QFontMetricsF(plain).horizontalAdvance(note) < right:
            self._draw_text(painter, left + px(16), note, plain)
        if self.hasFocus():
            painter.setPen(QPen(QColor("white"), 2.0))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawRect(self.rect().adjusted(2, 2, -2, -2))

    def _paint_real(self, painter: QPainter) -> None:
        colors = tokens()
        painter.fillRect(self.rect(), QColor(colors.surface))
        bold, plain = text_font(LABEL_PX, SEMIBOLD), text_font(LABEL_PX, REGULAR)
        kind = "real bench"
        right = self.width() - px(14) - QFontMetricsF(plain).horizontalAdvance(kind)
        painter.setPen(QColor(colors.text2))
        self._draw_text(painter, right, kind, plain)
        right -= px(10) + QFontMetricsF(bold).horizontalAdvance(self._bench)
        painter.setPen(QColor(colors.text))
        self._draw_text(painter, right, self._bench, bold)
        side = px(18)
        draw_icon(painter, "bench", QRectF(right - px(26), (self.height() - side) / 2, side, side), colors.text2)

    def _draw_text(self, painter: QPainter, left: float, text: str, font: object) -> float:
        """Draw a text and return its right end."""
        painter.setFont(font)  # type: ignore[arg-type]
        width = painter.fontMetrics().horizontalAdvance(text)
        painter.drawText(QRectF(left, 0, width + 2, self.height()), LEFT, text)
        return left + width

    def _draw_key(self, painter: QPainter, key: str) -> float:
        """Draw the cap of a key at the right end and return its left end with a gap."""
        cap = QRectF(self.width() - px(12) - px(26), px(4), px(26), self.height() - px(8))
        painter.setBrush(QColor(255, 255, 255, 40))
        painter.setPen(QPen(QColor("white"), 1.0))
        painter.drawRoundedRect(cap.adjusted(0.5, 0.5, -0.5, -0.5), px(4), px(4))
        painter.setFont(text_font(LABEL_PX, SEMIBOLD))
        painter.drawText(cap, Qt.AlignmentFlag.AlignCenter, key)
        return cap.left() - px(8)


def draw_hatch(painter: QPainter, area: QRectF, color: str | QColor, ground: QColor, step: float = 16.0) -> None:
    """Fill an area with diagonal stripes on a ground."""
    painter.save()
    painter.setClipRect(area)
    painter.fillRect(area, ground)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    width, over = px(step), px(step)
    painter.setPen(QPen(QColor(color), width * 0.5))
    height, at = area.height() + 2 * over, area.left() - area.height() - over
    while at < area.right() + over:
        painter.drawLine(QPointF(at, area.bottom() + over), QPointF(at + height, area.bottom() + over - height))
        at += 1.42 * width
    painter.restore()
