"""Editor of a bench file: its name, scan for instruments, tiles of the instruments and the other tables."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from app.config import BenchDraft, ConfigError, FoundDevice, find_devices
from app.gui.bench_page.further_tables import FurtherTables
from app.gui.bench_page.simulation_panel import SimulationPanel
from app.gui.bench_page.table_form import TableForm
from app.gui.bench_page.tiles import AmplifierTile, CardTile, SensorTile, SourceTile, Tile, TileGrid
from app.gui.status import SimulationControls
from app.gui.widgets import (
    BackgroundWorker,
    Segments,
    StatusLine,
    column,
    configure,
    make_button,
    make_label,
    make_line_edit,
    row,
)

NEW_BENCH = "Choose the kind of the new bench, type its name, and save it."


class BenchEditor(QWidget):
    """Shows a draft and changes it with every edit.

    Args:
        worker: scans.
        controls: of the simulated bench that the window has opened; None for a real one.
        wiring: shown below the tiles.
        sensor_items: shown below the sensor's table.
    """

    changed = Signal()
    """A value was edited, or a fault in one was made or mended."""

    def __init__(
        self, worker: BackgroundWorker, controls: SimulationControls | None, wiring: QWidget, *sensor_items: QWidget
    ) -> None:
        super().__init__()
        self._worker = worker
        self.draft: BenchDraft | None = None
        self.name_edit = make_line_edit("bench.name", "name of the bench")
        self.kind_segments = Segments("bench.kind", "kind of the new bench", (("Real", False), ("Simulated", True)))
        self.hosts_edit = make_line_edit(
            "bench.hosts",
            "LAN addresses of instruments",
            placeholderText="LAN: 192.0.2.7, 192.0.2.8:5025",
            toolTip="Instruments on a LAN socket cannot be discovered, only queried: their addresses, host or host:port",
        )
        self.server_edit = make_line_edit(
            "bench.server",
            "NI gRPC device server",
            placeholderText="NI server: host:port",
            toolTip="NI's gRPC device server, for the card of another computer; empty for a card in this one",
        )
        self.scan_button = make_button("Scan", self.scan, tip="Look for instruments; nothing is set", name="bench.scan")
        self.message_label = configure(StatusLine(), "bench.message")
        self.source, self.amplifier = SourceTile(), AmplifierTile()
        self.sensor = SensorTile(*sensor_items)
        self.card = CardTile(lambda: self.server_edit.text().strip())
        self.tiles: tuple[Tile, ...] = (self.source, self.amplifier, self.sensor, self.card)
        self.further, self.simulation = FurtherTables(), SimulationPanel(controls)
        column(
            row(
                make_label("Name", wrap=False), (self.name_edit, 2), self.kind_segments, 12, self.scan_button,
                (self.hosts_edit, 2), (self.server_edit, 1),
            ),
            self.message_label,
            TileGrid(self.tiles),
            wiring,
            self.further,
            self.simulation,
            parent=self,
            spacing=6,
        )  # fmt: skip
        self.name_edit.textEdited.connect(lambda _: self._on_edited())
        for part in (*self.tiles, self.further, self.simulation):
            part.changed.connect(self._on_edited)

    @property
    def has_faults(self) -> bool:
        """Whether a value is at fault, which is written below its field."""
        return any(
            form.has_faults for form in (*self._forms.values(), *self.further.forms, *self.simulation.forms.values())
        )

    @property
    def _forms(self) -> dict[str, TableForm]:
        """Forms of the tiles, by the names of their tables."""
        return {name: form for tile in self.tiles for name, form in tile.forms.items()}

    def show_draft(self, draft: BenchDraft, is_open: bool) -> None:
        """Show a bench; `is_open`: the window has opened it."""
        self.draft = draft
        self.kind_segments.setVisible(not draft.name)
        self.kind_segments.select(draft.config.simulated)
        self.name_edit.setText(draft.config.name)
        self.server_edit.setText(draft.config.card.server)
        for tile in self.tiles:
            tile.instrument_box.hide()
            tile.set_config(draft.config)
        self.further.set_config(draft.config)
        self.simulation.set_config(draft.config, is_open)
        self.message_label.show_message("" if draft.name else NEW_BENCH, persistent=True)

    def scan(self) -> None:
        """Look for instruments in the background."""
        hosts = [part for part in self.hosts_edit.text().replace(",", " ").split() if part]
        server = self.server_edit.text().strip()
        self.scan_button.setEnabled(False)
        self.message_label.show_message("Scanning: USB, LAN, serial ports and cards …", persistent=True)
        self._worker.submit(
            lambda: find_devices(hosts, server), lambda scan: self._show_scan(*scan), self._on_scan_error
        )

    def use_calibration(self, values: dict[str, Any]) -> None:
        """Put the values of a calibration into the sensor's tile; a preset must not look like their source."""
        self.sensor.form.update_record(**values)
        self._on_edited()

    def _show_scan(self, devices: list[FoundDevice], notes: list[str]) -> None:
        self.scan_button.setEnabled(True)
        self.source.show_instruments([device for device in devices if device.role in ("generator", "supply")])
        self.card.show_instruments([device for device in devices if device.role == "card"])
        instruments = [device for device in devices if device.role in ("generator", "supply", "card")]
        have = ", ".join(f"{device.role} {device.identity}" for device in instruments) or "nothing was found"
        text = "\n".join((f"Scan: {have}.", *notes))
        self.message_label.show_message(text, is_error=not instruments, persistent=True)

    def _on_scan_error(self, error: Exception) -> None:
        self.scan_button.setEnabled(True)
        self.message_label.show_message(str(error), is_error=True)

    def _on_edited(self) -> None:
        if self.draft is None:
            return
        tables: dict[str, Any] = {
            "name": self.name_edit.text().strip() or "bench",
            **{name: form.record for name, form in self._forms.items()},
            "simulation": self.simulation.table,
            **self.further.tables,
        }
        problem = ""
        try:
            self.draft = self.draft.with_tables(**tables)
        except ConfigError as error:
            problem = str(error)
        self.message_label.show_message(problem, is_error=True)
        self.changed.emit()
