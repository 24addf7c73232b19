"""Status bar of the bench: state, voltage, progress, instruments, SIMULATED, Pause and Stop."""

import time

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPaintEvent
from PySide6.QtWidgets import QLabel, QSizePolicy, QWidget

from app.common import outcome_severity
from app.gui.status.session_controller import SessionController
from app.gui.status.status_sign import StatusSign
from app.gui.status.symbols import SYMBOLS
from app.gui.widgets import LIGHT, Theme, WindowTheme, configure, grid, make_button, make_pane, make_progress_bar, row
from app.session import BenchState, InstrumentStatus, Lamp, WindowState

STATE_SYMBOLS = {
    BenchState.CONNECTING: "dots",
    BenchState.IDLE: "open",
    BenchState.ARMING: "dots",
    BenchState.LIVE: "bolt",
    BenchState.PAUSING: "pause",
    BenchState.DRIVE_LOST: "danger",
    BenchState.PAUSED: "pause",
    BenchState.HV_OFF: "open",
    BenchState.GOING_TO_REST: "down",
    BenchState.AT_REST: "rest",
    BenchState.UNSAFE: "danger",
    BenchState.NO_BENCH: "nothing",
}
LAMP_SYMBOLS = {Lamp.WAITING: "dots", Lamp.READY: "tick", Lamp.SUSPECT: "question", Lamp.MISSING: "cross"}
ROW_HEIGHT = 48
"""Of the signs and buttons while nothing is driven."""

ALARM_HEIGHTS = (72, 130)
"""Least and greatest height of the signs while the specimen is driven or may be: to be read from two metres."""

TASK_WIDTH, LAMPS_WIDTH, ROLES_WIDTH, IDENTITIES_WIDTH = 860, 720, 1180, 1500
"""Least width of a window that shows the run, the instruments' lamps, their roles, and their identities."""

STRIPED_STATES = (BenchState.LIVE, BenchState.PAUSING)
LARGE_STATES = (*STRIPED_STATES, BenchState.GOING_TO_REST, BenchState.DRIVE_LOST, BenchState.UNSAFE)

AGE_S = 0.2
"""Time between two looks at the age of the measured volts."""


