"""Form of a specimen sheet: dimensions, weighed masses, clamp and membrane, each with uncertainty, instrument and day."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QImage, QPixmap
from PySide6.QtWidgets import QGridLayout, QLabel, QLineEdit, QWidget

from app.common import sentence_case
from app.gui.widgets import (
    column,
    configure,
    fill_combo,
    grid,
    make_button,
    make_combo,
    make_label,
    make_labelled_grid,
    make_line_edit,
    make_panel,
    row,
    set_style_kind,
    show_text,
)
from app.identification import (
    DIMENSIONS,
    ENTRY_FIELDS,
    GROUPS,
    TABLE_ONE,
    CheckedDraft,
    EntryText,
    SheetDraft,
    group_of,
    sheet_unit,
    table_one_entry,
    today,
)
from model.identification import SPECIMEN_PARAMETERS, parameter_spec

TITLES = {"plate": "Plate and MFC", "masses": "Weighed masses", "clamp": "Clamp", "membrane": "Membrane"}
OPTIONAL = ("mass_put_in", "mass_offset", "clamp_flexibility")
"""Values that Table I does not have and that a laboratory may know."""
TEXT_LABELS = {"serial": "serial number", "batch": "batch", "photograph": "photograph", "notes": "notes"}
DESCRIPTION_HINTS = {
    "plate": "alloy, batch, how it was cut",
    "masses": "which masses, how they are fixed",
    "clamp": "kind of clamp, torque of its screws",
    "membrane": "material, batch, age",
}

FIELD_LABELS = {"value": "value", "uncertainty": "standard uncertainty", "instrument": "instrument", "date": "day"}
LEAST_WIDTHS = {"value": 88, "uncertainty": 88, "instrument": 96, "date": 88}
COLUMNS = len(ENTRY_FIELDS) + 2
"""Of the grid: name, the fields, and after the uncertainty the unit."""


class EntryRow(QObject):
    """Widgets of one value, and below them its error or question; empty fields show Table I."""

    edited = Signal(str)
    """A field was left with another text: name of the parameter."""

    def __init__(self, name: str, parent: QObject) -> None:
        super().__init__(parent)
        self.name = name
        spec, (_, unit) = parameter_spec(name), sheet_unit(name)
        self.meaning = sentence_case(spec.description)
        self.label = make_label(f"{name}  {spec.description}", name=f"sheet.{name}")
        self.unit_label = make_label(unit, wrap=False)
        self.note_label = make_label(name=f"sheet.{name}.note")
        placeholders = dict[str, str]()
        if name in TABLE_ONE and TABLE_ONE[name].uncertainty is not None:
            entry, (factor, _) = table_one_entry(name), sheet_unit(name)
            placeholders = {
                "value": f"{factor * entry.value:.6g}",
                "uncertainty": f"{factor * entry.uncertainty:.3g}",
                "instrument": f"Table I: {TABLE_ONE[name].instrument or 'literature'}",
            }
        self.edits: dict[str, QLineEdit] = {}
        for field in ENTRY_FIELDS:
            shown = unit if field in ("value", "uncertainty") else ""
            self.edits[field] = edit = make_line_edit(
                f"sheet.{name}.{field}",
                f"{name} {FIELD_LABELS[field]} {shown}",
                placeholderText=placeholders.get(field, ""),
                toolTip=self._help(field, unit),
                minimumWidth=LEAST_WIDTHS[field],
            )
            edit.editingFinished.connect(self._on_edited)
        self._text = EntryText()

    @property
    def text(self) -> EntryText:
        """The texts as they are typed."""
        return EntryText(**{field: edit.text().strip() for field, edit in self.edits.items()})

    def show_text(self, text: EntryText) -> None:
        self._text = text
        for field, edit in self.edits.items():
            if edit.text().strip() != getattr(text, field):
                edit.setText(getattr(text, field))
                edit.setCursorPosition(0)

    def show_finding(self, fault: tuple[str, str] | None, question: str) -> None:
        """Show the error, else the question."""
        at_fault, message = fault or ("", "")
        show_text(self.note_label, f"✕ {message}" if message else question)
        set_style_kind(self.note_label, "fault" if message else "caution")
        for field, edit in self.edits.items():
            set_style_kind(edit, "faulty" if field == at_fault else "")
            edit.setAccessibleDescription(message if field == at_fault else self.meaning)

    def add_to(self, layout: QGridLayout, at: int) -> None:
        """Put the widgets into two rows of a grid."""
        layout.addWidget(self.label, at, 0)
        widgets = [*self.edits.values()]
        widgets.insert(2, self.unit_label)  # type: ignore[arg-type]
        for place, widget in enumerate(widgets, 1):
            layout.addWidget(widget, at, place)
        layout.addWidget(self.note_label, at + 1, 0, 1, COLUMNS)

    def _help(self, field: str, unit: str) -> str:
        match field:
            case "value":
                weighed = "\nOr as weighed: mass / length, for example 0.588 g / 52 mm" if unit == "g/m" else ""
                return f"{self.meaning}\nIn {unit or 'parts of 1'}; another unit may be written{weighed}"
            case "uncertainty":
                weighed = "\nOf a weighing: 0.01 g / 0.3 mm" if unit == "g/m" else ""
                return (
                    f"Standard uncertainty (k = 1) in {unit or 'parts of 1'}, or a share such as 1 %{weighed}\n"
                    "Half a graduation, or limits of error, divided by the root of 3"
                )
            case "instrument":
                return "Measuring instrument, for example caliper 150 mm"
        return "Day of the measurement, for example 2026-11-20; today if it is left empty"

    def _on_edited(self) -> None:
        if self.text != self._text:
            self.edited.emit(self.name)


class SheetForm(QWidget):
    """Shows a draft and emits it when a field was left with another text."""

    edited = Signal(object, str)
    """The `SheetDraft`, and the field that was changed."""
    browse_pressed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.draft = SheetDraft()
        self.rows: dict[str, EntryRow] = {}
        self._grids: dict[str, QGridLayout] = {}
        self.text_edits = {name: make_line_edit(f"sheet.{name}", label) for name, label in TEXT_LABELS.items()}
        self.description_edits = {
            group: make_line_edit(
                f"sheet.{group}.description", f"description of the {group}", placeholderText=DESCRIPTION_HINTS[group]
            )
            for group in GROUPS
        }
        for edit in (*self.text_edits.values(), *self.description_edits.values()):
            edit.editingFinished.connect(self._on_text_edited)
        self.picture_label = configure(QLabel(), "sheet.picture", accessibleName="photograph of the specimen")
        self.picture_label.hide()
        self.browse_button = make_button(
            "Choose …", self.browse_pressed.emit, "choice", "Choose a picture", "sheet.browse"
        )
        self.more_box = make_combo(
            "sheet.more", "another value", toolTip="Another parameter of the model with a value for this specimen"
        )
        self.more_box.activated.connect(lambda _: self._add_chosen())
        panels = [self._make_panel(group) for group in GROUPS]
        column(
            self._make_general(), *panels, row(self.more_box, None), None, parent=self, margins=(0, 0, 8, 0), spacing=8
        )
        self._fill_more_box()

    def show_draft(self, draft: SheetDraft, checked: CheckedDraft) -> None:
        """Show texts and their errors."""
        self.draft = draft
        for name in draft.entries:
            if name not in self.rows:
                self._add_row(name)
        for name, line in self.rows.items():
            line.show_text(draft.entries.get(name, EntryText()))
            line.show_finding(checked.faults.get(name), checked.questions.get(name, ""))
        for edits, texts in ((self.text_edits, draft.texts), (self.description_edits, draft.descriptions)):
            for name, edit in edits.items():
                if edit.text() != texts.get(name, ""):
                    edit.setText(texts.get(name, ""))
                    edit.setCursorPosition(0)
        self._fill_more_box()

    def show_picture(self, image: QImage | None) -> None:
        """Show the photograph; none if it cannot be read."""
        self.picture_label.setVisible(image is not None)
        if image is not None:
            self.picture_label.setPixmap(QPixmap.fromImage(image))

    def set_photograph(self, path: Path, folder: Path) -> None:
        """Enter the path of a photograph, from the folder of the sheet where it lies below it."""
        inside = path.is_relative_to(folder)
        self.text_edits["photograph"].setText(path.relative_to(folder).as_posix() if inside else str(path))
        self._on_text_edited()

    # -- inside ----------------------------------------------------------------------------------------------------------

    def _on_entry_edited(self, name: str) -> None:
        text, before = self.rows[name].text, self.draft.entries.get(name, EntryText())
        if text.value and text.value != before.value:
            text = replace(text, date=text.date or today())
            if not text.uncertainty and name in DIMENSIONS:
                uncertainty = sheet_unit(name)[0] * table_one_entry(name).uncertainty
                text = replace(text, uncertainty=f"{uncertainty:.3g}")
        self.draft = self.draft.with_entry(name, text)
        self.edited.emit(self.draft, name)

    def _on_text_edited(self) -> None:
        draft = replace(self.draft, texts=_texts_of(self.text_edits), descriptions=_texts_of(self.description_edits))
        if draft != self.draft:
            self.draft = draft
            self.edited.emit(draft, "text")

    def _make_general(self) -> QWidget:
        editors = {TEXT_LABELS[name]: edit for name, edit in self.text_edits.items()}
        fields = make_labelled_grid(editors, (8, 4), stretch={1: 1})
        fields.addWidget(self.browse_button, list(self.text_edits).index("photograph"), 2)
        return make_panel(row((fields, 1), self.picture_label, spacing=10), margins=(12, 8, 12, 8), spacing=4)

    def _make_panel(self, group: str) -> QWidget:
        layout = grid(spacing=(8, 2), stretch={0: 5, 1: 3, 2: 3, 4: 4, 5: 2})
        self._grids[group] = layout
        heads = ["", *FIELD_LABELS.values()]
        heads.insert(3, "unit")
        for at, text in enumerate(heads):
            layout.addWidget(make_label(text, "note", wrap=False), 0, at)
        for name in (*GROUPS[group], *(name for name in OPTIONAL if group_of(name) == group)):
            self._add_row(name)
        return make_panel(
            row(make_label(TITLES[group], "running", wrap=False), (self.description_edits[group], 1), spacing=12),
            layout,
            margins=(12, 8, 12, 8),
            spacing=4,
        )

    def _add_row(self, name: str) -> EntryRow:
        line = EntryRow(name, self)
        line.edited.connect(self._on_entry_edited)
        layout = self._grids[group_of(name)]
        line.add_to(layout, layout.rowCount())
        line.show_finding(None, "")
        self.rows[name] = line
        return line

    def _fill_more_box(self) -> None:
        names = [name for name in SPECIMEN_PARAMETERS if name not in self.rows]
        if [self.more_box.itemData(at) for at in range(1, self.more_box.count())] == names:
            return
        described = ((f"{name}: {SPECIMEN_PARAMETERS[name].description}", name) for name in names)
        fill_combo(self.more_box, [("Another value …", None), *described])

    def _add_chosen(self) -> None:
        if name := self.more_box.currentData():
            line = self._add_row(name)
            self._fill_more_box()
            line.edits["value"].setFocus()
        self.more_box.setCurrentIndex(0)


def _texts_of(edits: Mapping[str, QLineEdit]) -> dict[str, str]:
    return {name: edit.text().strip() for name, edit in edits.items()}
