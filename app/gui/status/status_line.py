"""Status line of the window: the last event with Undo, the log's button, and the lamps of the instruments."""

from collections.abc import Callable, Mapping

from PySide6.QtCore import QRectF, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.common import Severity, typeset
from app.gui.face import (
    CLASS_S,
    STATUS_HEIGHT,
    class_of,
    draw_icon,
    draw_text,
    painting,
    px,
    set_length,
    text_width,
    tokens,
)
from app.gui.widgets import (
    ACTIONS,
    ElidedLabel,
    IconView,
    configure,
    make_button,
    make_label,
    over,
    row,
    set_tone,
    tooltip,
)
from app.session import InstrumentStatus, Lamp, LogLine, WindowState

UNDO_MS = 10_000
"""How long an action can be taken back from the status line."""

MARKS = {
    Severity.INFO: ("", ""),
    Severity.SUCCESS: ("good", "green"),
    Severity.WARNING: ("warning", "amber"),
    Severity.ERROR: ("error", "red_line"),
}
"""Icon and token of its colour, by severity."""
LAMP_SIGNS = {
    Lamp.WAITING: ("waiting", "text2"),
    Lamp.READY: MARKS[Severity.SUCCESS],
    Lamp.SUSPECT: MARKS[Severity.WARNING],
    Lamp.MISSING: MARKS[Severity.ERROR],
}
"""Icon and token of its colour, by the lamp of an instrument."""

SHORT_ROLES = {"generator": "Gen", "amplifier": "Amp", "card": "Card", "sensor": "Laser"}
"""Names of lamps in a small window."""


class InstrumentLamp(QWidget):
    """Lamp of one instrument with its name: a tick in a disc, a triangle, an octagon or an empty ring."""

    def __init__(self) -> None:
        super().__init__()
        self.instrument = InstrumentStatus("", "", Lamp.WAITING)
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Expanding)

    def show_instrument(self, instrument: InstrumentStatus) -> None:
        if instrument != self.instrument:
            self.instrument = instrument
            self.setAccessibleName(f"{instrument.role} {instrument.lamp}: {instrument.identity}")
            self.updateGeometry()
            self.update()

    @property
    def text(self) -> str:
        """Name of the instrument's role."""
        role = self.instrument.role
        return SHORT_ROLES.get(role, role.capitalize()) if class_of(self) is CLASS_S else role.capitalize()

    def sizeHint(self) -> QSize:
        return QSize(round(px(22) + text_width(self.text, "caption")) + 1, px(20))

    def paintEvent(self, _event: QPaintEvent) -> None:
        colors, lamp = tokens(), self.instrument.lamp
        side, left = px(14), px(20)
        (icon, of), usual = LAMP_SIGNS[lamp], lamp in (Lamp.READY, Lamp.WAITING)
        color = str(getattr(colors, of))
        with painting(self) as painter:
            draw_icon(painter, icon, QRectF(1, (self.height() - side) / 2, side, side), color, over(color))
            area, ink = QRectF(left, 0, self.width() - left, self.height()), colors.text2 if usual else colors.text
            draw_text(painter, area, self.text, ink, "" if usual else "caption")


class WindowStatusLine(QWidget):
    """The bottom of the window, the same on every page; an error stays until something else than a plain event follows."""

    log_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        configure(self, "status", kind="bar")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self._undo: Callable[[], object] | None = None
        self._severity, self._seen_count = Severity.INFO, 0
        self.time_label = make_label(kind="note", wrap=False, name="status.time")
        self.mark = IconView(16)
        self.mark.hide()
        self.label = configure(ElidedLabel(), "status.event")
        self.label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.undo_button = make_button("Undo", self._on_undo, "link", name="status.undo", key="Ctrl Z")
        log = "link", tooltip("log"), "status.log", ACTIONS["log"].shortcut
        self.log_button = make_button("Log", self.log_requested.emit, *log)
        rule = make_label(kind="rule")
        set_length(rule, 1, 16)
        self.lamps: list[InstrumentLamp] = []
        self._lamp_row = row(spacing=14)
        self.undo_button.hide()
        row(
            self.time_label,
            self.mark,
            (self.label, 1),
            self.undo_button,
            self.log_button,
            rule,
            self._lamp_row,
            parent=self,
            margins=(12, 0, 12, 0),
            spacing=8,
        )
        self._undo_timer = QTimer(self, singleShot=True, interval=UNDO_MS)
        self._undo_timer.timeout.connect(self._drop_undo)
        set_length(self, height=STATUS_HEIGHT)

    def set_state(self, view: WindowState) -> None:
        new = view.message_count - self._seen_count
        self._seen_count = view.message_count
        for line in view.messages[-new:] if new > 0 else ():
            self.show_line(line)
        while len(self.lamps) < len(view.instruments):
            self.lamps.append(InstrumentLamp())
            self._lamp_row.addWidget(self.lamps[-1])
        for lamp, instrument in zip(self.lamps, view.instruments, strict=False):
            lamp.show_instrument(instrument)

    def show_answers(self, answers: Mapping[str, str]) -> None:
        """Show by role why an instrument is suspect, or its status, and when it answered last."""
        for lamp in self.lamps:
            instrument = lamp.instrument
            text = f"{instrument.role}: {instrument.identity}\n{answers.get(instrument.role, '')}"
            if text != lamp.toolTip():
                lamp.setToolTip(text)

    def show_line(self, line: LogLine, undo: Callable[[], object] | None = None) -> None:
        """Show an event; `undo` reverses it, for ten seconds."""
        if self._severity is Severity.ERROR and line.severity is Severity.INFO and undo is None:
            return
        self._severity, self._undo = line.severity, undo
        self.time_label.setText(f"{line.time:%H:%M:%S}" if line.text else "")
        self.mark.show_icon(*MARKS[line.severity])
        self.mark.setVisible(bool(MARKS[line.severity][0]))
        self.label.setText(typeset(" ".join(line.text.split())))
        self.label.setToolTip(line.text)
        set_tone(self.label, line.severity)
        self.undo_button.setVisible(undo is not None)
        if undo is not None:
            self._undo_timer.start()

    def acknowledge(self) -> None:
        """Let the next event replace an error: the log was opened."""
        self._severity = Severity.INFO

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        for lamp in self.lamps:
            lamp.updateGeometry()

    def _on_undo(self) -> None:
        undo = self._undo
        self._drop_undo()
        if undo is not None:
            undo()

    def _drop_undo(self) -> None:
        self._undo = None
        self.undo_button.hide()
