"""Specimen page over the pages: the sheet of a specimen, saved at every change and undone by steps."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QImage, QImageReader
from PySide6.QtWidgets import QWidget

from app.archive import mount_part
from app.common import UndoHistory, sentence_case
from app.gui.specimen.sheet_form import SheetForm
from app.gui.widgets import (
    ACTIONS,
    BackgroundWorker,
    StatusLine,
    add_actions,
    choose_file,
    column,
    configure,
    make_button,
    make_label,
    make_scroll_area,
    row,
    tooltip,
)
from app.identification import (
    SheetChangedError,
    SheetDraft,
    SpecimenSheet,
    check_draft,
    create_sheet,
    load_sheet,
    save_draft,
)
from protocols.base import MOUNTED_PARTS

PICTURE_SIZE = QSize(220, 96)
PICTURES = "Pictures (*.jpg *.jpeg *.png *.bmp *.gif *.webp)"


class SpecimenPage(QWidget):
    """Shows the sheet of one specimen of a folder."""

    title = "Specimen sheet"
    closed = Signal()
    saved = Signal()
    """The sheet was written."""

    def __init__(self) -> None:
        super().__init__()
        self._worker = BackgroundWorker("specimen sheet", self)
        self._folder, self._sheet = Path(), SpecimenSheet()
        self._base = self._sheet
        """Contents of the file; used in the background thread only."""
        self._history: UndoHistory[SheetDraft] = UndoHistory(SheetDraft())
        self._picture = ""
        self.heading = make_label(kind="heading", wrap=False, name="sheet.heading")
        self.source_label = make_label(name="sheet.source")
        self.message_label = configure(StatusLine(), "sheet.message")
        self.make_sheet_button = make_button(
            "Make a sheet",
            self._make_sheet,
            "go",
            "Write a commented sheet beside the runs: Table I's values stay in use until others are entered",
            "sheet.make",
        )
        self.undo_button, self.redo_button = (
            make_button(text, act, "choice", tooltip(f"sheet.{name}"), f"sheet.{name}", accessibleName=name)
            for text, name, act in (("↶", "undo", self.undo), ("↷", "redo", self.redo))
        )
        tip = "{}, now: the next runs are of a new mounting"
        self.mount_buttons = {
            part: make_button(part, partial(self._mount, part), "choice", tip.format(title), f"sheet.mounted.{part}")
            for part, title in MOUNTED_PARTS.items()
        }
        self.form = SheetForm()
        self._area = make_scroll_area(focusPolicy=Qt.FocusPolicy.NoFocus)
        self._area.setWidget(self.form)
        self.form.setAutoFillBackground(False)
        close = make_button("Close", self.closed.emit, name="sheet.close", key=ACTIONS["specimen"].shortcut)
        column(
            row((self.heading, 1), self.undo_button, self.redo_button, close, spacing=8),
            row((self.source_label, 1), self.make_sheet_button, spacing=12),
            row(make_label("Mounted anew:", wrap=False), *self.mount_buttons.values(), None, spacing=6),
            self.message_label,
            (self._area, 1),
            parent=self,
            margins=(16, 8, 8, 6),
            spacing=6,
        )
        self.form.edited.connect(self._on_edited)
        self.form.browse_pressed.connect(self._choose_picture)
        add_actions(self, {"sheet.undo": self.undo, "sheet.redo": self.redo})

    def show_specimen(self, folder: Path, specimen: str) -> None:
        """Read and show the sheet of a specimen."""
        self.heading.setText(f"Specimen {specimen}" if specimen else "No specimen")
        self._area.setEnabled(False)
        for button in self.mount_buttons.values():
            button.setEnabled(bool(specimen))
        self.make_sheet_button.hide()
        if not specimen:
            self.source_label.setText(
                "Enter the name of the specimen first, on the page Measure; its sheet is kept beside its runs."
            )
            return
        self._folder = folder
        self._load(specimen)

    def undo(self) -> None:
        """Show and save the texts before the last change."""
        if self._history.undo():
            self._save()

    def redo(self) -> None:
        """Show and save the sheet after an undo."""
        if self._history.redo():
            self._save()

    # -- inside ----------------------------------------------------------------------------------------------------------

    def _load(self, specimen: str, problem: str = "") -> None:
        folder = self._folder
        self._submit(lambda: load_sheet(folder, specimen), lambda sheet: self._on_loaded(sheet, problem), "load")

    def _on_loaded(self, sheet: SpecimenSheet, problem: str) -> None:
        self._sheet = sheet
        self._history = UndoHistory(SheetDraft.of(sheet))
        self.message_label.show_message(problem, is_error=True)
        self._area.setEnabled(True)
        self._show_sheet()
        if not problem:
            self.form.rows["L"].edits["value"].setFocus()

    def _on_edited(self, draft: SheetDraft, _field: str) -> None:
        self._history.push(draft)
        self._save()

    def _make_sheet(self) -> None:
        folder, specimen = self._folder, self._sheet.specimen
        self._submit(lambda: create_sheet(folder, specimen), self._on_saved)

    def _mount(self, part: str) -> None:
        """Record that a part was mounted anew."""
        folder, specimen = self._folder, self._sheet.specimen

        def show(path: Path) -> None:
            self.message_label.show_message(f"Recorded in {path.name}: {MOUNTED_PARTS[part]}")

        self._worker.submit(lambda: mount_part(folder, specimen, part), show, self._on_error)

    def _save(self) -> None:
        """Write the draft in the background; values at fault stay in the form and are not written."""
        draft, folder = self._history.current, self._folder
        self._show_draft()
        self._submit(lambda: save_draft(folder, self._base, draft), self._on_saved)

    def _submit(
        self, work: Callable[[], SpecimenSheet], on_sheet: Callable[[SpecimenSheet], object], latest_only: str = ""
    ) -> None:
        """Read or write the sheet in the background."""

        def work_and_keep() -> SpecimenSheet:
            self._base = work()
            return self._base

        self._worker.submit(work_and_keep, on_sheet, self._on_error, latest_only)

    def _on_saved(self, sheet: SpecimenSheet) -> None:
        written, self._sheet = sheet != self._sheet, sheet
        self._show_sheet()
        if written:
            self.message_label.show_message(f"Saved: {sheet.path}")
            self.saved.emit()

    def _on_error(self, error: Exception) -> None:
        if isinstance(error, SheetChangedError):
            self._load(self._sheet.specimen, str(error))
        self.message_label.show_message(str(error), is_error=True)

    def _show_sheet(self) -> None:
        self.source_label.setText(f"{sentence_case(self._sheet.description)}.")
        self.make_sheet_button.setVisible(self._sheet.path is None)
        self._show_draft()
        self._show_picture()

    def _show_draft(self) -> None:
        draft = self._history.current
        self.form.show_draft(draft, check_draft(draft, self._sheet.specimen))
        self.undo_button.setEnabled(self._history.can_undo)
        self.redo_button.setEnabled(self._history.can_redo)

    def _show_picture(self) -> None:
        path = str(self._folder / self._sheet.photograph) if self._sheet.photograph else ""
        if path == self._picture:
            return
        self._picture = path

        def shown(image: QImage | None) -> None:
            self.form.show_picture(image)
            if path and image is None:
                self.message_label.show_message(f"There is no picture {path}, or it cannot be read.", is_error=True)

        self._worker.submit(lambda: _read_picture(path), shown, self._on_error, latest_only="picture")

    def _choose_picture(self) -> None:
        def show(path: Path) -> None:
            self.form.set_photograph(path.absolute(), self._folder.absolute())

        choose_file(self, "Photograph of the specimen", show, PICTURES, str(self._folder))


def _read_picture(path: str) -> QImage | None:
    """Read a picture no larger than it is shown."""
    if not path:
        return None
    reader = QImageReader(path)
    reader.setAutoTransform(True)
    size = reader.size()
    if not size.isValid():
        return None
    reader.setScaledSize(size.scaled(PICTURE_SIZE, Qt.AspectRatioMode.KeepAspectRatio))
    image = reader.read()
    return None if image.isNull() else image
