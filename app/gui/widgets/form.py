"""Protocol form generated from annotated fields: values with units, validated at every edit."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args, get_origin

from annotated_types import Interval
from pydantic import ValidationError
from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QFontMetrics, QTextOption
from PySide6.QtWidgets import QCheckBox, QComboBox, QGridLayout, QLabel, QLineEdit, QPlainTextEdit, QWidget

from app.common import UnitError, description_of, read_value, unit_of
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


@dataclass(frozen=True, slots=True)
class FormResult:
    """Result of checking a form: the protocol, or a message per faulty field ("" for the whole form)."""

    protocol: Protocol | None
    errors: Mapping[str, str]


def protocol_fields(kind: type[Protocol]) -> tuple[FormField, ...]:
    """Return the fields of a protocol in the order of its class."""
    written = list(kind.__annotations__)
    names = sorted(kind.model_fields, key=lambda name: written.index(name) if name in written else -1)
    return tuple(_make_field(kind, name) for name in names)


def form_fields(kind: type[Protocol]) -> tuple[FormField, ...]:
    """Return the fields of a form; descriptions refer to other fields by their labels."""

    def label(name: re.Match[str]) -> str:
        return f"'{_field_label(kind, name[0])}'" if name[0] in kind.model_fields else name[0]

    return tuple(
        replace(field, description=re.sub(r"\w+_\w+", label, field.description)) for field in protocol_fields(kind)
    )


def format_parameter(value: Any) -> str:
    """Format a parameter's value as it is typed."""
    if isinstance(value, tuple):
        return ", ".join(format_parameter(item) for item in value)
    return f"{value:.12g}" if isinstance(value, float | int) and not isinstance(value, bool) else str(value)


def check_form(kind: type[Protocol], texts: Mapping[str, Any]) -> FormResult:
    """Read and validate the texts of a form, with or without units."""
    faults: dict[str, str] = {}
    values: dict[str, Any] = {}
    for name, text in texts.items():
        try:
            if isinstance(text, str) and not text.strip():
                raise UnitError("give a value")
            values[name] = read_value(kind, name, text)
        except UnitError as error:
            faults[name] = str(error)
    try:
        protocol = kind(**values)  # unreadable fields have their defaults, so that the others are still checked
    except ValidationError as error:
        for fault in error.errors():
            name, words = _field_error(kind, fault)
            faults.setdefault(name, words)
        return FormResult(None, faults)
    return FormResult(None if faults else protocol, faults)


def _make_field(kind: type[Protocol], name: str) -> FormField:
    info = kind.model_fields[name]
    unit = unit_of(kind, name) or ""
    annotation: Any = info.annotation
    many = get_origin(annotation) is tuple
    marks = list(info.metadata) + (list(getattr(get_args(annotation)[0], "__metadata__", ())) if many else [])
    interval = next((mark for mark in marks if isinstance(mark, Interval)), None)
    label = _field_label(kind, name)
    return FormField(
        name=name,
        label=label,
        unit="" if unit == "1" else unit,
        description=description_of(kind, name),
        limits=_format_limits(interval, "" if unit == "1" else unit),
        is_list=many,
        is_switch=annotation is bool,
        choices=tuple(str(c) for c in get_args(annotation)) if get_origin(annotation) is Literal else (),
    )


def _field_label(kind: type[Protocol], name: str) -> str:
    unit = unit_of(kind, name) or ""
    return name.removesuffix(f"_{unit.lower()}").replace("_", " ")


def _format_limits(interval: Interval | None, unit: str) -> str:
    if interval is None:
        return ""
    low: Any = interval.ge if interval.ge is not None else interval.gt
    high: Any = interval.le if interval.le is not None else interval.lt
    over = "over " if interval.ge is None else ""
    under = "below " if interval.le is None else ""
    if low is None and high is None:
        return ""
    if high is None:
        words = f"{over or 'from '}{low:g}"
    elif low is None:
        words = f"{under or 'up to '}{high:g}"
    else:
        words = f"{over}{low:g} to {under}{high:g}"
    return f"{words} {unit}".strip()


def _field_error(kind: type[Protocol], error: Any) -> tuple[str, str]:
    """Return the field of a validation error, and the message."""
    place, words = error["loc"], error["msg"].removeprefix("Value error, ")
    if not place:  # fields that contradict each other: the message begins with the one to change
        name = next((name for name in kind.model_fields if words.startswith(name)), "")
        return name, words
    name = str(place[0])
    field = _make_field(kind, name)
    value = error["input"]
    if error["type"].startswith(("greater_than", "less_than")):
        return name, f"{format_parameter(value)} {field.unit}".strip() + f" is outside the range: {field.limits}"
    if error["type"] in ("int_from_float", "int_type"):
        return name, f"{format_parameter(value)} is not a whole number"
    if error["type"] in ("finite_number", "float_type"):
        return name, f"{value} is no number"
    return name, words[:1].lower() + words[1:]


Editor = QLineEdit | QPlainTextEdit | QCheckBox | QComboBox

LIST_HEIGHT_LINES = (3, 7)
"""Minimum and maximum height of an editor for many numbers."""


