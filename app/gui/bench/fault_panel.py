"""For lessons on the simulated bench: what can be broken, ticked to break it, and a band that says what is broken."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QApplication,
    QCheckBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)
from shiboken6 import isValid

from app.gui.widgets.background import Jobs
from app.gui.widgets.form import mark
from app.gui.widgets.shortcuts import bind
from app.session.fault_injection import FaultPlan
from app.session.state import View
from sim_hardware.plant.faults import FAULTS

COLUMNS = 2


class FaultPanel(QWidget):
    """A band while something is broken, and on F9 the list below it. Nothing drops down: it would keep the Stop key.

    Args:
        plan: breaks and mends the bench; asked in a thread of this panel's own.
    """

    def __init__(self, plan: FaultPlan, parent: QWidget) -> None:
        super().__init__(parent)
        self._plan, self._jobs = plan, Jobs("faults", self)
        self._connected = False
        self._before: QWidget | None = None
        """What had the keyboard before the list was opened."""
        self.broken: tuple[str, ...] = ()
        """What is broken, as the bench itself says."""
        self.corner = QWidget()
        self.opener = QPushButton("Break something …   (F9)")
        mark(self.opener, "choice")
        self.opener.setCheckable(True)
        self.opener.setToolTip("Faults of the simulated bench, to see what the program does about them: F9")
        self.opener.toggled.connect(self._open)
        self.band, self.words, self.said = QFrame(), QLabel(), QLabel()
        mark(self.band, "broken")
        mark(self.said, "fault")
        self.words.setWordWrap(True)
        self.mend = QPushButton("Mend all   (Shift+F9)")
        self.mend.clicked.connect(lambda: self._act("", broken=False))
        self.list, self._sheet = QScrollArea(), QWidget()
        self.boxes = {name: QCheckBox(f"{words[0].upper()}{words[1:]}") for name, words in FAULTS.items()}
        self._build()
        bind(parent, "Break something on the simulated bench, or close the list", self.opener.click, Qt.Key.Key_F9)
        bind(parent, "Mend all that was broken", self.mend.click, "Shift+F9")

    def show_view(self, view: View) -> None:
        """Another bench is whole until it says otherwise."""
        if view.connected != self._connected:
            self._connected = view.connected
            self._jobs.do(self._plan.broken, self._show, self._failed)

    def close_list(self) -> bool:
        """Close the list; whether it was open."""
        was_open = self.opener.isChecked()
        self.opener.setChecked(False)
        return was_open

    def end(self) -> None:
        """End what works beside the window."""
        self._jobs.close()

    def _open(self, wanted: bool) -> None:
        self.list.setVisible(wanted)
        self._arrange()
        if wanted:
            self._before = QApplication.focusWidget()
            next(iter(self.boxes.values())).setFocus(Qt.FocusReason.ShortcutFocusReason)
        elif self._before is not None and isValid(self._before):
            self._before.setFocus()

    def _act(self, name: str, broken: bool) -> None:
        """Break one, mend one, or with no name mend all; then ask the bench what is broken."""

        def act() -> tuple[str, ...]:
            if broken:
                self._plan.inject(name)
            else:
                self._plan.clear(name or None)
            return self._plan.broken()

        self._jobs.do(act, self._show, self._failed)

    def _show(self, broken: tuple[str, ...]) -> None:
        self.broken = broken
        self.said.setText("")
        self.words.setText(f"BROKEN ON PURPOSE:  {';  '.join(FAULTS[name] for name in broken)}")
        self._arrange()

    def _failed(self, error: Exception) -> None:
        self.said.setText(str(error))
        self._arrange()

    def _arrange(self) -> None:
        for name, box in self.boxes.items():
            box.setChecked(name in self.broken)
        self.band.setVisible(bool(self.broken))
        self.said.setVisible(bool(self.said.text()))
        self.setVisible(bool(self.broken) or self.opener.isChecked())

    def _build(self) -> None:
        row = QHBoxLayout(self.band)
        row.setContentsMargins(12, 4, 8, 4)
        row.addWidget(self.words, 1)
        row.addWidget(self.mend)
        grid = QGridLayout(self._sheet)
        grid.setContentsMargins(12, 6, 12, 6)
        grid.setVerticalSpacing(2)
        rows = -(-len(self.boxes) // COLUMNS)
        for at, (name, box) in enumerate(self.boxes.items()):
            box.setToolTip(f"{name}: break it, or mend it. At a command line: run ... --fault {name}@5")
            box.setAccessibleName(f"break: {FAULTS[name]}")
            box.setSizePolicy(
                QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred
            )  # rather cut off than a wider window
            box.clicked.connect(lambda broken, name=name: self._act(name, broken))
            grid.addWidget(box, at % rows, at // rows)
        grid.addWidget(self.said, rows, 0, 1, COLUMNS)
        self.list.setWidget(self._sheet)
        self.list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.list.setWidgetResizable(True)
        self.list.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.list.setMinimumHeight(48)  # a notice above it may need the room: then it is scrolled
        self.list.setMaximumHeight(self._sheet.sizeHint().height() + 4)
        self.list.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Expanding)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(10, 0, 10, 0)
        layout.setSpacing(4)
        layout.addWidget(self.band)
        layout.addWidget(self.list)
        self.list.hide()
        corner = QVBoxLayout(self.corner)
        corner.setContentsMargins(0, 0, 0, 5)
        corner.addWidget(self.opener)
        self._arrange()
