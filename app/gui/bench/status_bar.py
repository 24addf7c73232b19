"""The bench at a glance: its state, volts on the specimen, what runs and for how long, SIMULATED, and Stop."""

from PySide6.QtCore import QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPaintEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QPushButton, QSizePolicy, QVBoxLayout, QWidget

from app.common.formatting import duration
from app.gui.bench.status_sign import Sign
from app.gui.bench.symbols import SYMBOLS
from app.gui.widgets.theme import LIGHT, Theme
from app.session.state import BenchState, Instrument, Lamp, View

SYMBOL = {
    BenchState.CONNECTING: "dots",
    BenchState.IDLE: "open",
    BenchState.ARMING: "dots",
    BenchState.LIVE: "bolt",
    BenchState.PAUSED: "pause",
    BenchState.HV_OFF: "open",
    BenchState.GOING_TO_REST: "down",
    BenchState.AT_REST: "rest",
    BenchState.UNSAFE: "danger",
    BenchState.NO_BENCH: "nothing",
}
LAMP_SYMBOL = {Lamp.WAITING: "dots", Lamp.READY: "tick", Lamp.DOUBTED: "question", Lamp.ABSENT: "cross"}
USUAL = QSize(1280, 80)
"""A window's width, and a sign's height in it, that the style sheet's sizes are meant for."""

STRIPED = (BenchState.LIVE, BenchState.UNSAFE)


