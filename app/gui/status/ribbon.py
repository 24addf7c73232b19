"""Ribbon of the bench in the menu line: SIMULATED on a hatch, with speed and who answers; a real bench has its name."""

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent
from PySide6.QtWidgets import QAbstractButton

from app.common import pluralize
from app.gui.face import (
    CENTRE,
    CLASS_S,
    class_of,
    draw_box,
    draw_hatch,
    draw_icon,
    draw_ring,
    draw_text,
    painting,
    px,
    text_width,
    tokens,
)
from app.gui.widgets import configure, tooltip
from app.session import AnsweredBy, SimulationSettings

WHO_ANSWERS = {
    AnsweredBy.USER: ("you answer the prompts", "you answer"),
    AnsweredBy.USER_IN_CAMPAIGN: ("you answer in a campaign", "you in campaigns"),
    AnsweredBy.SIMULATION: ("the simulation answers", "simulation answers"),
}


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
        with painting(self) as painter:
            (self._paint_simulated if self._simulated else self._paint_real)(painter)

    def _paint_simulated(self, painter: QPainter) -> None:
        colors = tokens()
        draw_hatch(painter, QRectF(self.rect()), colors.violet2, QColor(colors.violet))
        left = self._draw_text(painter, px(12), "SIMULATED", "white", "mark")
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
            width = text_width(text)
            if right - width < left + px(8):
                break
            self._draw_text(painter, right - width, text, "white")
            right -= width + px(16)
        note = "Computed, not measured"
        if left + px(16) + text_width(note) < right:
            self._draw_text(painter, left + px(16), note, "white")
        if self.hasFocus():
            draw_ring(painter, self.rect().adjusted(1, 1, -1, -1), "white")

    def _paint_real(self, painter: QPainter) -> None:
        colors = tokens()
        painter.fillRect(self.rect(), QColor(colors.surface))
        right = float(self.width() - px(4))
        for text, color, kind in (("real bench", colors.text2, ""), (self._bench, colors.text, "caption")):
            right -= px(10) + text_width(text, kind)
            self._draw_text(painter, right, text, color, kind)
        side = px(18)
        draw_icon(painter, "bench", QRectF(right - px(26), (self.height() - side) / 2, side, side), colors.text2)

    def _draw_text(self, painter: QPainter, left: float, text: str, color: str, kind: str = "") -> float:
        """Draw a text and return its right end."""
        return left + draw_text(painter, QRectF(left, 0, self.width() - left, self.height()), text, color, kind)

    def _draw_key(self, painter: QPainter, key: str) -> float:
        """Draw the cap of a key at the right end and return its left end with a gap."""
        cap = QRectF(self.width() - px(12) - px(26), px(4), px(26), self.height() - px(8))
        draw_box(painter, cap.adjusted(0.5, 0.5, -0.5, -0.5), px(4), QColor(255, 255, 255, 40), "white")
        draw_text(painter, cap, key, "white", "caption", CENTRE)
        return cap.left() - px(8)
