"""The folder of the runs as far as it is known, and looks at it beside the window."""

from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from app.archive.catalogue import Catalogue, ScanResult
from app.archive.run_summary import RunSummary
from app.archive.transfer import annotate_runs
from app.gui.widgets.background import BackgroundWorker


class RunFolderModel(QObject):
    """Lists what is known at once, then what has changed since; one look at a time.

    Args:
        folder: where the runs are, asked at every look.
        index: where what is known is kept.
    """

    cleared = Signal()
    """The folder is another one, of which nothing is known yet."""
    listed = Signal()
    """`entries` are what is known now."""
    progressed = Signal(int, int)
    """How many of how many files are read."""
    scanned = Signal(object)
    """A look is over: `ScanResult`."""
    failed = Signal(object)
    """What went wrong: an exception with a sentence."""

    def __init__(self, folder: Callable[[], Path], index: Path | None, parent: QObject) -> None:
        super().__init__(parent)
        self._folder, self._index = folder, index
        self._worker = BackgroundWorker("runs", self)
        self.summaries: list[RunSummary] = []
        self._catalogue: Catalogue | None = None
        self._excluded: tuple[Path, ...] = ()
        self._busy = self._rescan_due = self._scanning = self._cancelled = False

    @property
    def path(self) -> Path:
        """The folder that `entries` are of."""
        return self._folder() if self._catalogue is None else self._catalogue.folder

    @property
    def is_idle(self) -> bool:
        """Whether it was looked at, and nothing is under way."""
        return self._catalogue is not None and not self._worker.pending

    def set_busy(self, busy: bool) -> None:
        """A run that ended is news."""
        self._rescan_due = self._rescan_due or (self._busy and not busy)
        self._busy = busy

    def set_active_file(self, path: Path | None) -> None:
        """The file that this program is writing; it is left alone."""
        self._excluded = () if path is None else (path,)

    def refresh_if_changed(self) -> None:
        """Look where there may be something new."""
        if self._catalogue is None or self._catalogue.folder != self._folder() or self._rescan_due:
            self.rescan()

    def rescan(self) -> None:
        """List what is known at once, then what has changed since."""
        if self._scanning:
            return
        folder, leave = self._folder(), self._excluded
        if self._catalogue is None or self._catalogue.folder != folder:
            self._catalogue = Catalogue(folder, self._index)
            self.summaries = []
            self.cleared.emit()
        catalogue, self._rescan_due, self._scanning, self._cancelled = self._catalogue, False, True, False
        self._worker.submit(catalogue.entries, self._on_listed, self._on_error)
        self._worker.submit(
            lambda: catalogue.scan(self.progressed.emit, lambda: self._cancelled, leave),
            self._on_scanned,
            self._on_error,
        )

    def cancel(self) -> None:
        """End the look that is under way; what was read is kept."""
        self._cancelled = True

    def annotate(self, runs: Sequence[tuple[Path, str, str]], tags: str, note: str) -> None:
        """Tags and a note for runs, given with the tags and the note they have."""
        self._worker.submit(lambda: annotate_runs(list(runs), tags, note), lambda _: self.rescan(), self._on_error)

    def shutdown(self) -> None:
        """End what works beside the window."""
        self._cancelled = True
        self._worker.close()

    def _on_listed(self, summaries: list[RunSummary]) -> None:
        self.summaries = summaries
        self.listed.emit()

    def _on_scanned(self, result: ScanResult) -> None:
        self._scanning = False
        self.scanned.emit(result)
        if result.has_changes and self._catalogue is not None:
            self._worker.submit(self._catalogue.entries, self._on_listed, self._on_error)

    def _on_error(self, error: Exception) -> None:
        self._scanning = False
        self.failed.emit(error)
