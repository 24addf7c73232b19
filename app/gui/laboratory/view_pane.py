"""Base of the panes that compute a view of the fleet in the background and export a table of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QWidget

from app.common import Table, sentence_case
from app.fleet import Fleet
from app.gui.widgets import BackgroundWorker, Mode, choose_file, make_button, make_combo


class ViewPane(QWidget):
    """Shows a view of a folder.

    Args:
        worker: computes the view, in the background.
        show_message: shows a message; the second argument marks an error.

    Attributes:
        FILE_STEM: proposed name of an exported file.
        EXPORTED: noun phrase of the exported table.
        BUTTON_NAME: object name of the button that exports.
        PROBLEM: message of an error.
    """

    FILE_STEM = EXPORTED = BUTTON_NAME = ""
    PROBLEM = "{}"

    run_open_requested = Signal(str)
    """Path of a run, from the folder."""

    def __init__(self, worker: BackgroundWorker, show_message: Callable[[str, bool], object]) -> None:
        super().__init__()
        self._worker, self._show_message = worker, show_message
        self._fleet: Fleet | None = None
        self._folder = Path()
        self.view: Any = None
        self.exported_table: Table | None = None
        """Of the view."""
        tip = f"{sentence_case(self.EXPORTED)} as CSV, SI, every digit"
        self.export_button = make_button("Export …", self._choose_export, "choice", tip, self.BUTTON_NAME)

    def export(self, path: Path) -> None:
        """Write the table of the view as CSV in the background."""
        if (table := self.exported_table) is not None:
            self._worker.submit(
                lambda: table.to_csv(path),
                lambda _: self._show_message(f"Written: {path}", False),
                lambda error: self._show_message(f"{path} cannot be written: {error}", True),
            )

    def _show_view(self, view: Any) -> None:
        """Show a computed view; None: there is none."""
        raise NotImplementedError

    def _on_error(self, error: Exception) -> None:
        self._show_view(None)
        self._show_message(self.PROBLEM.format(error), True)

    def _choose_export(self) -> None:
        mark = "_SIMULATED" if self.view is not None and self.view.simulated else ""
        proposed = str(self._folder / f"{self.FILE_STEM}{mark}.csv")
        choose_file(self, f"Export {self.EXPORTED}", self.export, "CSV (*.csv)", proposed, Mode.AnyFile)


def make_filter_combo(name: str, accessible_name: str, *choices: tuple[str, object]) -> QComboBox:
    """Return a combo box as wide as its longest choice."""
    return make_combo(name, accessible_name, choices, sizeAdjustPolicy=QComboBox.SizeAdjustPolicy.AdjustToContents)