class LampLabel(QWidget):
    """One instrument: a lamp with a symbol in it, its role, and who it says it is, shortened where there is no room."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.instrument = Instrument("", "", Lamp.WAITING)
        self._theme = LIGHT
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_instrument(self, instrument: Instrument, theme: Theme) -> None:
        """Show an instrument."""
        self.instrument, self._theme = instrument, theme
        self.setToolTip(f"{instrument.role}: {instrument.identity}\n{instrument.lamp}")
        self.setAccessibleName(f"{instrument.role} {instrument.lamp}: {instrument.identity}")
        self.update()

    @property
    def words(self) -> str:
        """Who it is; what is wrong where something is."""
        return self.instrument.identity if self.instrument.lamp is Lamp.READY else str(self.instrument.lamp)

    def sizeHint(self) -> QSize:
        return QSize(120, self.fontMetrics().height() + 8)

    def paintEvent(self, _event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        side = self.fontMetrics().height() * 0.95
        lamp = QRectF(1, (self.height() - side) / 2, side, side)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(self._theme.lamp(self.instrument.lamp)))
        painter.drawEllipse(lamp)
        inset = side * 0.22
        painter.setPen(QColor("#101010" if self._theme.dark else "#ffffff"))
        painter.save()
        SYMBOLS[LAMP_SYMBOL[self.instrument.lamp]](painter, lamp.adjusted(inset, inset, -inset, -inset))
        painter.restore()
        left = lamp.right() + 6
        bold = self.font()
        bold.setBold(True)
        painter.setFont(bold)
        painter.setPen(QColor(self._theme.text))
        role = self.instrument.role
        flags = int(Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft)
        painter.drawText(QRectF(left, 0, self.width(), self.height()), flags, role)
        left += QFontMetricsF(bold).horizontalAdvance(role) + 6
        painter.setFont(self.font())
        painter.setPen(QColor(self._theme.dim))
        words = self.fontMetrics().elidedText(self.words, Qt.TextElideMode.ElideRight, max(int(self.width() - left), 0))
        painter.drawText(QRectF(left, 0, self.width() - left, self.height()), flags, words)
        painter.end()


class BenchBar(QWidget):
    """The top of the window, the same on every page."""

    stop_pressed = Signal()
    pause_pressed = Signal()

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self._view: View | None = None
        self.state = Sign(270)
        self.volts = Sign(236)
        self.task = Sign(200)
        self.progress = QProgressBar()
        self.progress.setRange(0, 1000)
        self.progress.setTextVisible(False)
        self.progress.setFixedHeight(12)
        self.simulated = QLabel("SIMULATED")
        self.simulated.setProperty("kind", "simulated")
        self.simulated.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.simulated.setToolTip("No real instrument is connected: every number is computed.")
        self.stop = QPushButton("STOP\nEsc or F12")
        self.stop.setProperty("kind", "stop")
        self.stop.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.stop.setToolTip("Go to rest and end the run: Esc or F12, at any moment")
        self.stop.clicked.connect(self.stop_pressed)
        self.pause = QPushButton("PAUSE\nF8")
        self.pause.setProperty("kind", "pause")
        self.pause.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.pause.clicked.connect(self.pause_pressed)
        self.lamps: list[LampLabel] = []
        self._lamp_row = QHBoxLayout()
        self._lamp_row.setSpacing(16)
        self._build()
        self.set_theme(theme)

    def _build(self) -> None:
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)
        run = QVBoxLayout()
        run.setSpacing(4)
        run.addWidget(self.task, 1)
        run.addWidget(self.progress)
        top = QHBoxLayout()
        top.setSpacing(18)
        top.addWidget(self.state, 9)
        top.addWidget(self.volts, 8)
        top.addLayout(run, 9)
        for widget in (self.simulated, self.pause, self.stop):  # else their large writing would keep a window large
            widget.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)
            widget.setMinimumWidth(72)
        top.addWidget(self.simulated)
        top.addWidget(self.pause)
        top.addWidget(self.stop)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(10, 8, 10, 4)
        layout.setSpacing(4)
        layout.addLayout(top)
        layout.addLayout(self._lamp_row)

    def set_size(self, window: QSize) -> None:
        """Signs grow with the window: who has a large screen stands further away."""
        height = min(max(window.height() // 9, 72), 130)
        for widget in (self.state, self.volts, self.simulated, self.pause, self.stop):
            widget.setFixedHeight(height)
        grown = max(min(height / USUAL.height(), window.width() / USUAL.width()), 1.0)
        for button, points in ((self.simulated, 13), (self.pause, 11), (self.stop, 13)):
            words = f"font-size: {points * grown:.0f}pt"
            if button.styleSheet() != words:
                button.setStyleSheet(words)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        if self._view is not None:
            view, self._view = self._view, None
            self.show_view(view)

    def show_view(self, view: View) -> None:
        """Show the bench's part of a view."""
        last, self._view = self._view, view
        self.state.say(view.state.upper(), symbol=SYMBOL[view.state])
        self.state.colour(*self._theme.state(view.state), striped=view.state in STRIPED)
        self.volts.say(view.volts, view.volts_note)
        self.volts.colour("", self._theme.bad if view.state is BenchState.UNSAFE else self._theme.text)
        self.task.colour("", self._theme.text)
        self.simulated.setVisible(view.simulated)
        self.stop.setEnabled(view.busy)
        self.pause.setText("GO ON\nF8" if view.paused else "PAUSING" if view.pausing else "PAUSE\nF8")
        self.pause.setToolTip(
            "Measure on, from the start of the interrupted entry: F8"
            if view.paused
            else "Go to rest and wait there; the present entry is measured again from its start: F8"
        )
        self.pause.setEnabled(view.can_pause and not view.pausing)
        if last is None or last.instruments != view.instruments:
            self._show_lamps(view.instruments)
        self.show_progress(0.0 if view.progress is None else view.progress.at_s)

    def show_progress(self, streamed_s: float) -> None:
        """Count down between what the runner tells."""
        view = self._view
        if view is None:
            return
        progress, fraction = view.progress, 0.0
        flagged = f", {view.unusable} not usable" if view.unusable else ""
        if progress is None:
            ended = "no run yet" if view.outcome is None else str(view.outcome.status)
            title, note = view.bench, ended if view.connected else ""
        elif view.busy:
            fraction = progress.fraction_at(streamed_s)
            title = f"{progress.title} · {progress.label}" if progress.label else progress.title
            left = duration(progress.left_at(streamed_s))
            note = (
                f"{progress.done} of {progress.entries} points{flagged}, {left} left" if progress.entries else "begins"
            )
        else:
            ended = f"{view.outcome.status}, " if view.outcome is not None else ""
            fraction = progress.done / max(progress.entries, 1)
            title, note = progress.title, f"{ended}{progress.done} of {progress.entries} points{flagged}"
        self.task.say(title, note)
        self.progress.setValue(round(1000 * fraction))

    def _show_lamps(self, instruments: tuple[Instrument, ...]) -> None:
        while len(self.lamps) < len(instruments):
            self.lamps.append(LampLabel(self))
            self._lamp_row.addWidget(self.lamps[-1])
        for at, label in enumerate(self.lamps):
            label.setVisible(at < len(instruments))
            if at < len(instruments):
                label.show_instrument(instruments[at], self._theme)
                self._lamp_row.setStretch(at, 6 + len(instruments[at].role) + len(label.words))
