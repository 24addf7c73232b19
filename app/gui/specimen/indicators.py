"""Buttons beside the names of specimens that say whether there is a sheet, kept up to date in the background."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from app.gui.widgets import BackgroundWorker, SheetButton, SheetStatus

Location = tuple[Path, str]
"""Folder and name of a specimen."""


class SheetIndicators(QObject):
    """Reads the sheets of the specimens that are shown."""

    pressed = Signal()

    def __init__(self, worker: BackgroundWorker, parent: QObject) -> None:
        super().__init__(parent)
        self._worker = worker
        self._locations: dict[SheetButton, Callable[[], Location]] = {}
        self._read: dict[SheetButton, Location] = {}
        self.started = False
        """Whether sheets are read: not before the first paint of the window."""

    def add(self, button: SheetButton, location: Callable[[], Location]) -> None:
        """Keep a button up to date; `location` returns the specimen that stands beside it."""
        self._locations[button] = location
        button.clicked.connect(lambda _checked=False: self.pressed.emit())
        self.update()

    def start(self) -> None:
        """Begin to read sheets."""
        self.started = True
        self.update()

    def update_changed(self) -> None:
        """Read the sheets if other specimens are shown than before."""
        if self._read != {button: location() for button, location in self._locations.items()}:
            self.update()

    def update(self) -> None:
        """Read the sheets of the specimens that are shown now."""
        if not self.started:
            return
        wanted = self._read = {button: location() for button, location in self._locations.items()}

        def show(found: dict[SheetButton, SheetStatus]) -> None:
            for button, status in found.items():
                button.show_status(status)

        self._worker.submit(
            lambda: {button: sheet_status(*at) for button, at in wanted.items()}, show, latest_only="sheets"
        )


def sheet_status(folder: Path, specimen: str) -> SheetStatus:
    """Return what is said of the sheet of a specimen. Reads the sheet."""
    from app.identification import SheetError, load_sheet  # slow to import

    if not specimen:
        return SheetStatus()
    try:
        sheet = load_sheet(folder, specimen)
    except SheetError as error:
        return SheetStatus("Sheet at fault …", str(error))
    return SheetStatus("No sheet …" if sheet.path is None else "Sheet …", sheet.description)
