"""Pane of the Campaign page to add a measurement: one run of a protocol, or a series over the values of one parameter."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import ValidationError
from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QLabel

import app.campaign as campaigns  # imports HDF5 when a name is first used: a background thread has done that
from app.common import UnitError
from app.gui.widgets import (
    UPRIGHT,
    LowPane,
    ProtocolForm,
    StatusLine,
    column,
    configure,
    fill_combo,
    grid,
    make_button,
    make_combo,
    make_label,
    make_line_edit,
    make_panel,
    make_scroll_area,
    row,
)
from app.services import field_error, format_parameter
from protocols import DEFAULT_PROTOCOL, PROTOCOLS
from protocols.base import Protocol

INTRODUCTION = (
    "One run of a protocol, or a series: the protocol is repeated for each value of one parameter, as a single item of the "
    "campaign, and its results are a curve over that parameter."
)
ONE_RUN = "nothing: one run"
MIN_FORM_HEIGHT = 90
MAX_LISTED = 12
"""Values of a series that are listed."""


class AddItemPane(LowPane):
    """Fields of a new item of the campaign."""

    add_requested = Signal(object)
    """A `CampaignItem`."""
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._names: tuple[str, ...] = ()
        self.form: ProtocolForm | None = None
        protocols = [(PROTOCOLS.title(name), name) for name in PROTOCOLS]
        self.protocol_box = make_combo("add.protocol", "protocol", protocols)
        self.setFocusProxy(self.protocol_box)
        self.varied_box = make_combo("add.varied", "repeat over")
        self.values_edit = make_line_edit("add.values", "values", placeholderText="100…200 step 5, or 1, 2, 3")
        self.unit_label, self.values_label = make_label(wrap=False), make_label(kind="note", name="add.values-read")
        self.name_edit = make_line_edit("add.name", "name")
        self.after_box = make_combo(
            "add.after", "after", toolTip="A measurement that must be done before; its accepted results are used"
        )
        self.message_label = configure(StatusLine(), "add.message")
        self.add_button = make_button("Add", self._request, "go", name="add.add", key="Enter")
        cancel = make_button("Cancel", self.closed.emit, name="add.cancel", key="Esc")
        self._form_place = column()
        form_area = make_scroll_area(self._form_place, None, minimumHeight=MIN_FORM_HEIGHT, **UPRIGHT)
        fields = grid(spacing=(8, 6), stretch={1: 1})
        editors = (self.protocol_box, self.varied_box, self.values_edit, self.name_edit, self.after_box)
        for at, editor in enumerate(editors):
            label = QLabel(editor.accessibleName())
            label.setBuddy(editor)
            line = at + (at > editors.index(self.values_edit))
            fields.addWidget(label, line, 0)
            fields.addWidget(editor, line, 1)
        fields.addWidget(self.unit_label, editors.index(self.values_edit), 2)
        fields.addWidget(self.values_label, editors.index(self.values_edit) + 1, 1, 1, 2)
        panel = make_panel(
            make_label("Add a measurement", "heading", wrap=False),
            make_label(INTRODUCTION),
            fields,
            make_label("Its parameters", "caption", wrap=False),
            (form_area, 1),
            self.message_label,
            row(self.add_button, cancel, None, spacing=10),
            margins=(28, 16, 28, 16),
            spacing=8,
        )
        panel.setMaximumWidth(760)
        layout = row((panel, 8), parent=self, margins=(0, 8, 0, 8))
        layout.insertStretch(0, 1)
        layout.addStretch(1)
        self.protocol_box.currentIndexChanged.connect(self._show_protocol)
        self.varied_box.currentIndexChanged.connect(self._on_varied)
        self.values_edit.textChanged.connect(self._validate)
        self.name_edit.textChanged.connect(self._validate)
        for edit in (self.values_edit, self.name_edit):
            edit.returnPressed.connect(self._request)
        self.protocol_box.setCurrentIndex(self.protocol_box.findData(DEFAULT_PROTOCOL))

    def begin(self, names: Sequence[str]) -> None:
        """Begin a new item; `names`: the items of the campaign."""
        self._names = tuple(names)
        fill_combo(self.after_box, [("nothing", ()), *((name, (name,)) for name in names)])
        self.after_box.setCurrentIndex(0)
        self.values_edit.clear()
        self.name_edit.setModified(False)
        self.show_message("")
        self._validate()

    def show_message(self, text: str) -> None:
        """Show why the item was not added."""
        self.message_label.show_message(text, is_error=True)

    @property
    def item(self) -> campaigns.CampaignItem | None:
        """The item of the fields; None while one has an error."""
        protocol = None if self.form is None else self.form.result.value
        name, values = self.name_edit.text().strip(), self._read_values()
        if protocol is None or not name or name in self._names or isinstance(values, str):
            return None
        varied = self._varied
        changed = {
            each
            for each, field in type(protocol).model_fields.items()
            if getattr(protocol, each) != field.get_default()
        }
        settings = protocol.model_dump(mode="json", include=changed - {varied})
        return campaigns.CampaignItem(
            name, protocol.name, settings, self.after_box.currentData(), varied=varied, values=values
        )

    @property
    def _kind(self) -> type[Protocol]:
        return PROTOCOLS[self.protocol_box.currentData()]

    @property
    def _varied(self) -> str:
        return self.varied_box.currentData() or ""

    def _show_protocol(self) -> None:
        if self.form is not None:
            self.form.setParent(None)
            self.form.deleteLater()
        self.form = form = ProtocolForm(self._kind.model_validate({}))
        self._form_place.addWidget(form)
        form.changed.connect(self._validate)
        can_vary = campaigns.series_parameters(self._kind)
        offered = [(row.field.label, name) for name, row in form.rows.items() if name in can_vary]
        fill_combo(self.varied_box, [(ONE_RUN, ""), *offered])
        self.varied_box.setCurrentIndex(0)
        self._on_varied()

    def _on_varied(self) -> None:
        assert self.form is not None
        for name, shown in self.form.rows.items():
            shown.editor.setEnabled(name != self._varied)
        self.unit_label.setText(self.form.rows[self._varied].field.unit if self._varied else "")
        self.values_edit.setEnabled(bool(self._varied))
        self._validate()

    def _read_values(self) -> tuple[float, ...] | str:
        """Return the values of the series, no values for a single run, or the error as text."""
        assert self.form is not None
        if not self._varied:
            return ()
        field, protocol = self.form.rows[self._varied].field, self.form.result.value
        try:
            shown = (field.factor, field.unit)
            values = campaigns.read_series_values(self._kind, self._varied, self.values_edit.text(), shown)
        except UnitError as error:
            return str(error)
        given = {} if protocol is None else protocol.model_dump()
        for value in values:
            try:
                self._kind(**{**given, self._varied: value})
            except ValidationError as error:
                return field_error(self._kind, error.errors()[0], {self._varied: field})[1]
        return values

    def _validate(self) -> None:
        if not self.name_edit.isModified():
            self._suggest_name()
        values, name = self._read_values(), self.name_edit.text().strip()
        if isinstance(values, str):
            text = f"✕ {values}" if self.values_edit.text().strip() else ""
        else:
            text = self._describe(values)
        self.values_label.setText(text)
        self.show_message(f"There is an item '{name}' already; choose another name." if name in self._names else "")
        self.add_button.setEnabled(self.item is not None)

    def _describe(self, values: tuple[float, ...]) -> str:
        if not values or self.form is None:
            return ""
        field = self.form.rows[self._varied].field
        shown = [format_parameter(field.factor * value) for value in values]
        listed = shown if len(shown) <= MAX_LISTED else [*shown[:3], "…", shown[-1]]
        return f"{len(values)} runs: {', '.join(listed)} {field.unit}".rstrip()

    def _suggest_name(self) -> None:
        base = f"{self._kind.name}-series" if self._varied else self._kind.name
        numbered = (base, *(f"{base}-{number}" for number in range(2, len(self._names) + 3)))
        with QSignalBlocker(self.name_edit):
            self.name_edit.setText(next(name for name in numbered if name not in self._names))

    def _request(self) -> None:
        if (item := self.item) is not None:
            self.add_requested.emit(item)
