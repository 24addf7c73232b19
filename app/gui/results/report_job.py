"""Report of a specimen, written by another process: it fits the model, which takes seconds of processor time."""

import sys
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, QProcess, QUrl
from PySide6.QtGui import QDesktopServices

from app.gui.widgets import BackgroundWorker, at_end

PROGRAM = ("-c", "from app.cli.main import entry; entry()", "report")


class ReportJob(QObject):
    """Writes one report at a time, like the command `report`, and opens it.

    Args:
        show_message: shows a message.
        open_file: opens the PDF.
    """

    def __init__(
        self,
        show_message: Callable[[str], object],
        parent: QObject,
        open_file: Callable[[QUrl], object] = QDesktopServices.openUrl,
    ) -> None:
        super().__init__(parent)
        self._show_message, self._open_file = show_message, open_file
        self._process: QProcess | None = None
        self._worker = BackgroundWorker("report", self)
        at_end(self, self._end)

    def start_of(self, run: Path) -> None:
        """Write the report of the specimen of a run; the file is read in the background."""

        def read() -> str:
            from app.archive import load_run

            return load_run(run, with_traces=False).record.specimen

        self._worker.submit(
            read, lambda specimen: self.start(run.parent, specimen), lambda error: self._show_message(str(error))
        )

    def start(self, folder: Path, specimen: str) -> None:
        """Write the report of a specimen into the folder of its runs."""
        if self._process is not None:
            self._show_message("A report is being written; wait until it is done.")
            return
        self._show_message(f"Writing the report of {specimen} …")
        self._process = process = QProcess(self)
        process.finished.connect(lambda: self._on_finished(specimen))
        process.errorOccurred.connect(lambda _: self._on_failed(process.errorString()))
        process.start(sys.executable, [*PROGRAM, specimen, "--folder", str(folder), "--out", str(folder)])

    def _end(self) -> None:
        """End a report that is being written."""
        if (process := self._process) is not None:
            process.kill()
            process.waitForFinished()

    def _on_finished(self, specimen: str) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        output = bytes(process.readAllStandardOutput().data()) + bytes(process.readAllStandardError().data())
        lines = [line.strip() for line in output.decode("utf-8", "replace").splitlines() if line.strip()]
        written = [Path(line.removeprefix("wrote ")) for line in lines if line.startswith("wrote ")]
        process.deleteLater()
        if not written:
            self._show_message(
                f"No report of {specimen}: {lines[-1] if lines else 'the program ended without a message'}"
            )
            return
        self._show_message(f"Report of {specimen}: {written[0]}")
        self._open_file(QUrl.fromLocalFile(str(written[0].resolve())))

    def _on_failed(self, why: str) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.deleteLater()
            self._show_message(f"The report cannot be written: {why}")
