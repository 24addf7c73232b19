"""Form of one table of a bench file: its main fields, and the others behind *More*."""

from collections.abc import Collection, Sequence
from typing import Any

from pydantic import ValidationError
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QLineEdit, QSizePolicy, QWidget

from app.common import UnitError, read_value
from app.config import ConfigTable
from app.gui.widgets import FieldRow, column, grid, make_choice
from app.services import bench_fields, field_error

EDITOR_PADDING = 20
"""Width of an editor beyond that of its text."""

MAX_LABEL_WIDTH = 112
"""Longer labels have two lines."""


class TableForm(QWidget):
    """Editable fields of a table of the bench file; a fault is written below its field.

    Args:
        table: name of the table, for object names.
        kind: of the table.
        main: names of the fields that are always visible; all if empty.
        hidden: names of the fields that are edited elsewhere.
    """

    changed = Signal()

    def __init__(
        self, table: str, kind: type[ConfigTable], main: Sequence[str] = (), hidden: Collection[str] = ()
    ) -> None:
        super().__init__()
        self.kind, self._record = kind, kind.model_construct()
        self._fields = {field.name: field for field in bench_fields(kind)}
        names = [name for name in kind.model_fields if name not in hidden]
        shown = [name for name in (main or names) if name in names]
        others = [name for name in names if name not in shown]
        self.rows = {name: self._make_row(table, name) for name in (*shown, *others)}
        self._hints = {name: row.editor.toolTip() for name, row in self.rows.items()}
        self.more_button = make_choice("More", "Show the other values of this table", checkable=True)
        self.more_button.setObjectName(f"bench.{table}.more")
        self._others = QWidget()
        top = QWidget()
        _fill(grid(parent=top, spacing=(8, 2), stretch={1: 1}), [self.rows[n] for n in shown])
        _fill(
            grid(parent=self._others, spacing=(8, 2), stretch={1: 1}),
            [self.rows[n] for n in others],
        )
        column(top, self.more_button, self._others, parent=self, spacing=4)
        self.more_button.setVisible(bool(others))
        self._others.hide()
        self.more_button.toggled.connect(self._others.setVisible)

    def set_record(self, record: ConfigTable) -> None:
        """Show the values of a table."""
        if record == self._record and not self.has_faults:
            return
        self._record = record
        for name, row in self.rows.items():
            row.editor.blockSignals(True)
            row.set_value(getattr(record, name))
            row.editor.blockSignals(False)
            if isinstance(row.editor, QLineEdit):
                row.editor.setCursorPosition(0)  # the beginning of a long text is seen
            self._show_whole_text(name)
            _show_fault(row, "")

    @property
    def record(self) -> Any:
        """The table as it is typed; the last valid one while a field is at fault."""
        return self._record

    @property
    def has_faults(self) -> bool:
        """Whether a field is at fault."""
        return any(not row.note_label.isHidden() for row in self.rows.values())

    def _make_row(self, table: str, name: str) -> FieldRow:
        row = FieldRow(self._fields[name], self.kind.model_fields[name].get_default())
        row.editor.setObjectName(f"bench.{table}.{name}")
        row.editor.setAccessibleName(f"{table} {row.editor.accessibleName()}".strip())
        row.editor.setMinimumWidth(row.editor.fontMetrics().horizontalAdvance("2026-11-22") + EDITOR_PADDING)
        row.label.setWordWrap(True)
        width = min(row.label.fontMetrics().horizontalAdvance(row.label.text()) + 2, MAX_LABEL_WIDTH)
        row.label.setMinimumWidth(width)
        row.label.setMaximumWidth(MAX_LABEL_WIDTH)
        row.editor.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        row.note_label.setObjectName(f"bench.{table}.{name}.fault")
        _show_fault(row, "")
        row.edited.connect(self._on_edited)
        return row

    def _on_edited(self) -> None:
        faults: dict[str, str] = {}
        values = self._record.model_dump()
        for name, row in self.rows.items():
            try:
                values[name] = read_value(self.kind, name, row.text, (row.field.factor, row.field.unit))
            except UnitError as error:
                faults[name] = str(error)
        try:
            record = self.kind.model_validate(values)
        except ValidationError as error:
            for fault in error.errors():
                faults.setdefault(*field_error(self.kind, fault, self._fields))
        else:
            self._record = self._record if faults else record
        if (general := faults.pop("", "")) and self.rows:
            faults.setdefault(next(iter(self.rows)), general)
        for name, row in self.rows.items():
            _show_fault(row, faults.get(name, ""))
            self._show_whole_text(name)
        self.changed.emit()

    def _show_whole_text(self, name: str) -> None:
        """Put a text that a narrow field cuts into its tool tip, above the hint."""
        editor = self.rows[name].editor
        if not isinstance(editor, QLineEdit):
            return
        text = editor.text()
        whole = editor.fontMetrics().horizontalAdvance(text) <= editor.minimumWidth() - EDITOR_PADDING
        editor.setToolTip(self._hints[name] if whole else f"{text}\n{self._hints[name]}")


def _show_fault(row: FieldRow, fault: str) -> None:
    """Show what is wrong; what a field means is in its tool tip, so that the tiles stay small."""
    row.show_error(fault)
    row.note_label.setVisible(bool(fault))


def _fill(layout: QGridLayout, rows: Sequence[FieldRow]) -> None:
    for at, row in enumerate(rows):
        layout.addWidget(row.label, 2 * at, 0)
        layout.addWidget(row.editor, 2 * at, 1, 1, 1 if row.unit.text() else 2)
        if row.unit.text():
            layout.addWidget(row.unit, 2 * at, 2)
        layout.addWidget(row.note_label, 2 * at + 1, 0, 1, 3)
