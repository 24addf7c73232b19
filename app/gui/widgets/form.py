"""Protocol form generated from annotated fields: values with units, validated at every edit."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Literal, get_args, get_origin

from annotated_types import Interval
from pydantic import BaseModel, ValidationError
from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QFontMetrics, QTextOption
from PySide6.QtWidgets import QCheckBox, QComboBox, QLabel, QLineEdit, QPlainTextEdit, QPushButton, QSizePolicy, QWidget

from app.common import UnitError, description_of, field_label, read_value, unit_of
from app.gui.widgets.layouts import configure, grid, make_label
from protocols.base import Protocol


@dataclass(frozen=True, slots=True)
class FormField:
    """One parameter as the form shows it."""

    name: str
    label: str
    unit: str
    """Empty for a count or a text."""
    description: str
    limits: str
    is_list: bool = False
    """Several numbers, separated by commas."""
    is_switch: bool = False
    choices: tuple[str, ...] = ()
    factor: float = 1.0
    """From SI to `unit`."""


@dataclass(frozen=True, slots=True)
class FormResult:
    """Result of checking a form: the protocol, or a message per faulty field ("" for the whole form)."""

    protocol: Protocol | None
    errors: Mapping[str, str]


def protocol_fields(kind: type[BaseModel]) -> tuple[FormField, ...]:
    """Return the fields of a protocol in the order of its class."""
    written = list(kind.__annotations__)
    names = sorted(kind.model_fields, key=lambda name: written.index(name) if name in written else -1)
    return tuple(make_field(kind, name) for name in names)


def bench_fields(kind: type[BaseModel]) -> tuple[FormField, ...]:
    """Return the fields of a form in the units in which people at a bench think of them."""
    return tuple(_in_bench_unit(kind, field) for field in protocol_fields(kind))


def form_fields(kind: type[BaseModel]) -> tuple[FormField, ...]:
    """Return the fields of a form in bench units; descriptions refer to other fields by their labels."""

    def label(name: re.Match[str]) -> str:
        return f"'{field_label(kind, name[0])}'" if name[0] in kind.model_fields else name[0]

    return tuple(
        replace(field, description=re.sub(r"\w+_\w+", label, field.description)) for field in bench_fields(kind)
    )


BENCH_UNITS = {
    "kg": ((1e3, "g"), (1e6, "mg")),
    "m": ((1e3, "mm"), (1e6, "µm")),
    "m/V": ((1e6, "µm/V"),),
    "m/N": ((1e6, "µm/N"),),
    "kg/m": ((1e3, "g/m"),),
    "Pa": ((1e-9, "GPa"), (1e-6, "MPa")),
    "F": ((1e9, "nF"),),
}
"""Factor and unit in which a form shows values of an SI unit, the larger unit first."""

LEAST_SHOWN = 0.01
"""A unit is used whose smallest default is at least this; it does not change with what is typed."""

UNLIMITED = 1e9
"""A count's limit from here on is not worth telling."""


def _in_bench_unit(kind: type[BaseModel], field: FormField) -> FormField:
    """Return a field in the unit in which people at a bench think of it."""
    if field.unit not in BENCH_UNITS:
        return field
    default = kind.model_fields[field.name].get_default()
    sizes = [abs(value) for value in (default if isinstance(default, tuple) else (default,)) if value]
    units = BENCH_UNITS[field.unit]
    factor, unit = next((u for u in units if min(sizes, default=1.0) * u[0] >= LEAST_SHOWN), units[-1])
    return replace(field, unit=unit, factor=factor, limits=_format_limits(_interval_of(kind, field.name), unit, factor))


