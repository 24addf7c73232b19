"""Runs of a folder from the catalogue, rescanned in the background."""

from collections.abc import Callable, Sequence
from pathlib import Path
from time import monotonic

from PySide6.QtCore import QObject, Signal

from app.archive import Catalogue, RunSummary, ScanResult, annotate_runs
from app.gui.widgets import BackgroundWorker, JobProgress

LOOK_INTERVAL_S = 1.0
"""Interval between scans of the folders; notifications of the system do not report files of other computers."""


class RunFolderModel(QObject):
    """Lists the catalogued runs immediately, then scans for changes; one scan at a time.

    Args:
        folder: returns the folder; called at every scan.
        index: path of the catalogue.
    """

    cleared = Signal()
    """Emitted when another folder is listed, which is empty so far."""
    listed = Signal()
    """Emitted when `summaries` has changed."""
    progressed = Signal(float, str)
    """Fraction of the scan that is done and a text, empty for a short scan."""
    scanned = Signal(object)
    """A scan has finished: `ScanResult`."""
    failed = Signal(object)
    """An exception with a message."""

    def __init__(self, folder: Callable[[], Path], index: Path | None, parent: QObject) -> None:
        super().__init__(parent)
        self._folder, self._index = folder, index
        self._worker = BackgroundWorker("runs", self, self.cancel)
        self.summaries: list[RunSummary] = []
        self._catalogue: Catalogue | None = None
        self.is_reading = False
        """Whether the folder is being read: runs may be missing in `summaries`, and no other scan begins."""
        self.active_file: Path | None = None
        """The file that this program is writing; scans skip it."""
        self._busy = self._rescan_due = False
        self._looked_s = 0.0
        self._progress = JobProgress(self.progressed.emit)

    @property
    def path(self) -> Path:
        """The folder of `summaries`."""
        return self._folder() if self._catalogue is None else self._catalogue.folder

    @property
    def is_idle(self) -> bool:
        """Whether the folder was scanned and no job is pending."""
        return self._catalogue is not None and not self._worker.pending

    def set_busy(self, busy: bool) -> None:
        """Note whether a run is active; a run that ended makes a rescan due."""
        self._rescan_due = self._rescan_due or (self._busy and not busy)
        self._busy = busy

    def refresh_if_changed(self) -> None:
        """Scan if the folder is another one or a run has ended; look for other programs' files every second."""
        if self._catalogue is None or self._catalogue.folder != self._folder() or self._rescan_due:
            self.rescan()
        elif self.is_idle and monotonic() - self._looked_s >= LOOK_INTERVAL_S:
            self._looked_s = monotonic()
            self._worker.submit(self._catalogue.has_changed_folder, lambda changed: self.rescan() if changed else None)

    def rescan(self) -> None:
        """List the catalogued runs, then scan for changes; while the folder is being read, at the next refresh."""
        self._rescan_due = self.is_reading
        if self.is_reading:
            return
        self.is_reading = True
        folder, excluded = self._folder(), () if self.active_file is None else (self.active_file,)
        if self._catalogue is None or self._catalogue.folder != folder:
            self._catalogue = Catalogue(folder, self._index)
            self.summaries = []
            self.cleared.emit()
        catalogue, self._progress.cancelled = self._catalogue, False
        self._worker.submit(catalogue.entries, self._on_listed, self._on_error)
        self._worker.submit(lambda: catalogue.scan(self._progress, excluded), self._on_scanned, self._on_error)

    def cancel(self) -> None:
        """Cancel the present scan; runs that were read are kept."""
        self._progress.cancelled = True

    def annotate(self, runs: Sequence[tuple[Path, str, str]], tags: str, note: str) -> None:
        """Write tags and a note for runs, which are given with their present tags and note."""
        self._worker.submit(lambda: annotate_runs(list(runs), tags, note), lambda _: self.rescan(), self._on_error)

    def _on_listed(self, summaries: list[RunSummary]) -> None:
        self.summaries = summaries
        self.listed.emit()

    def _on_scanned(self, result: ScanResult) -> None:
        assert self._catalogue is not None
        self.is_reading = result.has_changes
        self.scanned.emit(result)
        if result.has_changes:
            self._worker.submit(self._catalogue.entries, self._on_read, self._on_error)

    def _on_read(self, summaries: list[RunSummary]) -> None:
        self.is_reading = False
        self._on_listed(summaries)

    def _on_error(self, error: Exception) -> None:
        self.is_reading = False
        self.failed.emit(error)
