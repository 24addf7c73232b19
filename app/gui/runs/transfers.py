"""Files into the folder of the runs and out of it: one thing at a time, beside the window, with how far it is."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal

from app.archive.export import Format
from app.archive.transfer import CopyResult, copy_runs_into, export_runs, import_tables
from app.common.errors import UsageError
from app.common.formatting import pluralize
from app.common.progress import OperationCancelled
from app.config.tables import AmplifierTable
from app.gui.widgets.background import BackgroundWorker
from app.gui.widgets.progress_row import ProgressRow


class RunTransfers(QObject):
    """Exports runs, takes run files in, and imports tables.

    Args:
        going: shows how far it is, and stops it.
        folder: where the runs are, asked when something is to come there.
        specimen: whose tables are imported, asked when some are.
        amplifier: through which they were driven.
    """

    finished = Signal()
    """There may be new runs in the folder."""
    message = Signal(str, bool)
    """What came of it, and whether it is a fault."""

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
        self._worker = BackgroundWorker("run deeds", self)

    def export_runs(self, paths: Sequence[Path], folder: Path, kind: Format) -> None:
        """Runs as files for other programs."""
        going = self._progress_row
        self._start(
            f"exporting {pluralize(len(paths), 'run')} …",
            lambda: export_runs(paths, folder, kind, going.cancelled, going.update_progress),
            lambda count: f"{count} files written to {folder}",
        )

    def copy_in(self, paths: Sequence[Path]) -> None:
        """Copy run files into the folder; what has the same name is never replaced."""
        folder, going = self._folder(), self._progress_row

        def done(taken: CopyResult) -> str:
            self.finished.emit()
            there = f"already there: {', '.join(taken.already_present)}" if taken.already_present else ""
            return "; ".join(
                filter(None, [f"{pluralize(len(taken.copied), 'run')} taken in" if taken.copied else "", there])
            )

        self._start(
            f"taking in {pluralize(len(paths), 'run')} …",
            lambda: copy_runs_into(paths, folder, going.cancelled, going.update_progress),
            done,
        )

    def import_tables(self, paths: Sequence[Path]) -> None:
        """Tables as runs of the specimen of the Measure page, driven through this bench's amplifier."""
        folder, specimen, going = self._folder(), self._specimen(), self._progress_row
        names = paths[0].name if len(paths) == 1 else f"{len(paths)} tables"

        def tell(share: float) -> None:
            if going.cancelled():
                raise OperationCancelled
            going.update_progress(share)

        def done(brought: tuple[int, list[str]]) -> str:
            self.finished.emit()
            count, cautions = brought
            return "\n".join([f"{names}: {pluralize(count, 'run')} of {specimen or 'unnamed'} imported", *cautions])

        self._start(f"importing {names} …", lambda: import_tables(paths, folder, specimen, self._amplifier, tell), done)

    def shutdown(self) -> None:
        """End what works beside the window."""
        self._progress_row.request_cancel()
        self._worker.close()

    def _start(self, text: str, work: Callable[[], Any], describe_result: Callable[[Any], str]) -> None:
        """Do something with files that takes its time; `then` says what came of it."""
        going = self._progress_row
        if going.running:
            self.message.emit(f"{going.label.text()} Wait for its end, or stop it, first.", True)
            return

        def done(answer: Any) -> None:
            stopped = "stopped" if going.cancelled() else ""
            going.finish()
            self.message.emit("; ".join(filter(None, [stopped, describe_result(answer)])), False)

        def failed(error: Exception) -> None:
            going.finish()
            if isinstance(error, OperationCancelled):
                self.message.emit("stopped; nothing was written", False)
            elif isinstance(error, UsageError):
                self.message.emit(f"{error}\nMore can be said in a terminal: tactor-bench import --help", True)
            else:
                self.message.emit(str(error), True)

        self.message.emit("", False)
        going.start(text)
        self._worker.submit(work, done, failed)
