"""Drawer of the simulated bench (F9): its speed, who answers its prompts, and a switch for every fault."""

from PySide6.QtCore import QRectF, QSize, Signal
from PySide6.QtGui import QColor, QPaintEvent
from PySide6.QtWidgets import QCheckBox, QFrame, QSizePolicy, QWidget

from app.common import pluralize, sentence_case
from app.gui.face import draw_box, draw_hatch, draw_ring, draw_text, painting, px, set_length, tokens
from app.gui.status.simulation_controls import SimulationControls
from app.gui.widgets import (
    UPRIGHT,
    BackgroundWorker,
    OverlayCard,
    Place,
    add_actions,
    column,
    configure,
    make_button,
    make_label,
    make_scroll_area,
    row,
    show_text,
    tooltip,
)
from app.session import FaultPlan, WindowState
from sim_hardware.plant import FAULTS

GROUPS = ("Wires and generator", "Generator’s answers", "Amplifier and card", "Sensor and specimen", "Interlock")


class FaultSwitch(QCheckBox):
    """A row with the name of a fault, and a switch at its right end."""

    def sizeHint(self) -> QSize:
        return QSize(px(240), px(24))

    def hitButton(self, at: object) -> bool:  # noqa: ARG002 - the whole row can be clicked
        return True

    def paintEvent(self, _event: QPaintEvent) -> None:
        colors, on = tokens(), self.isChecked()
        track = QRectF(self.width() - px(46), (self.height() - px(16)) / 2, px(30), px(16))
        knob = QRectF(track.right() - px(13) if on else track.left() + px(3), track.y() + px(3), px(10), px(10))
        with painting(self) as painter:
            if on:
                painter.fillRect(self.rect(), QColor(colors.accent_tint))
            area = QRectF(px(16), 0, self.width() - px(72), self.height())
            color = colors.text if self.isEnabled() else colors.text2
            draw_text(painter, area, self.text(), color, "caption" if on else "")
            draw_box(
                painter, track, px(8), colors.accent if on else colors.surface, colors.accent if on else colors.outline, 1.25
            )  # fmt: skip
            draw_box(painter, knob, px(5), "white" if on else colors.outline)
            if self.hasFocus():
                draw_ring(painter, self.rect(), colors.accent_text)


class _HatchedHead(QFrame):
    """Head of the drawer on the hatch of SIMULATED."""

    def __init__(self, *labels: QWidget) -> None:
        super().__init__()
        row(labels[0], None, *labels[1:], parent=self, margins=(16, 0, 16, 0))
        set_length(self, height=40)

    def paintEvent(self, _event: QPaintEvent) -> None:
        with painting(self) as painter:
            draw_hatch(painter, QRectF(self.rect()), tokens().violet2, QColor(tokens().violet))


class FaultDrawer(OverlayCard):
    """Lies over the page at its right; F9 opens and closes it.

    Args:
        plan: injects and clears faults; called in this drawer's background thread.
        parent: in which the shortcuts work.
        controls: shown above the list; None for none.
    """

    faults_changed = Signal(int)
    """Number of active faults."""

    def __init__(self, plan: FaultPlan, parent: QWidget, controls: SimulationControls | None = None) -> None:
        content = QWidget()
        super().__init__("faults.drawer", content, Place.RIGHT)
        self.controls = controls
        self._plan, self._worker, self._connected = plan, BackgroundWorker("faults", self), False
        self.active_faults: tuple[str, ...] = ()
        """Active faults as reported by the bench."""
        self.count_label = make_label(wrap=False, name="faults.count")
        self.message_label = make_label(kind="fault", name="faults.message", visible=False)
        self.clear_button = make_button(
            "All faults off",
            lambda: self._switch_fault("", active=False),
            name="faults.clear",
            tip=tooltip("faults.clear"),
            key="Shift+F9",
        )
        self.fault_boxes = {
            name: configure(
                FaultSwitch(fault["short"]),
                f"faults.{name}",
                toolTip=f"{sentence_case(fault['description'])}\nAt a command line: run ... --fault {name}@5",
                accessibleName=f"inject: {fault['description']}",
                sizePolicy=QSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed),
            )
            for name, fault in FAULTS.items()
        }
        self._build(content)
        add_actions(parent, {"faults.toggle": self.toggle, "faults.clear": self.clear_button.click})

    def set_state(self, view: WindowState) -> None:
        """Read the active faults again when the connection changes."""
        if self.controls is not None:
            self.controls.set_state(view)
        if view.connected != self._connected:
            self._connected = view.connected
            self._worker.submit(self._plan.active_faults, self._show_faults, self._on_error)

    def toggle(self) -> None:
        if not self.isHidden():
            self.dismiss()
            return
        if self.controls is not None:
            self.controls.on_list_opened()
        first = next(iter(self.fault_boxes.values())) if self.controls is None else self.controls.first_widget
        self.open(first)

    def _switch_fault(self, name: str, active: bool) -> None:
        """Inject or clear a fault, or with no name clear all; then read the active faults."""

        def act() -> tuple[str, ...]:
            if active:
                self._plan.inject(name)
            else:
                self._plan.clear(name or None)
            return self._plan.active_faults()

        self._worker.submit(act, self._show_faults, self._on_error)

    def _show_faults(self, active: tuple[str, ...]) -> None:
        self.active_faults = active
        self._show_message("")
        self.count_label.setText(f"{pluralize(len(active), 'fault')} on" if active else "")
        self.faults_changed.emit(len(active))

    def _on_error(self, error: Exception) -> None:
        self._show_message(str(error))

    def _show_message(self, text: str) -> None:
        show_text(self.message_label, text)
        for name, box in self.fault_boxes.items():
            box.setChecked(name in self.active_faults)

    def _build(self, content: QWidget) -> None:
        title = make_label("Simulation", "heading", wrap=False)
        for label in (title, self.count_label):
            label.setProperty("on", "violet")
        rows: list[QWidget] = []
        for group in GROUPS:
            caption = make_label(group, "caption", wrap=False)
            caption.setContentsMargins(px(16), px(8), 0, px(2))
            rows += [caption, *(box for name, box in self.fault_boxes.items() if FAULTS[name]["group"] == group)]
        for name, box in self.fault_boxes.items():
            box.clicked.connect(lambda broken, name=name: self._switch_fault(name, broken))
        faults = make_scroll_area(*rows, None, spacing=0, **UPRIGHT)
        close = make_button("Close", self.toggle, name="faults.close", key="F9")
        above = [] if self.controls is None else [row((self.controls, 1), margins=(16, 16, 16, 12))]
        column(
            _HatchedHead(title, self.count_label),
            *above,
            row(self.message_label, margins=(16, 0, 16, 0)),
            (faults, 1),
            row(self.clear_button, None, close, margins=(16, 10, 16, 10)),
            parent=content,
            spacing=0,
        )