def format_parameter(value: Any) -> str:
    """Format a parameter's value as it is typed."""
    if isinstance(value, tuple):
        return ", ".join(format_parameter(item) for item in value)
    return f"{value:.12g}" if isinstance(value, float | int) and not isinstance(value, bool) else str(value)


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or each of several, times a factor; anything else unchanged."""
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    if factor == 1.0 or isinstance(value, bool) or not isinstance(value, float | int):
        return value
    return factor * value


def check_form(
    kind: type[Protocol], texts: Mapping[str, Any], shown: Mapping[str, FormField] | None = None
) -> FormResult:
    """Read and validate the texts of a form, with or without units; `shown`: fields in other units than SI, by name."""
    units = {name: (field.factor, field.unit) for name, field in (shown or {}).items() if field.factor != 1.0}
    faults: dict[str, str] = {}
    values: dict[str, Any] = {}
    for name, text in texts.items():
        try:
            if isinstance(text, str) and not text.strip():
                raise UnitError("give a value")
            values[name] = read_value(kind, name, text, units.get(name, (1.0, "")))
        except UnitError as error:
            faults[name] = str(error)
    try:
        protocol = kind(**values)  # unreadable fields have their defaults, so that the others are still checked
    except ValidationError as error:
        for fault in error.errors():
            faults.setdefault(*field_error(kind, fault, shown))
        return FormResult(None, faults)
    return FormResult(None if faults else protocol, faults)


def make_field(kind: type[BaseModel], name: str) -> FormField:
    """Return a parameter as a form shows it."""
    given = unit_of(kind, name) or ""
    unit = "" if given == "1" else given
    annotation: Any = kind.model_fields[name].annotation
    many = get_origin(annotation) is tuple
    return FormField(
        name=name,
        label=field_label(kind, name),
        unit=unit,
        description=description_of(kind, name),
        limits=_format_limits(_interval_of(kind, name), unit),
        is_list=many,
        is_switch=annotation is bool,
        choices=_choices(annotation),
    )


def _choices(annotation: Any) -> tuple[str, ...]:
    if isinstance(annotation, type) and issubclass(annotation, StrEnum):
        return tuple(annotation)
    return tuple(str(c) for c in get_args(annotation)) if get_origin(annotation) is Literal else ()


def _interval_of(kind: type[BaseModel], name: str) -> Interval | None:
    """Return the limits of a field, or of the numbers in its list."""
    info = kind.model_fields[name]
    annotation: Any = info.annotation
    many = get_origin(annotation) is tuple
    marks = list(info.metadata) + (list(getattr(get_args(annotation)[0], "__metadata__", ())) if many else [])
    return next((mark for mark in marks if isinstance(mark, Interval)), None)


def _format_limits(interval: Interval | None, unit: str, factor: float = 1.0) -> str:
    if interval is None:
        return ""
    low: Any = interval.ge if interval.ge is not None else interval.gt
    high: Any = interval.le if interval.le is not None else interval.lt
    if not unit and high is not None and high >= UNLIMITED:
        high = None
    lower = "" if low is None else f"over {factor * low:g}" if interval.ge is None else f"{factor * low:g}"
    upper = "" if high is None else f"below {factor * high:g}" if interval.le is None else f"{factor * high:g}"
    if lower and not upper and interval.ge is not None:
        lower = f"from {lower}"
    if upper and not lower and interval.le is not None:
        upper = f"up to {upper}"
    return f"{' to '.join(filter(None, (lower, upper)))} {unit}".strip() if lower or upper else ""


def field_error(kind: type[BaseModel], error: Any, shown: Mapping[str, FormField] | None = None) -> tuple[str, str]:
    """Return the field of a validation error, and the message."""
    place, message = error["loc"], error["msg"].removeprefix("Value error, ")
    if not place:  # fields that contradict each other: the message begins with the one to change
        first = re.match(r"\w*", message)
        return first[0] if first is not None and first[0] in kind.model_fields else "", message
    name = str(place[0])
    field = (shown or {}).get(name) or make_field(kind, name)
    value = error["input"]
    if error["type"].startswith(("greater_than", "less_than")):
        return (
            name,
            f"{format_parameter(scaled(value, field.factor))} {field.unit}".strip()
            + f" is outside the range: {field.limits}",
        )
    if error["type"] in ("int_from_float", "int_type"):
        return name, f"{format_parameter(value)} is not a whole number"
    if error["type"] in ("finite_number", "float_type"):
        return name, f"{value} is not a number"
    return name, message[:1].lower() + message[1:]


Editor = QLineEdit | QPlainTextEdit | QCheckBox | QComboBox

ROW_GAP = 3
MAIN_FIELDS = 3
"""Fields of a form that are always shown."""

LIST_LINES = 4
"""Height of an editor for many numbers; more of them scroll."""


class FieldRow:
    """Widgets of one field: label, editor, unit, and below them its description or error."""

    def __init__(self, field: FormField, value: Any) -> None:
        self.field = field
        self.label, self.unit, self.note_label = QLabel(field.label), QLabel(field.unit), make_label()
        limits = f"\n{field.limits}" if field.limits else ""
        self.editor = configure(
            _make_editor(field),
            f"form.{field.name}",
            toolTip=f"{field.description}{limits}\nA unit may be written, for example 0.5 {field.unit}".strip(),
            accessibleName=f"{field.label} {field.unit}",
        )
        self._property = self.editor.metaObject().userProperty()  # the value, for every kind of editor
        self.label.setBuddy(self.editor)
        self.set_value(value)
        self.show_error("")

    def set_value(self, value: Any) -> None:
        """Show a value."""
        self._property.write(
            self.editor, bool(value) if self.field.is_switch else format_parameter(scaled(value, self.field.factor))
        )

    @property
    def text(self) -> Any:
        """The editor's value: a text, or whether the box is checked."""
        return self._property.read(self.editor)

    @property
    def edited(self) -> Any:
        """The editor's signal of an edit."""
        return getattr(self.editor, self._property.notifySignal().name().toStdString())

    @property
    def meaning(self) -> str:
        """Description with limits."""
        return self.field.description + (f"  ({self.field.limits})" if self.field.limits else "")

    def show_error(self, error: str) -> None:
        """Show an error, or the description if it is empty."""
        self.note_label.setText(f"✕ {error}" if error else self.meaning)
        for widget, name in ((self.note_label, "fault" if error else "note"), (self.editor, "faulty" if error else "")):
            set_style_kind(widget, name)


