"""Perception threshold of the folder of runs, from its laboratory file, in every plot of the window."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QWidget

from app.gui.widgets import BackgroundWorker

if TYPE_CHECKING:
    from model.response import PerceptionThreshold


def read_folder_threshold(folder: Path) -> PerceptionThreshold | None:
    """Return the threshold that the laboratory file of a folder names; None if there is none.

    Raises:
        UsageError, ParameterError: the file has faults.
    """
    from app.config import LABORATORY_FILE_NAME

    if not (folder / LABORATORY_FILE_NAME).exists():
        return None
    from app.identification import chosen_threshold  # loads scipy
    from model.response import ABDOMEN_THRESHOLD

    threshold = chosen_threshold(folder)
    return None if threshold is ABDOMEN_THRESHOLD else threshold


class FolderThreshold:
    """Reads the threshold of a folder in the background, and shows it in the plots of the pages.

    Args:
        worker: reads the file.
        pages: function that returns the existing pages.
        show_message: shows a message.
    """

    def __init__(
        self, worker: BackgroundWorker, pages: Callable[[], Iterable[object]], show_message: Callable[[str], object]
    ) -> None:
        self._worker, self._pages, self._show_message = worker, pages, show_message
        self._problem = ""
        self.threshold: PerceptionThreshold | None = None

    def read(self, folder: Path) -> None:
        """Read the file of a folder, and show its threshold on all pages."""
        self._worker.submit(
            lambda: read_folder_threshold(folder), self._on_read, self._on_error, latest_only="perception threshold"
        )

    def show_on_new(self, page: object) -> None:
        """Show the threshold in the plots of a new page."""
        if self.threshold is not None:
            self.show_on(page)

    def show_on(self, page: object) -> None:
        """Show the threshold in the plots of one page."""
        children = page.findChildren(QWidget) if isinstance(page, QWidget) else []
        for widget in (page,) if hasattr(page, "show_threshold") else children:
            if callable(show := getattr(widget, "show_threshold", None)):
                show(self.threshold)

    def _on_read(self, threshold: PerceptionThreshold | None) -> None:
        self._problem = ""
        if threshold != self.threshold:
            self.threshold = threshold
            for page in self._pages():
                self.show_on(page)

    def _on_error(self, error: Exception) -> None:
        if str(error) != self._problem:  # once, and not at each change of the page
            self._problem = str(error)
            self._show_message(self._problem)
