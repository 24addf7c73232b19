"""Transfers of run files in the background: export, copy, import, trash."""

from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, QUrl, Signal

from app.archive import (
    CopyResult,
    Format,
    TrashedRun,
    copy_runs_into,
    export_runs,
    import_tables,
    move_to_trash,
    restore_from_trash,
)
from app.common import OperationCancelled, Progress, UsageError, pluralize
from app.config import AmplifierTable
from app.gui.widgets import BackgroundWorker, ProgressRow, tell


def folder_link(folder: Path) -> str:
    """Return the name of a folder as a link that opens it."""
    return f'<a href="{QUrl.fromLocalFile(str(folder.resolve())).toString()}">{escape(str(folder))}</a>'


class RunTransfers(QObject):
    """Exports runs, copies run files in, imports tables, and moves runs to the trash and back.

    Args:
        progress_row: shows the progress and cancels.
        folder: function that returns the folder of the runs.
        specimen: function that returns the specimen of imported tables.
        amplifier: amplifier of imported tables.
    """

    finished = Signal()
    """Emitted when there may be new runs in the folder."""
    message = Signal(str, bool)
    """Message, and whether it is an error."""

    def __init__(
        self,
        progress_row: ProgressRow,
        folder: Callable[[], Path],
        specimen: Callable[[], str],
        amplifier: AmplifierTable,
        parent: QObject,
    ) -> None:
        super().__init__(parent)
        self._progress_row, self._folder, self._specimen, self._amplifier = progress_row, folder, specimen, amplifier
        self._trash_worker = BackgroundWorker("trash", self)
        self._trashed: list[list[TrashedRun]] = []
        """The deletions that can be undone, the last one at the end."""

    def export_runs(self, paths: Sequence[Path], folder: Path, kind: Format) -> None:
        """Export runs as files for other programs."""

        def describe(exported: tuple[int, list[str]]) -> str:
            count, left_out = exported
            written = [f"{pluralize(count, 'file')} written to {folder_link(folder)}"]
            return "<br>".join([*written, *(f"Without raw data: {escape(reason)}." for reason in left_out)])

        work = partial(export_runs, paths, folder, kind)
        self._start(f"exporting {pluralize(len(paths), 'run')} …", work, describe)

    def copy_in(self, paths: Sequence[Path]) -> None:
        """Copy run files into the folder; a file of the same name is never replaced."""

        def describe(taken: CopyResult) -> str:
            self.finished.emit()
            copied = [f"{pluralize(len(taken.copied), 'run')} copied"] if taken.copied else []
            present = [f"already there: {', '.join(taken.already_present)}"] if taken.already_present else []
            return "; ".join(copied + present)

        work = partial(copy_runs_into, paths, self._folder())
        self._start(f"taking in {pluralize(len(paths), 'run')} …", work, describe)

    def import_tables(self, paths: Sequence[Path]) -> None:
        """Import tables as runs of the specimen of the Measure page, driven through this bench's amplifier."""
        specimen = self._specimen()
        names = paths[0].name if len(paths) == 1 else f"{len(paths)} tables"

        def describe(imported: tuple[int, list[str]]) -> str:
            self.finished.emit()
            count, cautions = imported
            return "\n".join([f"{names}: {pluralize(count, 'run')} of {specimen or 'unnamed'} imported", *cautions])

        work = partial(import_tables, paths, self._folder(), specimen, self._amplifier)
        self._start(f"importing {names} …", work, describe)

    def move_to_trash(self, paths: Sequence[Path]) -> None:
        """Move runs to the trash."""

        def done(moved: list[TrashedRun]) -> None:
            self._trashed.append(moved)
            count = pluralize(len(paths), "run")
            tell(self._progress_row, f"{count} moved to the trash ({moved[0].trashed.parent})", self.restore_trashed)
            self.finished.emit()

        self._trash_worker.submit(lambda: move_to_trash(list(paths)), done, self._on_trash_error)

    def restore_trashed(self) -> None:
        """Take the runs of the last deletion out of the trash."""
        if not self._trashed:
            return
        moved = self._trashed.pop()

        def done(count: int) -> None:
            tell(self._progress_row, f"{pluralize(count, 'run')} restored")
            self.finished.emit()

        self._trash_worker.submit(lambda: restore_from_trash(moved), done, self._on_trash_error)

    def _on_trash_error(self, error: Exception) -> None:
        self.message.emit(str(error), True)
        self.finished.emit()

    def _start(self, text: str, work: Callable[[Progress], Any], describe_result: Callable[[Any], str]) -> None:
        """Run a file operation in the background; `describe_result` returns the message about its result."""
        progress_row = self._progress_row
        if progress_row.running:
            self.message.emit(f"{progress_row.label.text()} Wait for its end, or stop it, first.", True)
            return

        def done(result: Any) -> None:
            stopped = "stopped" if progress_row.progress.cancelled else ""
            self.message.emit("; ".join(filter(None, [stopped, describe_result(result)])), False)

        def failed(error: Exception) -> None:
            if isinstance(error, OperationCancelled):
                self.message.emit("stopped; nothing was written", False)
                return
            more = "\nMore options on the command line: tactor-bench import --help"
            self.message.emit(f"{error}{more if isinstance(error, UsageError) else ''}", True)

        self.message.emit("", False)
        progress_row.run(text, work, done, failed)
