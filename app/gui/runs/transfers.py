"""Files into the folder of the runs and out of it: one thing at a time, beside the window, with how far it is."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal

from app.archive.export import Format
from app.archive.transfer import TakenIn, bring_in, export_runs, take_in
from app.common.errors import UsageError
from app.common.formatting import counted
from app.common.progress import Stopped
from app.config.tables import AmplifierTable
from app.gui.widgets.background import Jobs
from app.gui.widgets.progress_row import GoingOn


class Transfers(QObject):
    """Exports runs, takes run files in, and imports tables.

    Args:
        going: shows how far it is, and stops it.
        folder: where the runs are, asked when something is to come there.
        specimen: whose tables are imported, asked when some are.
        amplifier: through which they were driven.
    """

    came = Signal()
    """There may be new runs in the folder."""
    said = Signal(str, bool)
    """What came of it, and whether it is a fault."""

    def __init__(
        self,
        going: GoingOn,
        folder: Callable[[], Path],
        specimen: Callable[[], str],
        amplifier: AmplifierTable,
        parent: QObject,
    ) -> None:
        super().__init__(parent)
        self._going, self._folder, self._specimen, self._amplifier = going, folder, specimen, amplifier
        self._jobs = Jobs("run deeds", self)

    def export(self, paths: Sequence[Path], folder: Path, kind: Format) -> None:
        """Runs as files for other programs."""
        going = self._going
        self._begin(
            f"exporting {counted(len(paths), 'run')} …",
            lambda: export_runs(paths, folder, kind, going.stopped, going.tell),
            lambda count: f"{count} files written to {folder}",
        )

    def take_in(self, paths: Sequence[Path]) -> None:
        """Copy run files into the folder; what has the same name is never replaced."""
        folder, going = self._folder(), self._going

        def done(taken: TakenIn) -> str:
            self.came.emit()
            there = f"already there: {', '.join(taken.there)}" if taken.there else ""
            return "; ".join(
                filter(None, [f"{counted(len(taken.copied), 'run')} taken in" if taken.copied else "", there])
            )

        self._begin(
            f"taking in {counted(len(paths), 'run')} …", lambda: take_in(paths, folder, going.stopped, going.tell), done
        )

    def bring_in(self, paths: Sequence[Path]) -> None:
        """Tables as runs of the specimen of the Measure page, driven through this bench's amplifier."""
        folder, specimen, going = self._folder(), self._specimen(), self._going
        names = paths[0].name if len(paths) == 1 else f"{len(paths)} tables"

        def tell(share: float) -> None:
            if going.stopped():
                raise Stopped
            going.tell(share)

        def done(brought: tuple[int, list[str]]) -> str:
            self.came.emit()
            count, cautions = brought
            return "\n".join([f"{names}: {counted(count, 'run')} of {specimen or 'unnamed'} imported", *cautions])

        self._begin(f"importing {names} …", lambda: bring_in(paths, folder, specimen, self._amplifier, tell), done)

    def end(self) -> None:
        """End what works beside the window."""
        self._going.end_it()
        self._jobs.close()

    def _begin(self, words: str, work: Callable[[], Any], then: Callable[[Any], str]) -> None:
        """Do something with files that takes its time; `then` says what came of it."""
        going = self._going
        if going.going:
            self.said.emit(f"{going.words.text()} Wait for its end, or stop it, first.", True)
            return

        def done(answer: Any) -> None:
            stopped = "stopped" if going.stopped() else ""
            going.over()
            self.said.emit("; ".join(filter(None, [stopped, then(answer)])), False)

        def failed(error: Exception) -> None:
            going.over()
            if isinstance(error, Stopped):
                self.said.emit("stopped; nothing was written", False)
            elif isinstance(error, UsageError):
                self.said.emit(f"{error}\nMore can be said in a terminal: tactor-bench import --help", True)
            else:
                self.said.emit(str(error), True)

        self.said.emit("", False)
        going.begin(words)
        self._jobs.do(work, done, failed)
