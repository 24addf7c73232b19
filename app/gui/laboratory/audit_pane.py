"""Pane of the audit trail: its entries, newest first, and the verification of all lines and files."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtWidgets import QWidget

from app.archive import AuditResult, begin_audit, verify_audit
from app.common import AuditEntry, OperationCancelled, Progress, Table, pluralize
from app.gui.laboratory.value_table import ValueTable
from app.gui.widgets import (
    ProgressRow,
    WrappedRow,
    column,
    make_button,
    make_label,
    make_line_edit,
    set_style_kind,
    show_text,
)
from model import format_time

SHOWN_PROBLEMS, SHOWN_FILES = 12, 3
COLUMNS = ("no.", "time", "who", "action", "subject", "hash", "details")
UNPROVEN = "; a change that rewrites the whole trail shows only against a head hash kept elsewhere"
NO_TRAIL = (
    "This folder has no audit trail. Once begun, every run, acceptance, rejection, note, edit and deletion appends a line with who, "
    "when and the hashes of the files."
)


class AuditPane(QWidget):
    """Lists and verifies the audit trail of a folder.

    Args:
        reload: reads the folder again.
    """

    def __init__(self, reload: Callable[[], object]) -> None:
        super().__init__()
        self.progress_row = ProgressRow("audit")
        self._folder, self._reload = Path(), reload
        self.head_edit = make_line_edit(
            "laboratory.audit.head",
            "head hash that was printed or copied elsewhere",
            placeholderText="head hash of a report, if you have one",
            minimumWidth=260,
        )
        self.verify_button = make_button(
            "Verify", self.verify, "choice", "Hash all files and compare them with the trail", "laboratory.audit.verify"
        )
        self.begin_button = make_button(
            "Begin the audit trail", self.begin, "choice", "Hash all files of the folder and write the first line"
        )
        self.result_label = make_label(name="laboratory.audit.result")
        for button in (self.verify_button, self.begin_button):
            self.progress_row.started.connect(button.setDisabled)
        self.table = ValueTable("laboratory.audit", "entries of the audit trail")
        column(
            WrappedRow(self.verify_button, self.head_edit, self.begin_button, spacing=6),
            self.progress_row,
            self.result_label,
            (self.table, 1000),
            None,
            parent=self,
            spacing=4,
        )

    def show_entries(self, folder: Path, entries: Sequence[AuditEntry], problems: Sequence[str]) -> None:
        """Show the entries of a folder, newest first; none: the folder has no trail."""
        if folder != self._folder:
            self._show_result("", "")
        self._folder = folder
        has_trail = bool(entries or problems)
        for widget in (self.verify_button, self.head_edit, self.table):
            widget.setVisible(has_trail)
        self.begin_button.setVisible(not has_trail)
        if not has_trail:
            self._show_result(NO_TRAIL, "note")
        elif problems:
            self._show_result("\n".join(f"✕ {problem}" for problem in problems[:SHOWN_PROBLEMS]), "danger")
        elif self.result_label.text() == NO_TRAIL:
            self._show_result("", "")
        table = Table.of_rows("Audit trail", COLUMNS, [_cells(each) for each in reversed(entries)])
        number, *texts = table.columns
        self.table.set_table(replace(table, columns=(replace(number, format_spec="d"), *texts)))

    def verify(self) -> None:
        """Verify all lines and files in the background."""
        self._run(partial(verify_audit, self._folder, self.head_edit.text()), self._on_verified)

    def begin(self) -> None:
        """Begin the audit trail of the folder in the background."""
        self._run(partial(begin_audit, self._folder), lambda _: self._reload())

    def _run(self, work: Callable[[Progress], object], on_result: Callable[[Any], object]) -> None:
        self._show_result("", "")
        self.progress_row.run("hashing files", work, on_result, self._on_error)

    def _on_verified(self, result: AuditResult) -> None:
        lines = [f"✕ {problem}" for problem in result.problems[:SHOWN_PROBLEMS]]
        if len(result.problems) > SHOWN_PROBLEMS:
            lines.append(f"and {len(result.problems) - SHOWN_PROBLEMS} more: 'tactor-bench audit verify' lists all")
        if result.unrecorded:
            names = ", ".join(result.unrecorded[:3])
            lines.append(f"? {pluralize(len(result.unrecorded), 'file')} not in the trail: {names}")
        count = pluralize(len(result.entries), "line")
        if result.problems:
            lines.insert(0, f"{count}: {pluralize(len(result.problems), 'problem')}")
        else:
            so_far = "" if self.head_edit.text().strip() else UNPROVEN
            lines.insert(0, f"✓ {count} and all files are unchanged{so_far}. Head: {result.head[:16]}…")
        self._show_result("\n".join(lines), "danger" if result.problems else "")

    def _on_error(self, error: Exception) -> None:
        stopped = isinstance(error, OperationCancelled)
        self._show_result("Stopped; nothing was decided." if stopped else str(error), "" if stopped else "danger")

    def _show_result(self, text: str, kind: str) -> None:
        show_text(self.result_label, text)
        set_style_kind(self.result_label, kind)


def _cells(entry: AuditEntry) -> tuple[int | str, ...]:
    time = format_time(entry.time)
    return entry.number, time, entry.by, entry.action, entry.subject, entry.hash[:12], _details(entry)


def _details(entry: AuditEntry) -> str:
    shown = {name: value for name, value in entry.details.items() if value not in ("", [], None)}
    files = [*entry.files][:SHOWN_FILES]
    more = [f"and {len(entry.files) - SHOWN_FILES} more"] if len(entry.files) > SHOWN_FILES else []
    return ", ".join([*(f"{name} {value}" for name, value in shown.items()), *files, *more])
