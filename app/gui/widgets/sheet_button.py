"""Button beside the name of a specimen: whether it has a sheet, and opens it."""

from dataclasses import dataclass

from PySide6.QtWidgets import QPushButton

from app.gui.widgets.actions import tooltip
from app.gui.widgets.layouts import configure


@dataclass(frozen=True, slots=True)
class SheetStatus:
    """What is said of the sheet of a specimen."""

    text: str = "Sheet …"
    description: str = ""


class SheetButton(QPushButton):
    """Says whether the specimen has a sheet."""

    def __init__(self, page: str) -> None:
        super().__init__()
        configure(self, f"{page}.sheet", kind="choice")
        self.show_status(SheetStatus())

    def show_status(self, status: SheetStatus) -> None:
        """Show whether there is a sheet, and what dimensions and masses are from."""
        text = status.description
        self.setText(status.text)
        self.setToolTip(tooltip("specimen", f"{text[:1].upper()}{text[1:]}" if text else ""))
        self.setAccessibleName("specimen sheet")
        self.setAccessibleDescription(text)
