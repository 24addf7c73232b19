"""Form of one table of a bench file: its main fields, and the others behind *More*."""

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLineEdit, QSizePolicy, QWidget

from app.config import BenchConfig, ConfigTable
from app.gui.widgets import FieldForm, FieldRow, column, grid, make_toggle
from app.services import FormField, bench_fields

EDITOR_PADDING = 20
"""Width of an editor beyond its text."""

MAX_LABEL_WIDTH = 112
"""Longer labels have two lines."""

EDITED_ELSEWHERE = ("calibration_points",)


class TableForm(FieldForm):
    """Editable fields of a table of the bench file; a fault is written below its field.

    Args:
        table: name of the table, for object names.
        kind: of the table.
        main: names of the fields that are always visible; all if empty.
    """

    def __init__(self, table: str, kind: type[ConfigTable], main: Sequence[str] = ()) -> None:
        names = [name for name in kind.model_fields if name not in EDITED_ELSEWHERE]
        shown = [name for name in (main or names) if name in names]
        others = [name for name in names if name not in shown]
        fields = {field.name: field for field in bench_fields(kind)}
        super().__init__(kind, {name: _make_row(table, kind, fields[name]) for name in (*shown, *others)})
        self.record: Any = kind.model_construct()
        """The table as it is typed; the last valid one while a field is at fault."""
        self._hints = {name: row.editor.toolTip() for name, row in self.rows.items()}
        top, below = (_make_grid([self.rows[name] for name in part]) for part in (shown, others))
        more = make_toggle("More", "Show the other values of this table", f"bench.{table}.more", below)
        column(top, (more, 0, Qt.AlignmentFlag.AlignLeft), below, parent=self, spacing=4)
        more.setVisible(bool(others))

    @classmethod
    def of_bench(cls, table: str, main: Sequence[str] = ()) -> "TableForm":
        """Return the form of a table that a bench file has once."""
        kind: Any = BenchConfig.model_fields[table].annotation
        return cls(table, kind, main)

    def update_record(self, **values: object) -> None:
        """Show the table with other values."""
        self.set_record(self.record.model_copy(update=values))

    def set_record(self, record: ConfigTable) -> None:
        """Show the values of a table."""
        if record == self.record and not self.has_faults:
            return
        self.record = record
        for name, row in self.rows.items():
            row.editor.blockSignals(True)
            row.set_value(getattr(record, name))
            row.editor.blockSignals(False)
            if isinstance(row.editor, QLineEdit):
                row.editor.setCursorPosition(0)  # the beginning of a long text is seen
            self._show_whole_text(name)
            row.show_error("")

    @property
    def has_faults(self) -> bool:
        """Whether a field is at fault."""
        return any(not row.note_label.isHidden() for row in self.rows.values())

    def _on_edited(self) -> None:
        result = self.check(self.record.model_dump())
        self.record = self.record if result.value is None else result.value
        errors = dict(result.errors)
        if (general := errors.pop("", "")) and self.rows:
            errors.setdefault(next(iter(self.rows)), general)
        self.show_errors(errors)
        for name in self.rows:
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


def _make_row(table: str, kind: type[ConfigTable], field: FormField) -> FieldRow:
    row = FieldRow(field, kind.model_fields[field.name].get_default())
    row.editor.setObjectName(f"bench.{table}.{field.name}")
    row.editor.setAccessibleName(f"{table} {row.editor.accessibleName()}".strip())
    row.editor.setMinimumWidth(row.editor.fontMetrics().horizontalAdvance("2026-11-22") + EDITOR_PADDING)
    row.label.setWordWrap(True)
    width = min(row.label.fontMetrics().horizontalAdvance(row.label.text()) + 2, MAX_LABEL_WIDTH)
    row.label.setMinimumWidth(width)
    row.label.setMaximumWidth(MAX_LABEL_WIDTH)
    row.editor.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
    row.note_label.setObjectName(f"bench.{table}.{field.name}.fault")
    return row


def _make_grid(rows: Sequence[FieldRow]) -> QWidget:
    place = QWidget()
    layout = grid(parent=place, spacing=(8, 2), stretch={1: 1})
    for at, row in enumerate(rows):
        layout.addWidget(row.label, 2 * at, 0)
        layout.addWidget(row.editor, 2 * at, 1, 1, 1 if row.unit.text() else 2)
        if row.unit.text():
            layout.addWidget(row.unit, 2 * at, 2)
        layout.addWidget(row.note_label, 2 * at + 1, 0, 1, 3)
    return place
