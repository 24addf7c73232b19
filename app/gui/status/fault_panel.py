"""Panel of the simulated bench: fault injection, and controls above the list of faults."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QCheckBox, QFrame, QLabel, QPushButton, QScrollArea, QSizePolicy, QWidget
from shiboken6 import isValid

from app.gui.status.simulation_controls import SimulationControls
from app.gui.widgets import (
    BackgroundWorker,
    add_actions,
    column,
    configure,
    grid,
    make_button,
    name_button,
    row,
    shortcut_label,
)
from app.session import FaultPlan, WindowState
from sim_hardware.plant import FAULT_DESCRIPTIONS

COLUMNS = 2


class FaultPanel(QWidget):
    """Band that lists the active faults and, on F9, check boxes for every fault. No popup: it would take the Stop key.

    Args:
        plan: injects and clears faults; called in this panel's background thread.
        controls: shown above the list; None for none.
    """

    def __init__(self, plan: FaultPlan, parent: QWidget, controls: SimulationControls | None = None) -> None:
        super().__init__(parent)
        self.controls = controls
        self._plan, self._worker = plan, BackgroundWorker("faults", self)
        self._connected = False
        self._previous_focus: QWidget | None = None
        """Widget that had the focus before the list was opened."""
        self.active_faults: tuple[str, ...] = ()
        """Active faults as reported by the bench."""
        self.corner = QWidget()
        self.open_button = configure(QPushButton(), "faults.toggle", kind="choice", checkable=True)
        name_button(self.open_button, "faults.toggle", "Simulation …")
        self.open_button.toggled.connect(self._set_open)
        self.band = configure(QFrame(), "faults.active", kind="broken")
        self.band_label = configure(QLabel(), "faults.active-label", wordWrap=True)
        self.message_label = configure(QLabel(), "faults.message", kind="fault")
        self.clear_button = make_button(
            shortcut_label("Clear all faults", "faults.clear"),
            lambda: self._switch_fault("", active=False),
            name="faults.clear",
        )
        self.fault_boxes = {
            name: configure(
                QCheckBox(f"{description[0].upper()}{description[1:]}"),
                f"faults.{name}",
                toolTip=f"{name}: inject or clear it. At a command line: run ... --fault {name}@5",
                accessibleName=f"inject: {description}",
                # rather cut off than a wider window
                sizePolicy=QSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred),
            )
            for name, description in FAULT_DESCRIPTIONS.items()
        }
        self.list, self._sheet = QScrollArea(), QWidget()
        self._build()
        add_actions(parent, {"faults.toggle": self.open_button.click, "faults.clear": self.clear_button.click})

    def set_state(self, view: WindowState) -> None:
        """Read the active faults again when the connection changes."""
        if self.controls is not None:
            self.controls.set_state(view)
        if view.connected != self._connected:
            self._connected = view.connected
            self._worker.submit(self._plan.active_faults, self._show_faults, self._on_error)

    def close_list(self) -> bool:
        """Close the list and return whether it was open."""
        was_open = self.open_button.isChecked()
        self.open_button.setChecked(False)
        return was_open

    def limit_height(self, height: int) -> None:
        """Limit the height of the list, which scrolls beyond it."""
        self.list.setMaximumHeight(min(height, self._sheet.sizeHint().height() + 4))

    def shutdown(self) -> None:
        """Stop background threads."""
        self._worker.close()

    def _set_open(self, open_: bool) -> None:
        self.list.setVisible(open_)
        self._update_visibility()
        if open_:
            self._previous_focus = QApplication.focusWidget()
            first: QWidget = next(iter(self.fault_boxes.values()))
            if self.controls is not None:
                first = self.controls.first_widget
                QWidget.setTabOrder(self.controls.answered_by_box, next(iter(self.fault_boxes.values())))
            first.setFocus(Qt.FocusReason.ShortcutFocusReason)
        elif self._previous_focus is not None and isValid(self._previous_focus):
            self._previous_focus.setFocus()

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
        self.message_label.setText("")
        self.band_label.setText(f"FAULT INJECTED:  {';  '.join(FAULT_DESCRIPTIONS[name] for name in active)}")
        self._update_visibility()

    def _on_error(self, error: Exception) -> None:
        self.message_label.setText(str(error))
        self._update_visibility()

    def _update_visibility(self) -> None:
        for name, box in self.fault_boxes.items():
            box.setChecked(name in self.active_faults)
        self.band.setVisible(bool(self.active_faults))
        self.message_label.setVisible(bool(self.message_label.text()))
        self.setVisible(bool(self.active_faults) or self.open_button.isChecked())

    def _build(self) -> None:
        row((self.band_label, 1), self.clear_button, parent=self.band, margins=(12, 4, 8, 4))
        rows = -(-len(self.fault_boxes) // COLUMNS)
        above = () if self.controls is None else ((self.controls, 0, 0, 1, COLUMNS),)
        first = len(above)
        grid(
            *above,
            *((box, first + at % rows, at // rows) for at, box in enumerate(self.fault_boxes.values())),
            (self.message_label, first + rows, 0, 1, COLUMNS),
            parent=self._sheet,
            margins=(12, 6, 12, 6),
            spacing=(-1, 2),
        )
        for name, box in self.fault_boxes.items():
            box.clicked.connect(lambda broken, name=name: self._switch_fault(name, broken))
        self.list.setWidget(self._sheet)
        configure(
            self.list,
            "faults.list",
            focusPolicy=Qt.FocusPolicy.NoFocus,
            widgetResizable=True,
            horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff,
            minimumHeight=48,  # a notice above it may need the space: then it scrolls
            sizePolicy=QSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Expanding),
        )
        column(self.band, self.list, parent=self, margins=(10, 0, 10, 0), spacing=4)
        self.list.hide()
        column(self.open_button, parent=self.corner, margins=(0, 0, 0, 5))
        self._update_visibility()
