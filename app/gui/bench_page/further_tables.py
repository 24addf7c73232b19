"""Further tables of a bench file: specimen, abort levels, watchdog, climate sensor, backup, channels and serial meters."""

from typing import Any, TypeVar

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from app.config import BenchConfig, ChannelTable, ConfigTable, MeterTable
from app.gui.bench_page.table_form import TableForm
from app.gui.widgets import (
    Item,
    clear_layout,
    column,
    make_button,
    make_label,
    make_line_edit,
    make_panel,
    make_toggle,
    row,
)

SINGLE_TABLES = {
    "specimen": "Specimen as it is mounted",
    "levels": "Abort levels",
    "watchdog": "Watchdog",
    "environment": "Sensor of temperature and humidity",
    "backup": "Copies of run files",
}
"""Titles of the tables that a bench file has once."""

E = TypeVar("E")

NEW_METER = {"driver": "keyence-lkg", "port": "COM3"}


class FurtherTables(QWidget):
    """The tables that few benches change, behind a button."""

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.single = {name: TableForm.of_bench(name) for name in SINGLE_TABLES}
        self.channels: list[TableForm] = []
        self.meters: list[tuple[QLineEdit, TableForm]] = []
        self._content, self._list = QWidget(), QWidget()
        self._rows = column(parent=self._list, spacing=6)
        column(
            *(
                make_panel(make_label(title, "caption", wrap=False), self.single[name], spacing=4)
                for name, title in SINGLE_TABLES.items()
            ),
            self._list,
            row(
                make_button("Add an input of the card", self._add_channel, name="bench.channels.add"),
                make_button("Add a serial meter", self._add_meter, name="bench.meters.add"),
                None,
            ),
            parent=self._content,
            spacing=6,
        )
        title = "Specimen, abort levels, watchdog, climate, backup, inputs and meters"
        self.open_button = make_toggle(title, "Show the other tables", "bench.further", self._content)
        column(self.open_button, self._content, parent=self, spacing=6)
        for form in self.single.values():
            form.changed.connect(self.changed)

    @property
    def forms(self) -> list[TableForm]:
        """All forms."""
        return [*self.single.values(), *self.channels, *(form for _, form in self.meters)]

    @property
    def tables(self) -> dict[str, Any]:
        """The tables as they are typed."""
        return {
            **{name: form.record for name, form in self.single.items()},
            "channels": [form.record.model_dump() for form in self.channels],
            "meters": {edit.text().strip(): form.record.model_dump() for edit, form in self.meters},
        }

    def set_config(self, config: BenchConfig) -> None:
        """Show the tables of a bench."""
        for name, form in self.single.items():
            form.set_record(getattr(config, name))
        if self.tables["channels"] == [table.model_dump() for table in config.channels] and self.tables["meters"] == {
            name: table.model_dump() for name, table in config.meters.items()
        }:
            return
        clear_layout(self._rows)
        self.channels, self.meters = [], []
        for channel in config.channels:
            self._show_channel(channel)
        for name, meter in config.meters.items():
            self._show_meter(name, meter)

    def _add_channel(self) -> None:
        used = {form.record.name for form in self.channels}
        number = next(n for n in range(1, 1000) if f"input{n}" not in used)
        self._show_channel(ChannelTable.model_validate({"name": f"input{number}", "channel": f"ai{number + 1}"}))
        self.changed.emit()

    def _add_meter(self) -> None:
        used = {edit.text() for edit, _ in self.meters}
        self._show_meter(next(f"meter{n}" for n in range(1, 1000) if f"meter{n}" not in used), MeterTable(**NEW_METER))
        self.changed.emit()

    def _show_channel(self, table: ChannelTable) -> None:
        form = TableForm(f"channel{len(self.channels) + 1}", ChannelTable)
        self._show_entry(self.channels, form, form, table, make_label("Input of the card", "caption"))

    def _show_meter(self, name: str, table: MeterTable) -> None:
        number = len(self.meters) + 1
        form = TableForm(f"meter{number}", MeterTable)
        edit = make_line_edit(f"bench.meter{number}.key", "name of the meter", text=name)
        edit.textEdited.connect(lambda _: self.changed.emit())
        self._show_entry(
            self.meters, (edit, form), form, table, make_label("Serial meter", "caption", wrap=False), (edit, 1)
        )

    def _show_entry(self, entries: list[E], entry: E, form: TableForm, table: ConfigTable, *head: Item) -> None:
        """Show one of several tables of a kind, with a button that removes it."""
        form.set_record(table)
        form.changed.connect(self.changed)
        entries.append(entry)

        def remove() -> None:
            entries.remove(entry)
            panel.deleteLater()
            self.changed.emit()

        panel = make_panel(row(*head, make_button("Remove", remove, "choice")), form, spacing=4)
        self._rows.addWidget(panel)
