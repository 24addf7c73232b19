"""Row of a specimen sheet: value, uncertainty, instrument and day of one dimension or mass."""

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QGridLayout, QLineEdit

from app.gui.widgets import FieldRow, configure, make_label, set_style_kind
from app.identification import ENTRY_FIELDS, TABLE_ONE, EntryText, sheet_unit, table_one_entry
from app.services import FormField
from model.identification import parameter_spec

FIELD_LABELS = {"value": "value", "uncertainty": "standard uncertainty", "instrument": "instrument", "date": "day"}
LEAST_WIDTHS = {"value": 88, "uncertainty": 88, "instrument": 96, "date": 88}
COLUMNS = len(ENTRY_FIELDS) + 2
"""Of the grid: name, the fields, and after the uncertainty the unit."""


class EntryRow(QObject):
    """Widgets of one value, and below them what is wrong or to be questioned; Table I is shown where nothing is typed."""

    edited = Signal(str)
    """A field was left with another text: name of the parameter."""

    def __init__(self, name: str, parent: QObject) -> None:
        super().__init__(parent)
        self.name = name
        spec, (_, unit) = parameter_spec(name), sheet_unit(name)
        self.meaning = f"{spec.description[:1].upper()}{spec.description[1:]}"
        self.label = make_label(f"{name}  {spec.description}", name=f"sheet.{name}")
        self.unit_label = make_label(unit, wrap=False)
        self.note_label = make_label(name=f"sheet.{name}.note")
        placeholders = dict.fromkeys(ENTRY_FIELDS, "")
        if name in TABLE_ONE and TABLE_ONE[name].uncertainty is not None:
            entry, (factor, _) = table_one_entry(name), sheet_unit(name)
            placeholders = {
                "value": f"{factor * entry.value:.6g}",
                "uncertainty": f"{factor * entry.uncertainty:.3g}",
                "instrument": f"Table I: {TABLE_ONE[name].instrument or 'literature'}",
                "date": "",
            }
        self.edits: dict[str, QLineEdit] = {}
        for field in ENTRY_FIELDS:
            shown = unit if field in ("value", "uncertainty") else ""
            row = FieldRow(FormField(name, f"{name} {FIELD_LABELS[field]}", shown, self._help(field, unit), ""), "")
            assert isinstance(row.editor, QLineEdit)
            self.edits[field] = configure(
                row.editor,
                f"sheet.{name}.{field}",
                placeholderText=placeholders[field],
                toolTip=self._help(field, unit),
            )
            row.editor.setMinimumWidth(LEAST_WIDTHS[field])
            row.editor.editingFinished.connect(self._on_edited)
        self._text = EntryText()

    @property
    def text(self) -> EntryText:
        """The texts as they are typed."""
        return EntryText(**{field: edit.text().strip() for field, edit in self.edits.items()})

    def show_text(self, text: EntryText) -> None:
        """Show the texts of a draft."""
        self._text = text
        for field, edit in self.edits.items():
            if edit.text().strip() != getattr(text, field):
                edit.setText(getattr(text, field))
                edit.setCursorPosition(0)

    def show_finding(self, fault: tuple[str, str] | None, question: str) -> None:
        """Show what is wrong, else what is to be questioned."""
        at_fault, message = fault or ("", "")
        self.note_label.setText(f"✕ {message}" if message else question)
        self.note_label.setVisible(bool(message or question))
        set_style_kind(self.note_label, "fault" if message else "caution")
        for field, edit in self.edits.items():
            set_style_kind(edit, "faulty" if field == at_fault else "")
            edit.setAccessibleDescription(message if field == at_fault else self.meaning)

    def add_to(self, layout: QGridLayout, at: int) -> None:
        """Put the widgets into two rows of a grid."""
        layout.addWidget(self.label, at, 0)
        widgets = [*self.edits.values()]
        widgets.insert(2, self.unit_label)  # type: ignore[arg-type]
        for column, widget in enumerate(widgets, 1):
            layout.addWidget(widget, at, column)
        layout.addWidget(self.note_label, at + 1, 0, 1, COLUMNS)

    def set_visible(self, shown: bool) -> None:
        """Show or hide the row."""
        for widget in (self.label, self.unit_label, *self.edits.values()):
            widget.setVisible(shown)
        self.note_label.setVisible(shown and bool(self.note_label.text()))

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
                return "What it was measured with, for example caliper 150 mm"
        return "Day of the measurement, for example 2026-11-20; today if it is left empty"

    def _on_edited(self) -> None:
        if self.text != self._text:
            self.edited.emit(self.name)
