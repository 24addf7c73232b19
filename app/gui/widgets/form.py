"""Forms generated from annotated fields: values with units, validated at every edit."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QResizeEvent, QTextOption
from PySide6.QtWidgets import QCheckBox, QComboBox, QLabel, QLineEdit, QPlainTextEdit, QPushButton, QSizePolicy, QWidget

from app.common import sentence_case
from app.gui.face import px
from app.gui.widgets.layouts import (
    TrueMinus,
    column,
    configure,
    grid,
    make_combo,
    make_label,
    set_style_kind,
    show_text,
)
from app.services import FormField, FormResult, check_form, form_fields, format_parameter, scaled
from protocols.base import Protocol

Editor = QLineEdit | QPlainTextEdit | QCheckBox | QComboBox

ROW_GAP = 3
MAIN_FIELDS = 3
"""Fields of a form that are always shown."""

LIST_LINES = 2, 5
"""Least and largest height of an editor for many numbers; more of them scroll."""


class FieldRow:
    """Widgets of one field: label, editor, unit, and below them its error."""

    def __init__(self, field: FormField, value: Any) -> None:
        self.field = field
        self.unit, self.note_label = QLabel(field.unit), make_label(visible=False)
        self.label = QLabel(sentence_case(field.label))
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
        """Show an error; none if it is empty: the meaning of the field stands in its tool tip."""
        show_text(self.note_label, f"✕ {error}" if error else "")
        for widget, name in ((self.note_label, "fault" if error else "note"), (self.editor, "faulty" if error else "")):
            set_style_kind(widget, name)


class FieldForm(QWidget):
    """Editable fields of a model; subclasses lay them out and check them after every edit."""

    changed = Signal()

    def __init__(self, kind: type[Any], rows: Mapping[str, FieldRow]) -> None:
        super().__init__()
        self.kind, self.rows = kind, rows
        for row in rows.values():
            row.edited.connect(self._on_edited)

    def check(self, given: Mapping[str, Any] | None = None) -> FormResult[Any]:
        """Return the model of the texts; `given` has values in place of unreadable ones."""
        texts = {name: row.text for name, row in self.rows.items()}
        return check_form(self.kind, texts, {name: row.field for name, row in self.rows.items()}, given)

    def show_errors(self, errors: Mapping[str, str]) -> None:
        for name, row in self.rows.items():
            row.show_error(errors.get(name, ""))

    def _on_edited(self) -> None:
        raise NotImplementedError


class ProtocolForm(FieldForm):
    """Editable parameters of one protocol: the first ones, and the others on request."""

    help_changed = Signal(str)
    """Description of the field with the keyboard focus; empty without one."""

    def __init__(self, protocol: Protocol) -> None:
        fields = form_fields(type(protocol))
        rows = {field.name: FieldRow(field, getattr(protocol, field.name)) for field in fields}
        super().__init__(type(protocol), rows)
        self.more_button = configure(QPushButton(), "form.more", kind="choice", checkable=True)
        self.more_button.toggled.connect(self._show_more)
        self._layout = layout = grid(parent=self, spacing=(8, 0), stretch={1: 1})
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
            # The unit stands in the field, below the label of a high field, or behind any other.
            layout.addLayout(column(row.label, *([row.unit] if many else []), spacing=0), at, 0, alignment)
            layout.addWidget(row.editor, at, 1)
            if isinstance(row.editor, QLineEdit):
                put_inside(row.editor, row.unit)
            elif many:
                configure(row.unit, kind="note")
            else:
                layout.addWidget(row.unit, at, 2, alignment)
            layout.addWidget(row.note_label, at + 1, 0, 1, 3)
            layout.setRowMinimumHeight(at + 2, ROW_GAP)
            self._gaps[row.field.name] = at + 2
            at += 3
            row.editor.installEventFilter(self)
        self.more_button.setVisible(len(self.rows) > MAIN_FIELDS)
        changed = any(
            getattr(protocol, row.field.name) != self.kind.model_fields[row.field.name].get_default()
            for row in self._further_rows
        )
        self.result: FormResult[Any] = FormResult(protocol, {})
        self.more_button.setChecked(changed)
        self._show_more(changed)

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

    def label_width(self) -> int:
        """Return the width of the labels that are always shown, pixels."""
        return max((row.label.sizeHint().width() for row in list(self.rows.values())[:MAIN_FIELDS]), default=0)

    def set_label_width(self, width: int) -> None:
        """Give the labels a least width in pixels, so that their fields stand below other fields."""
        self._layout.setColumnMinimumWidth(0, width)

    @property
    def _further_rows(self) -> list[FieldRow]:
        return list(self.rows.values())[MAIN_FIELDS:]

    def show_errors(self, errors: Mapping[str, str]) -> None:
        super().show_errors(errors)
        for row in self._further_rows:  # a form that opened itself would move the field that is typed in
            row.note_label.setVisible(self.more_button.isChecked() and row.field.name in errors)

    def _name_more(self) -> None:
        """Set the text of the button: the number of hidden fields, and the names of those with an error."""
        faults = [row.field.label for row in self._further_rows if row.field.name in self.result.errors]
        hidden = f"More: {len(self._further_rows)} fields" + (f", correct {' and '.join(faults)}" if faults else "")
        self.more_button.setText("Fewer fields" if self.more_button.isChecked() else hidden)

    def _show_more(self, shown: bool) -> None:
        self._name_more()
        for row in self._further_rows:
            for widget in (row.label, row.editor, row.unit):
                widget.setVisible(shown)
            row.note_label.setVisible(shown and bool(row.note_label.text()))
            self._layout.setRowMinimumHeight(self._gaps[row.field.name], ROW_GAP * shown)

    def _on_edited(self) -> None:
        self.result = self.check()
        self.show_errors(self.result.errors)
        self._name_more()
        self.changed.emit()


def put_inside(field: QLineEdit, unit: QLabel) -> None:
    """Show a unit inside a field, at its right end."""
    configure(unit, kind="note")
    unit.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
    right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
    grid((unit, 0, 0, right), parent=field, margins=(0, 0, 8, 0))
    field.setTextMargins(0, 0, unit.sizeHint().width() + px(4), 0)


class NumberListEdit(QPlainTextEdit):
    """Editor for many numbers, as high as its lines, between `LIST_LINES`."""

    def __init__(self) -> None:
        super().__init__()
        self.setTabChangesFocus(True)
        self.setWordWrapMode(QTextOption.WrapMode.WordWrap)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        # Otherwise a form with a stretch would be stretched instead of the widgets below it.
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.document().setDocumentMargin(0)
        self.textChanged.connect(self._fit)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """Show whole lines."""
        layout, block, height = self.document().documentLayout(), self.document().firstBlock(), 0.0
        while block.isValid():
            height += layout.blockBoundingRect(block).height()
            block = block.next()
        line, around = self.fontMetrics().lineSpacing(), self.contentsMargins()
        least, most = LIST_LINES
        lines = line * min(max(round(height / line), least), most)
        self.setFixedHeight(lines + around.top() + around.bottom() + 2)  # without 2 more Qt shows a scroll bar


def _make_editor(field: FormField) -> Editor:
    if field.is_switch:
        return QCheckBox()
    if field.choices:
        return make_combo("", "", ((choice, None) for choice in field.choices))
    if field.is_list:
        return NumberListEdit()
    edit = QLineEdit()
    if field.unit:
        edit.setValidator(TrueMinus(edit))
    return edit
