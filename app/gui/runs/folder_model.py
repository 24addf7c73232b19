"""The folder of the runs as far as it is known, and looks at it beside the window."""

from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from app.archive.catalogue import Catalogue, Scanned
from app.archive.run_summary import Entry
from app.archive.transfer import annotate
from app.gui.widgets.background import Jobs


class RunsFolder(QObject):
    """Lists what is known at once, then what has changed since; one look at a time.

    Args:
        folder: where the runs are, asked at every look.
        index: where what is known is kept.
    """

    emptied = Signal()
    """The folder is another one, of which nothing is known yet."""
    listed = Signal()
    """`entries` are what is known now."""
    progressed = Signal(int, int)
    """How many of how many files are read."""
    scanned = Signal(object)
    """A look is over: `Scanned`."""
    failed = Signal(object)
    """What went wrong: an exception with a sentence."""

    def __init__(self, folder: Callable[[], Path], index: Path | None, parent: QObject) -> None:
        super().__init__(parent)
        self._folder, self._index = folder, index
        self._jobs = Jobs("runs", self)
        self.entries: list[Entry] = []
        self._catalogue: Catalogue | None = None
        self._leave: tuple[Path, ...] = ()
        self._busy = self._due = self._scanning = self._stop = False

    @property
    def path(self) -> Path:
        """The folder that `entries` are of."""
        return self._folder() if self._catalogue is None else self._catalogue.folder

    @property
    def settled(self) -> bool:
        """Whether it was looked at, and nothing is under way."""
        return self._catalogue is not None and not self._jobs.waiting

    def show_busy(self, busy: bool) -> None:
        """A run that ended is news."""
        self._due = self._due or (self._busy and not busy)
        self._busy = busy

    def writing(self, path: Path | None) -> None:
        """The file that this program is writing; it is left alone."""
        self._leave = () if path is None else (path,)

    def refresh(self) -> None:
        """Look where there may be something new."""
        if self._catalogue is None or self._catalogue.folder != self._folder() or self._due:
            self.look()

    def look(self) -> None:
        """List what is known at once, then what has changed since."""
        if self._scanning:
            return
        folder, leave = self._folder(), self._leave
        if self._catalogue is None or self._catalogue.folder != folder:
            self._catalogue = Catalogue(folder, self._index)
            self.entries = []
            self.emptied.emit()
        catalogue, self._due, self._scanning, self._stop = self._catalogue, False, True, False
        self._jobs.do(catalogue.entries, self._listed, self._failed)
        self._jobs.do(
            lambda: catalogue.scan(self.progressed.emit, lambda: self._stop, leave), self._scanned, self._failed
        )

    def stop(self) -> None:
        """End the look that is under way; what was read is kept."""
        self._stop = True

    def annotate(self, runs: Sequence[tuple[Path, str, str]], tags: str, note: str) -> None:
        """Tags and a note for runs, given with the tags and the note they have."""
        self._jobs.do(lambda: annotate(list(runs), tags, note), lambda _: self.look(), self._failed)

    def end(self) -> None:
        """End what works beside the window."""
        self._stop = True
        self._jobs.close()

    def _listed(self, entries: list[Entry]) -> None:
        self.entries = entries
        self.listed.emit()

    def _scanned(self, scanned: Scanned) -> None:
        self._scanning = False
        self.scanned.emit(scanned)
        if scanned.news and self._catalogue is not None:
            self._jobs.do(self._catalogue.entries, self._listed, self._failed)

    def _failed(self, error: Exception) -> None:
        self._scanning = False
        self.failed.emit(error)
