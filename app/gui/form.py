"""The form of a protocol, generated from its annotated fields: text with units, checked at every key."""

from typing import Any

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QFontMetrics, QTextOption
from PySide6.QtWidgets import QCheckBox, QComboBox, QGridLayout, QLabel, QLineEdit, QPlainTextEdit, QWidget

from app.gui.fields import Checked, Field, check, form_fields, text_of
from protocols.protocol import Protocol

Editor = QLineEdit | QPlainTextEdit | QCheckBox | QComboBox

LINES = (3, 7)
"""Of an editor for many numbers, at least and at most."""


class FieldRow:
    """One field: its name, its editor, its unit, and below them what it means - or what is wrong."""

    def __init__(self, field: Field, value: Any) -> None:
        self.field = field
        self.label = QLabel(field.label)
        self.unit = QLabel(field.unit)
        self.note = QLabel()
        self.note.setWordWrap(True)
        self.note.setTextFormat(Qt.TextFormat.PlainText)
        self.editor = _editor(field)
        self.label.setBuddy(self.editor)
        limits = f"\n{field.limits}" if field.limits else ""
        self.editor.setToolTip(f"{field.words}{limits}\nA unit may be written, for example 0.5 {field.unit}".strip())
        self.editor.setAccessibleName(f"{field.label} {field.unit}")
        self.set(value)
        self.say("")

    def set(self, value: Any) -> None:
        """Show a value."""
        match self.editor:
            case QCheckBox() as box:
                box.setChecked(bool(value))
            case QComboBox() as combo:
                combo.setCurrentText(str(value))
            case QPlainTextEdit() as many:
                many.setPlainText(text_of(value))
            case QLineEdit() as line:
                line.setText(text_of(value))

    @property
    def text(self) -> Any:
        """What stands in the editor."""
        match self.editor:
            case QCheckBox() as box:
                return box.isChecked()
            case QComboBox() as combo:
                return combo.currentText()
            case QPlainTextEdit() as many:
                return many.toPlainText()
            case QLineEdit() as line:
                return line.text()

    def say(self, fault: str) -> None:
        """Show what is wrong, or what the field means."""
        meaning = self.field.words + (f"  ({self.field.limits})" if self.field.limits else "")
        self.note.setText(f"✕ {fault}" if fault else meaning)
        for widget, name in ((self.note, "fault" if fault else "note"), (self.editor, "faulty" if fault else "")):
            mark(widget, name)


class Form(QWidget):
    """Parameters of one protocol as a person edits them."""

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
            many = row.field.many
            grid.addWidget(row.label, at, 0, Qt.AlignmentFlag.AlignTop if many else Qt.AlignmentFlag.AlignVCenter)
            grid.addWidget(row.editor, at, 1)
            grid.addWidget(row.unit, at, 2, Qt.AlignmentFlag.AlignTop if many else Qt.AlignmentFlag.AlignVCenter)
            grid.addWidget(row.note, at + 1, 0, 1, 3)
            grid.setRowMinimumHeight(at + 2, 3)
            grid.setRowStretch(at, 20 if many else 0)
            at += 3
            _changes(row.editor).connect(self._edited)
        grid.setRowStretch(at, 1)
        self.checked = Checked(protocol, {})

    def set(self, protocol: Protocol) -> None:
        """Show the parameters of a protocol of the same kind."""
        for name, row in self.rows.items():
            row.set(getattr(protocol, name))

    def _edited(self) -> None:
        self.checked = check(self.kind, {name: row.text for name, row in self.rows.items()})
        for name, row in self.rows.items():
            row.say(self.checked.faults.get(name, ""))
        self.changed.emit()


def mark(widget: QWidget, kind: str) -> None:
    """Say what a widget is at present, so that the style sheet can show it."""
    if widget.property("kind") != kind:
        widget.setProperty("kind", kind)
        widget.style().unpolish(widget)
        widget.style().polish(widget)


class Numbers(QPlainTextEdit):
    """An editor for many numbers: a few lines, more where there is room."""

    def __init__(self) -> None:
        super().__init__()
        self.setTabChangesFocus(True)
        self.setWordWrapMode(QTextOption.WrapMode.WordWrap)
        self.setMinimumHeight(self._height(LINES[0]))
        self.setMaximumHeight(self._height(LINES[1]))

    def sizeHint(self) -> QSize:
        return QSize(super().sizeHint().width(), self._height(LINES[0]))

    def _height(self, lines: int) -> int:
        return QFontMetrics(self.font()).lineSpacing() * lines + 12


def _editor(field: Field) -> Editor:
    if field.switch:
        return QCheckBox()
    if field.choices:
        combo = QComboBox()
        combo.addItems(field.choices)
        return combo
    return Numbers() if field.many else QLineEdit()


def _changes(editor: Editor) -> Any:
    """The signal that tells of an edit."""
    match editor:
        case QCheckBox():
            return editor.toggled
        case QComboBox():
            return editor.currentTextChanged
        case QPlainTextEdit() | QLineEdit():
            return editor.textChanged