class InstrumentLamp(QWidget):
    """Status lamp of one instrument; where there is room with its role, and with its identity elided to the width.

    Args:
        parent: the status bar.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.instrument = InstrumentStatus("", "", Lamp.WAITING)
        self._theme = LIGHT
        self._shows_role = self._shows_identity = True
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)

    def show_texts(self, role: bool, identity: bool) -> None:
        """Choose whether the role and the identity are shown beside the lamp; the tool tip always has both."""
        if (role, identity) != (self._shows_role, self._shows_identity):
            self._shows_role, self._shows_identity = role, identity
            self.updateGeometry()
            self.update()

    def show_instrument(self, instrument: InstrumentStatus, theme: Theme) -> None:
        """Show an instrument."""
        self.instrument, self._theme = instrument, theme
        self.setAccessibleName(f"{instrument.role} {instrument.lamp}: {instrument.identity}")
        self.update()

    @property
    def text(self) -> str:
        """The identity, or the status where it is not ready."""
        instrument = self.instrument
        return instrument.identity if instrument.lamp is Lamp.READY else instrument.remark or str(instrument.lamp)

    def sizeHint(self) -> QSize:
        line = self.fontMetrics().height()
        width = line + 2 + self._shows_role * 88 + self._shows_identity * 120
        return QSize(width, line + 4)

    def paintEvent(self, _event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        side = self.fontMetrics().height() * 0.95
        lamp = QRectF(1, (self.height() - side) / 2, side, side)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(self._theme.lamp_color(self.instrument.lamp)))
        painter.drawEllipse(lamp)
        inset = side * 0.22
        painter.setPen(QColor("#101010" if self._theme.dark else "#ffffff"))
        painter.save()
        SYMBOLS[LAMP_SYMBOLS[self.instrument.lamp]](painter, lamp.adjusted(inset, inset, -inset, -inset))
        painter.restore()
        if self._shows_role:
            self._draw_texts(painter, lamp.right() + 6)
        painter.end()

    def _draw_texts(self, painter: QPainter, left: float) -> None:
        bold = self.font()
        bold.setBold(True)
        painter.setFont(bold)
        painter.setPen(QColor(self._theme.text))
        role = self.instrument.role
        flags = int(Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft)
        painter.drawText(QRectF(left, 0, self.width(), self.height()), flags, role)
        if not self._shows_identity:
            return
        left += QFontMetricsF(bold).horizontalAdvance(role) + 6
        painter.setFont(self.font())
        painter.setPen(QColor(self._theme.secondary_text))
        text = self.fontMetrics().elidedText(self.text, Qt.TextElideMode.ElideRight, max(int(self.width() - left), 0))
        painter.drawText(QRectF(left, 0, self.width() - left, self.height()), flags, text)


class BenchStatusBar(QWidget):
    """The top of the window, the same on every page."""

    def __init__(self, theme: WindowTheme, controller: SessionController) -> None:
        super().__init__()
        self._theme, self._controller = theme, controller
        theme.changed.connect(self._show_again)
        self._state: WindowState | None = None
        self.state_sign, self.voltage_sign, self.task_sign = (
            configure(StatusSign(*widths), f"status.{name}")
            for name, widths in (("state", (220, 150)), ("voltage", (200, 120)), ("task", (200, 120)))
        )
        self.progress_bar = make_progress_bar(1000, 8, "status.progress")
        # Otherwise their large text would keep a window large.
        narrow = {"sizePolicy": QSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed), "minimumWidth": 72}
        self._window_size = QSize(1280, 720)
        self._shown_at_s = 0.0
        self.simulated_label = configure(
            QLabel("SIMULATED"),
            "status.simulated",
            kind="simulated",
            alignment=Qt.AlignmentFlag.AlignCenter,
            toolTip="No real instrument is connected: every number is computed.",
            **narrow,
        )
        self.stop_button, self.pause_button = (
            make_button(text, on_click, kind, tip, f"status.{kind}", focusPolicy=Qt.FocusPolicy.NoFocus, **narrow)
            for text, on_click, kind, tip in (
                ("STOP\nEsc or F12", controller.stop, "stop", "Go to rest and end the run: Esc or F12, at any moment"),
                ("PAUSE\nF8", controller.toggle_pause, "pause", ""),
            )
        )
        self.lamps: list[InstrumentLamp] = []
        self._lamp_grid = grid(spacing=(10, 2))
        self._run = make_pane((self.task_sign, 1), self.progress_bar, spacing=2)
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)
        row(
            (self.state_sign, 9),
            (self.voltage_sign, 8),
            (self._run, 10),
            self._lamp_grid,
            self.simulated_label,
            self.pause_button,
            self.stop_button,
            parent=self,
            margins=(10, 6, 10, 2),
            spacing=10,
        )

    def scale_to_window(self, window: QSize) -> None:
        """Choose the visible parts and their size; a narrow window keeps the state, the voltage, Pause and Stop."""
        self._window_size = window
        state = BenchState.CONNECTING if self._state is None else self._state.bench_state
        height = ROW_HEIGHT
        if state in LARGE_STATES:
            height = max(min(window.height() // 9, ALARM_HEIGHTS[1]), min(window.height() // 6, ALARM_HEIGHTS[0]))
        for widget in (self.state_sign, self.voltage_sign, self.simulated_label, self.pause_button, self.stop_button):
            widget.setFixedHeight(height)
        self._run.setFixedHeight(height)
        self._run.setVisible(window.width() >= TASK_WIDTH)
        for lamp in self.lamps:
            lamp.setVisible(window.width() >= LAMPS_WIDTH and bool(lamp.instrument.role))
            lamp.show_texts(window.width() >= ROLES_WIDTH, window.width() >= IDENTITIES_WIDTH)
        # A large screen is read from further away; a narrow window has little room.
        grown = max(min(height / ALARM_HEIGHTS[0], window.width() / 1280), 0.75)
        for button, points in ((self.simulated_label, 12), (self.pause_button, 11), (self.stop_button, 13)):
            style = f"font-size: {points * grown:.0f}pt"
            if button.styleSheet() != style:
                button.setStyleSheet(style)

    def _show_again(self) -> None:
        if self._state is not None:
            view, self._state = self._state, None
            self.set_state(view)

    def set_state(self, view: WindowState) -> None:
        """Show bench state, voltage, progress and instruments."""
        last, self._state = self._state, view
        self.simulated_label.setVisible(view.simulated)
        self.stop_button.setEnabled(view.busy or bool(view.queued))
        self.pause_button.setText("GO ON\nF8" if view.paused else "PAUSING" if view.pause_requested else "PAUSE\nF8")
        self.pause_button.setToolTip(
            "Measure on, from the start of the interrupted entry: F8"
            if view.paused
            else "Go to rest and wait there; the present entry is measured again from its start: F8"
        )
        self.pause_button.setEnabled(view.can_pause and not view.pause_requested)
        if last is None or last.instruments != view.instruments:
            self._show_lamps(view.instruments)
        if last is None or last.bench_state is not view.bench_state:
            self.scale_to_window(self._window_size)
        self._show_strip()

    def tick(self) -> None:
        """Show the present volts and the run's progress; called at every tick of the window."""
        if self._state is not None and time.monotonic() - self._shown_at_s >= AGE_S:
            self._show_strip()

    def _show_strip(self) -> None:
        self._shown_at_s = time.monotonic()
        strip, colors = self._controller.strip(), self._theme.colors
        shown_as = BenchState.UNSAFE if strip.danger else strip.state
        self.state_sign.set_content(strip.state.upper(), symbol=STATE_SYMBOLS[strip.state])
        self.state_sign.set_colors(
            *colors.state_colors(shown_as), striped=strip.danger or strip.state in STRIPED_STATES
        )
        present = colors.error if strip.danger else colors.text
        self.voltage_sign.set_content(strip.measured or "–", strip.note)
        self.voltage_sign.set_colors("", present if strip.present else colors.secondary_text)
        run = strip.run
        self.task_sign.set_colors(
            "", colors.text if run.outcome is None else colors.severity_color(outcome_severity(run.outcome))
        )
        self.task_sign.set_content(run.title, run.note)
        self.progress_bar.setValue(round(1000 * run.fraction))
        for lamp in self.lamps:
            instrument = lamp.instrument
            lamp.setToolTip(f"{instrument.role}: {instrument.identity}\n{strip.instruments.get(instrument.role, '')}")

    def _show_lamps(self, instruments: tuple[InstrumentStatus, ...]) -> None:
        while len(self.lamps) < len(instruments):
            self.lamps.append(InstrumentLamp(self))
            self._lamp_grid.addWidget(self.lamps[-1], (len(self.lamps) - 1) % 2, (len(self.lamps) - 1) // 2)
        for at, lamp in enumerate(self.lamps):
            is_used = at < len(instruments)
            lamp.show_instrument(
                instruments[at] if is_used else InstrumentStatus("", "", Lamp.WAITING), self._theme.colors
            )
        self.scale_to_window(self._window_size)
