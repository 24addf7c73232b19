"""Slider panel: a slider, a text field that accepts units and a reset button for every model parameter."""

from collections.abc import Iterable

from PySide6.QtCore import QRectF, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QColor, QPaintEvent, QWheelEvent
from PySide6.QtWidgets import QGridLayout, QLabel, QLineEdit, QSlider, QToolButton, QWidget

from app.common import PEAK_TO_PEAK, PLAIN_NUMBER, TRUE_MINUS, UnitError, read_number, sentence_case, typeset
from app.explore import DRIVE_SLIDER, GROUPS, SKIN_PARAMETERS, ExploreSetting, SliderSpec
from app.gui.face import painting, set_length, tokens
from app.gui.widgets import TrueMinus, column, configure, grid, make_label, set_style_kind
from model import ParameterError, ParameterSpec, variable_specs

SLIDER_STEPS = 1000
HANDLE_PX = 14  # as in the style sheet


class _Slider(QSlider):
    """A slider that ignores the mouse wheel, which scrolls the panel instead, with a tick at the paper's value."""

    usual = 0.0  # position of the tick, 0 to 1

    def wheelEvent(self, event: QWheelEvent) -> None:
        event.ignore()

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        at = HANDLE_PX / 2 + self.usual * (self.width() - HANDLE_PX)
        with painting(self) as painter:
            painter.fillRect(QRectF(at - 0.5, self.height() / 2 + HANDLE_PX / 2, 1.5, 4), QColor(tokens().text2))


class SliderRow:
    """Label, slider, text field, unit and reset button of one parameter."""

    def __init__(self, spec: SliderSpec, quantity: ParameterSpec, panel: "SliderPanel") -> None:
        self.spec, self._quantity, self._panel = spec, quantity, panel
        self.label = QLabel(typeset(sentence_case(spec.label)))
        self.slider_widget = configure(
            _Slider(Qt.Orientation.Horizontal), maximum=SLIDER_STEPS, singleStep=5, pageStep=50, minimumWidth=40
        )
        self.slider_widget.usual = spec.position(float(quantity.default or 0.0))
        self.field = configure(QLineEdit(), alignment=Qt.AlignmentFlag.AlignRight)
        self.field.setValidator(TrueMinus(self.field))
        set_length(self.field, width=70)
        self.unit = QLabel(spec.unit.replace("^2", "²"))
        self.reset_button = configure(QToolButton(), text="↺", autoRaise=True, toolTip="Back")
        hint = f"{quantity.description}\n{quantity.limits}; the field takes values beyond the slider's ends, and units"
        for widget in (self.label, self.slider_widget, self.field):
            widget.setToolTip(hint)
        self.label.setBuddy(self.field)
        self.slider_widget.setAccessibleName(spec.label)
        self.field.setAccessibleName(f"{spec.label} in {spec.unit}")
        self.reset_button.setAccessibleName(f"reset {spec.label}")
        self.slider_widget.valueChanged.connect(self._on_slider_moved)
        self.field.returnPressed.connect(self._on_text_entered)
        self.field.editingFinished.connect(self._on_text_entered)
        self.reset_button.clicked.connect(lambda: panel.reset_requested.emit(spec.name))

    def show_value(self, value: float, moved: bool, in_use: bool) -> None:
        """Show a value; `moved`: it differs from the default; `in_use`: it affects the model."""
        with QSignalBlocker(self.slider_widget):
            if not self.slider_widget.isSliderDown():
                self.slider_widget.setValue(round(SLIDER_STEPS * self.spec.position(value)))
        if not (self.field.hasFocus() and self.field.isModified()):
            text = self.spec.format_value(value)
            if self.field.text() != text:
                self.field.setText(text)
            set_style_kind(self.field, "")
            self.field.setModified(False)
        self.reset_button.setEnabled(moved)
        self.reset_button.setText("↺" if moved else "")
        set_style_kind(self.label, "moved" if moved else "" if in_use else "note-size")

    def _on_slider_moved(self, position: int) -> None:
        self.field.setModified(False)
        self._panel.value_changed.emit(self.spec.name, self.spec.value_at(position / SLIDER_STEPS))

    def _on_text_entered(self) -> None:
        if not self.field.isModified():
            return
        text = self.field.text().strip().replace(TRUE_MINUS, "-")
        try:
            if PLAIN_NUMBER.fullmatch(text):  # in the displayed unit
                value = float(self._quantity.check(float(text) / self.spec.factor))
            else:
                value = read_number(text, self._quantity)
        except (UnitError, ParameterError) as error:
            set_style_kind(self.field, "faulty")
            self._panel.input_rejected.emit(str(error))
            return
        self.field.setModified(False)
        self._panel.value_changed.emit(self.spec.name, value)


class SliderPanel(QWidget):
    """The sliders in groups."""

    value_changed = Signal(str, float)
    """A parameter's name and its new value, SI."""
    reset_requested = Signal(str)
    input_rejected = Signal(str)
    """Why the typed value is not valid."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: dict[str, SliderRow] = {}
        layout = column(parent=self, margins=(0, 0, 8, 0), spacing=4)
        specs = variable_specs()
        for title, sliders in GROUPS.items():
            layout.addWidget(make_label(title, "caption", wrap=False))
            layout.addLayout(self._group_layout((s, specs[s.name]) for s in sliders))
            if title == "Tactor":
                layout.addWidget(make_label("Drive", "caption", wrap=False))
                layout.addLayout(self._group_layout([(DRIVE_SLIDER, PEAK_TO_PEAK)]))
        layout.addStretch()

    def show_setting(self, setting: ExploreSetting) -> None:
        values = setting.all_values
        for name, row in self.rows.items():
            if name == DRIVE_SLIDER.name:
                row.show_value(setting.peak_to_peak_v, setting.peak_to_peak_v != PEAK_TO_PEAK.default, True)
            else:
                row.show_value(values[name], name in setting.values, setting.on_skin or name not in SKIN_PARAMETERS)

    def _group_layout(self, sliders: Iterable[tuple[SliderSpec, ParameterSpec]]) -> QGridLayout:
        layout = grid(spacing=(4, 1), stretch={1: 1})
        for place, width in ((0, 150), (3, 56), (4, 20)):
            layout.setColumnMinimumWidth(place, width)
        for at, (slider, quantity) in enumerate(sliders):
            row = SliderRow(slider, quantity, self)
            for place, widget in enumerate((row.label, row.slider_widget, row.field, row.unit, row.reset_button)):
                layout.addWidget(widget, at, place)
            self.rows[slider.name] = row
        return layout
