"""Sliders for every number of the model, each with a field that understands units and a way back."""

from collections.abc import Iterable

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QGridLayout, QLabel, QLineEdit, QSlider, QToolButton, QVBoxLayout, QWidget

from app.common.units import PEAK_TO_PEAK, UnitError, read_number
from app.explore.sliders import GROUPS, Slider
from app.explore.state import DRIVE, OF_SKIN, Setting
from app.gui.widgets.form import mark
from model.parameter_spec import ParameterError, Quantity
from model.specimen import variables

STEPS = 1000


class _Slider(QSlider):
    """Does not turn with the wheel: the wheel scrolls the panel it is in."""

    def wheelEvent(self, event: QWheelEvent) -> None:
        event.ignore()


class SliderRow:
    """Name, slider, field, unit and the way back of one number."""

    def __init__(self, slider: Slider, quantity: Quantity, panel: "SliderPanel") -> None:
        self.slider, self._quantity, self._panel = slider, quantity, panel
        self.label = QLabel(slider.label)
        self.bar = _Slider(Qt.Orientation.Horizontal)
        self.bar.setRange(0, STEPS)
        self.bar.setSingleStep(5)
        self.bar.setPageStep(50)
        self.bar.setMinimumWidth(70)
        self.field = QLineEdit()
        self.field.setFixedWidth(78)
        self.unit = QLabel(slider.unit.replace("^2", "²"))
        self.back = QToolButton()
        self.back.setText("↺")
        self.back.setAutoRaise(True)
        self.back.setToolTip("Back")
        hint = f"{quantity.words}\n{quantity.limits}; the field takes values beyond the slider's ends, and units"
        for widget in (self.label, self.bar, self.field):
            widget.setToolTip(hint)
        self.label.setBuddy(self.field)
        self.bar.setAccessibleName(slider.label)
        self.field.setAccessibleName(f"{slider.label} in {slider.unit}")
        self.back.setAccessibleName(f"reset {slider.label}")
        self.bar.valueChanged.connect(self._slid)
        self.field.returnPressed.connect(self._typed)
        self.field.editingFinished.connect(self._typed)
        self.back.clicked.connect(lambda: panel.reset.emit(slider.name))

    def show_value(self, value: float, moved: bool, in_use: bool) -> None:
        """Stand where a setting says."""
        with QSignalBlocker(self.bar):
            if not self.bar.isSliderDown():
                self.bar.setValue(round(STEPS * self.slider.place(value)))
        if not (self.field.hasFocus() and self.field.isModified()):
            text = self.slider.text(value)
            if self.field.text() != text:
                self.field.setText(text)
            mark(self.field, "")
            self.field.setModified(False)
        self.back.setEnabled(moved)
        self.back.setText("↺" if moved else "")
        mark(self.label, "moved" if moved else "" if in_use else "note-size")

    def _slid(self, place: int) -> None:
        self.field.setModified(False)
        self._panel.moved.emit(self.slider.name, self.slider.value(place / STEPS))

    def _typed(self) -> None:
        if not self.field.isModified():
            return
        text = self.field.text().strip()
        try:
            try:
                value = float(self._quantity.check(float(text) / self.slider.factor))
            except ValueError as error:
                if isinstance(error, ParameterError):
                    raise
                value = read_number(text, self._quantity)
        except (UnitError, ParameterError) as error:
            mark(self.field, "faulty")
            self._panel.refused.emit(str(error))
            return
        self.field.setModified(False)
        self._panel.moved.emit(self.slider.name, value)


class SliderPanel(QWidget):
    """All of them, in groups."""

    moved = Signal(str, float)
    """A number's name and its new value, SI."""
    reset = Signal(str)
    refused = Signal(str)
    """Why what was typed cannot be."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.rows: dict[str, SliderRow] = {}
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 8, 0)
        layout.setSpacing(4)
        known = variables()
        for title, sliders in GROUPS.items():
            layout.addWidget(_caption(title))
            layout.addLayout(self._group((s, known[s.name]) for s in sliders))
            if title == "Tactor":
                layout.addWidget(_caption("Drive"))
                layout.addLayout(self._group([(DRIVE, PEAK_TO_PEAK)]))
        layout.addStretch()

    def show_setting(self, setting: Setting) -> None:
        """Stand as a setting says."""
        values = setting.everything
        for name, row in self.rows.items():
            if name == DRIVE.name:
                row.show_value(setting.peak_to_peak_v, setting.peak_to_peak_v != PEAK_TO_PEAK.default, True)
            else:
                row.show_value(values[name], name in setting.values, setting.on_skin or name not in OF_SKIN)

    def _group(self, sliders: Iterable[tuple[Slider, Quantity]]) -> QGridLayout:
        grid = QGridLayout()
        grid.setHorizontalSpacing(6)
        grid.setVerticalSpacing(1)
        grid.setColumnStretch(1, 1)
        grid.setColumnMinimumWidth(0, 150)
        grid.setColumnMinimumWidth(3, 56)
        grid.setColumnMinimumWidth(4, 24)
        for at, (slider, quantity) in enumerate(sliders):
            row = SliderRow(slider, quantity, self)
            for column, widget in enumerate((row.label, row.bar, row.field, row.unit, row.back)):
                grid.addWidget(widget, at, column)
            self.rows[slider.name] = row
        return grid


def _caption(words: str) -> QLabel:
    label = QLabel(words)
    label.setProperty("kind", "caption")
    return label