class ProtocolForm(QWidget):
    """Editable parameters of one protocol: the first ones, and the others on request."""

    changed = Signal()
    help_changed = Signal(str)
    """What the field with the keyboard means; empty when the keyboard is elsewhere."""

    def __init__(self, protocol: Protocol, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.kind = type(protocol)
        self.rows = {field.name: FieldRow(field, getattr(protocol, field.name)) for field in form_fields(self.kind)}
        self.more_button = configure(QPushButton(), "form.more", kind="choice", checkable=True)
        self.more_button.toggled.connect(self._show_more)
        self._layout = layout = grid(parent=self, margins=(0, 0, 6, 0), spacing=(8, 0), stretch={1: 1})
        self._gaps: dict[str, int] = {}
        """Row of the layout below each field."""
        at = 0
        for place, row in enumerate(self.rows.values()):
            if place == MAIN_FIELDS:
                layout.addWidget(self.more_button, at, 0, 1, 3, Qt.AlignmentFlag.AlignLeft)
                layout.setRowMinimumHeight(at + 1, 4)
                at += 2
            many = row.field.is_list
            alignment = Qt.AlignmentFlag.AlignTop if many else Qt.AlignmentFlag.AlignVCenter
            layout.addWidget(row.label, at, 0, alignment)
            layout.addWidget(row.editor, at, 1)
            layout.addWidget(row.unit, at, 2, alignment)
            layout.addWidget(row.note_label, at + 1, 0, 1, 3)
            layout.setRowMinimumHeight(at + 2, ROW_GAP)
            self._gaps[row.field.name] = at + 2
            at += 3
            row.note_label.hide()  # errors only: help is above the form
            row.edited.connect(self._on_edited)
            row.editor.installEventFilter(self)
        self.more_button.setVisible(len(self.rows) > MAIN_FIELDS)
        changed = any(
            getattr(protocol, row.field.name) != self.kind.model_fields[row.field.name].get_default()
            for row in self._further_rows
        )
        self.more_button.setChecked(changed)
        self._show_more(changed)
        self.result = FormResult(protocol, {})

    def set_protocol(self, protocol: Protocol) -> None:
        """Show the parameters of a protocol of the same kind."""
        for name, row in self.rows.items():
            row.set_value(getattr(protocol, name))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.FocusIn:
            row = next(row for row in self.rows.values() if row.editor is watched)
            self.help_changed.emit(f"{row.field.label}: {row.meaning}")
        elif event.type() == QEvent.Type.FocusOut:
            self.help_changed.emit("")
        return super().eventFilter(watched, event)

    @property
    def _further_rows(self) -> list[FieldRow]:
        return list(self.rows.values())[MAIN_FIELDS:]

    def _show_more(self, shown: bool) -> None:
        self.more_button.setText("Fewer fields" if shown else f"More: {len(self._further_rows)} fields")
        for row in self._further_rows:
            for widget in (row.label, row.editor, row.unit):
                widget.setVisible(shown)
            self._layout.setRowMinimumHeight(self._gaps[row.field.name], ROW_GAP * shown)

    def _on_edited(self) -> None:
        texts = {name: row.text for name, row in self.rows.items()}
        self.result = check_form(self.kind, texts, {name: row.field for name, row in self.rows.items()})
        for name, row in self.rows.items():
            error = self.result.errors.get(name, "")
            row.show_error(error)
            row.note_label.setVisible(bool(error))
        if any(row.field.name in self.result.errors for row in self._further_rows):
            self.more_button.setChecked(True)
        self.changed.emit()


def set_style_kind(widget: QWidget, kind: str) -> None:
    """Set the property `kind` that the style sheet selects, and restyle the widget."""
    if widget.property("kind") != kind:
        widget.setProperty("kind", kind)
        widget.style().unpolish(widget)
        widget.style().polish(widget)


class NumberListEdit(QPlainTextEdit):
    """Editor for many numbers, a few lines high."""

    def __init__(self) -> None:
        super().__init__()
        self.setTabChangesFocus(True)
        self.setWordWrapMode(QTextOption.WrapMode.WordWrap)
        # Otherwise a form that has one would be stretched, not what is below it.
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setFixedHeight(QFontMetrics(self.font()).lineSpacing() * LIST_LINES + 12)


def _make_editor(field: FormField) -> Editor:
    if field.is_switch:
        return QCheckBox()
    if field.choices:
        combo = QComboBox()
        combo.addItems(field.choices)
        return combo
    return NumberListEdit() if field.is_list else QLineEdit()