class FieldRow:
    """Widgets of one field: label, editor, unit, and below them its description or error."""

    def __init__(self, field: FormField, value: Any) -> None:
        self.field = field
        self.label = QLabel(field.label)
        self.unit = QLabel(field.unit)
        self.note_label = QLabel()
        self.note_label.setWordWrap(True)
        self.note_label.setTextFormat(Qt.TextFormat.PlainText)
        self.editor = _make_editor(field)
        self.label.setBuddy(self.editor)
        limits = f"\n{field.limits}" if field.limits else ""
        self.editor.setToolTip(
            f"{field.description}{limits}\nA unit may be written, for example 0.5 {field.unit}".strip()
        )
        self.editor.setAccessibleName(f"{field.label} {field.unit}")
        self.set_value(value)
        self.show_error("")

    def set_value(self, value: Any) -> None:
        """Show a value."""
        match self.editor:
            case QCheckBox() as box:
                box.setChecked(bool(value))
            case QComboBox() as combo:
                combo.setCurrentText(str(value))
            case QPlainTextEdit() as many:
                many.setPlainText(format_parameter(value))
            case QLineEdit() as line:
                line.setText(format_parameter(value))

    @property
    def text(self) -> Any:
        """The editor's value."""
        match self.editor:
            case QCheckBox() as box:
                return box.isChecked()
            case QComboBox() as combo:
                return combo.currentText()
            case QPlainTextEdit() as many:
                return many.toPlainText()
            case QLineEdit() as line:
                return line.text()

    def show_error(self, error: str) -> None:
        """Show an error, or the description if it is empty."""
        meaning = self.field.description + (f"  ({self.field.limits})" if self.field.limits else "")
        self.note_label.setText(f"✕ {error}" if error else meaning)
        for widget, name in ((self.note_label, "fault" if error else "note"), (self.editor, "faulty" if error else "")):
            set_style_kind(widget, name)


class ProtocolForm(QWidget):
    """Editable parameters of one protocol."""

    changed = Signal()

    def __init__(self, protocol: Protocol, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.kind = type(protocol)
        self.rows = {field.name: FieldRow(field, getattr(protocol, field.name)) for field in form_fields(self.kind)}
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 6, 0)
        grid.setHorizontalSpacing(8)
        grid.setVerticalSpacing(0)
        grid.setColumnStretch(1, 1)
        at = 0
        for row in self.rows.values():
            many = row.field.is_list
            grid.addWidget(row.label, at, 0, Qt.AlignmentFlag.AlignTop if many else Qt.AlignmentFlag.AlignVCenter)
            grid.addWidget(row.editor, at, 1)
            grid.addWidget(row.unit, at, 2, Qt.AlignmentFlag.AlignTop if many else Qt.AlignmentFlag.AlignVCenter)
            grid.addWidget(row.note_label, at + 1, 0, 1, 3)
            grid.setRowMinimumHeight(at + 2, 3)
            grid.setRowStretch(at, 20 if many else 0)
            at += 3
            _edit_signal(row.editor).connect(self._on_edited)
        grid.setRowStretch(at, 1)
        self.result = FormResult(protocol, {})

    def set_protocol(self, protocol: Protocol) -> None:
        """Show the parameters of a protocol of the same kind."""
        for name, row in self.rows.items():
            row.set_value(getattr(protocol, name))

    def _on_edited(self) -> None:
        self.result = check_form(self.kind, {name: row.text for name, row in self.rows.items()})
        for name, row in self.rows.items():
            row.show_error(self.result.errors.get(name, ""))
        self.changed.emit()


def set_style_kind(widget: QWidget, kind: str) -> None:
    """Set the property `kind` that the style sheet selects, and restyle the widget."""
    if widget.property("kind") != kind:
        widget.setProperty("kind", kind)
        widget.style().unpolish(widget)
        widget.style().polish(widget)


class NumberListEdit(QPlainTextEdit):
    """Editor for many numbers: a few lines, more if there is space."""

    def __init__(self) -> None:
        super().__init__()
        self.setTabChangesFocus(True)
        self.setWordWrapMode(QTextOption.WrapMode.WordWrap)
        self.setMinimumHeight(self._height(LIST_HEIGHT_LINES[0]))
        self.setMaximumHeight(self._height(LIST_HEIGHT_LINES[1]))

    def sizeHint(self) -> QSize:
        return QSize(super().sizeHint().width(), self._height(LIST_HEIGHT_LINES[0]))

    def _height(self, lines: int) -> int:
        return QFontMetrics(self.font()).lineSpacing() * lines + 12


def _make_editor(field: FormField) -> Editor:
    if field.is_switch:
        return QCheckBox()
    if field.choices:
        combo = QComboBox()
        combo.addItems(field.choices)
        return combo
    return NumberListEdit() if field.is_list else QLineEdit()


def _edit_signal(editor: Editor) -> Any:
    """Return the editor's signal of an edit."""
    match editor:
        case QCheckBox():
            return editor.toggled
        case QComboBox():
            return editor.currentTextChanged
        case QPlainTextEdit() | QLineEdit():
            return editor.textChanged
