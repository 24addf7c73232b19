"""Buttons beside the names of specimens: whether there is a sheet, kept up to date in the background; they open it."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QPushButton

from app.common import sentence_case
from app.gui.widgets.actions import tooltip
from app.gui.widgets.background import BackgroundWorker
from app.gui.widgets.layouts import configure

Location = tuple[Path, str]
"""Folder and name of a specimen."""


class SheetButton(QPushButton):
    """Button that shows whether the specimen has a sheet."""

    def __init__(self, page: str) -> None:
        super().__init__()
        configure(self, f"{page}.sheet", kind="choice")
        self.setAccessibleName("specimen sheet")
        self.show_status()

    def show_status(self, text: str = "Sheet …", description: str = "") -> None:
        """Show whether there is a sheet, and the source of dimensions and masses."""
        self.setText(text)
        self.setToolTip(tooltip("specimen", sentence_case(description)))
        self.setAccessibleDescription(description)


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
        locations = self._read = {button: location() for button, location in self._locations.items()}

        def show(statuses: dict[SheetButton, tuple[str, ...]]) -> None:
            for button, status in statuses.items():
                button.show_status(*status)

        self._worker.submit(
            lambda: {button: sheet_status(*at) for button, at in locations.items()}, show, latest_only="sheets"
        )


def sheet_status(folder: Path, specimen: str) -> tuple[str, ...]:
    """Read the sheet of a specimen and return text and description of its button."""
    from app.identification import SheetError, load_sheet  # slow to import

    if not specimen:
        return ()
    try:
        sheet = load_sheet(folder, specimen)
    except SheetError as error:
        return "Sheet at fault …", str(error)
    return "No sheet …" if sheet.path is None else "Sheet …", sheet.description
