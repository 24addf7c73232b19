"""Tiles of the instruments in the order of the wires: source, amplifier, card and sensor."""

import math
from collections.abc import Callable, Sequence

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QFrame, QWidget

from app.config import (
    AmplifierTable,
    BenchConfig,
    CardTable,
    FoundDevice,
    GeneratorTable,
    SensorTable,
    SourceTable,
    SupplyTable,
)
from app.gui.bench_page.amplifier_plot import AmplifierPlot
from app.gui.bench_page.table_form import TableForm
from app.gui.widgets import STRETCH, Item, WindowTheme, column, configure, make_label, row
from app.live import LiveValues
from app.session import InstrumentStatus, Lamp

LAMP_MARKS = {Lamp.READY: "●", Lamp.WAITING: "○", Lamp.SUSPECT: "▲", Lamp.MISSING: "✕"}
NOT_CONNECTED = "Save and connect to see its identity and live values"


class Tile(QFrame):
    """One instrument: title and state, identity, what was found, its table, and its live value."""

    changed = Signal()

    def __init__(self, role: str, title: str, number: int) -> None:
        super().__init__()
        configure(self, f"bench.tile.{role}", kind="panel", accessibleName=title)
        self.role = role
        self.title_label = make_label(f"{number}  {title}", "caption", wrap=False)
        self.state_label = make_label(kind="note-size", wrap=False, name=f"bench.{role}.state")
        self.identity_label = make_label(kind="small", name=f"bench.{role}.identity")
        self.live_label = make_label(kind="value", name=f"bench.{role}.live")
        self.found_box = configure(
            QComboBox(),
            f"bench.{role}.found",
            accessibleName=f"{title}: instruments that were found",
            toolTip="What the scan found; a choice fills in address, driver and serial number",
            visible=False,
            sizeAdjustPolicy=QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon,
            minimumContentsLength=10,
        )
        self._found: tuple[FoundDevice, ...] = ()
        self.found_box.activated.connect(self._on_found_chosen)

    def build(self, *items: Item) -> None:
        """Lay the tile out."""
        column(
            row(self.title_label, STRETCH, self.state_label),
            self.live_label,
            self.identity_label,
            self.found_box,
            *items,
            STRETCH,
            parent=self,
            margins=(10, 8, 10, 8),
            spacing=4,
        )

    def use(self, device: FoundDevice) -> None:
        """Fill in a found instrument; a scan finds none for tiles that leave this as it is."""
        del device

    def set_status(self, status: InstrumentStatus | None, problem: str) -> None:
        """Show identity and state of the instrument of the open bench; None for a bench that is not open."""
        if status is None:
            self.state_label.setText("")
            self.identity_label.setText(NOT_CONNECTED)
            return
        self.state_label.setText(f"{LAMP_MARKS[status.lamp]} {status.lamp}")
        remedy = f"\n{problem}" if problem and status.lamp in (Lamp.SUSPECT, Lamp.MISSING) else ""
        self.identity_label.setText(f"{status.identity}{remedy}")

    def show_found(self, devices: Sequence[FoundDevice]) -> None:
        """List the instruments that a scan found for this tile; a single one is filled in."""
        self._found = tuple(devices)
        self.found_box.clear()
        self.found_box.addItem(f"found: {len(devices)}, choose one" if devices else "nothing was found")
        self.found_box.addItems([f"{device.identity or device.role} at {device.where}" for device in devices])
        self.found_box.show()
        if len(devices) == 1:
            self.found_box.setCurrentIndex(1)
            self.use(devices[0])

    def _on_found_chosen(self, index: int) -> None:
        if index > 0:
            self.use(self._found[index - 1])


class SourceTile(Tile):
    """The instrument at the amplifier's input: a generator, a DC supply or an output of the card."""

    def __init__(self) -> None:
        super().__init__("generator", "Generator", 1)
        self.source_form = TableForm("source", SourceTable, ("kind",))
        self.generator_form = TableForm("generator", GeneratorTable, ("resource", "driver", "serial"))
        self.supply_form = TableForm("supply", SupplyTable, ("resource", "serial", "channel"))
        self.build(self.source_form, self.generator_form, self.supply_form)
        for form in (self.source_form, self.generator_form, self.supply_form):
            form.changed.connect(self._on_changed)

    def set_config(self, config: BenchConfig) -> None:
        self.source_form.set_record(config.source)
        self.generator_form.set_record(config.generator)
        self.supply_form.set_record(config.supply)
        self._show_kind()

    def use(self, device: FoundDevice) -> None:
        kind, form = ("dc-supply", self.supply_form) if device.role == "supply" else ("generator", self.generator_form)
        self.source_form.set_record(self.source_form.record.model_copy(update={"kind": kind}))
        update = {"resource": device.where, "serial": device.serial}
        form.set_record(form.record.model_copy(update=update))
        self._on_changed()

    def _on_changed(self) -> None:
        self._show_kind()
        self.changed.emit()

    def _show_kind(self) -> None:
        kind = self.source_form.record.kind
        self.generator_form.setVisible(kind == "generator")
        self.supply_form.setVisible(kind == "dc-supply")


class AmplifierTile(Tile):
    """The amplifier and its characteristic."""

    def __init__(self, theme: WindowTheme) -> None:
        super().__init__("amplifier", "Amplifier", 2)
        self.form = TableForm(
            "amplifier",
            AmplifierTable,
            ("name", "serial", "rest_v", "low_v", "high_v", "slope_below", "slope_above"),
        )
        self.plot = AmplifierPlot(theme)
        self.build(self.form, self.plot)
        self.form.changed.connect(self._on_changed)

    def set_config(self, config: BenchConfig) -> None:
        self.form.set_record(config.amplifier)
        self.plot.show_map(config.amplifier.amplifier_map)

    def show_reading(self, reading: LiveValues | None) -> None:
        self.plot.show_input(None if reading is None else reading.drive_v)
        if reading is None:
            self.live_label.setText("")
            return
        volts = round(float(self.form.record.amplifier_map.specimen_v([reading.drive_v])[0]))
        self.live_label.setText(
            f"{volts:+d} V with high voltage".replace("-", "−") if volts else "0 V with high voltage"
        )

    def _on_changed(self) -> None:
        if not self.form.has_faults:
            self.plot.show_map(self.form.record.amplifier_map)
        self.changed.emit()


class CardTile(Tile):
    """The data acquisition card and its two inputs."""

    def __init__(self, server: Callable[[], str]) -> None:
        super().__init__("card", "Card", 3)
        self._server = server
        self.form = TableForm(
            "card",
            CardTable,
            ("device", "serial", "drive_channel", "displacement_channel", "range_v", "terminal", "server"),
        )
        self.build(self.form)
        self.form.changed.connect(self.changed)

    def set_config(self, config: BenchConfig) -> None:
        self.form.set_record(config.card)

    def use(self, device: FoundDevice) -> None:
        update = {"device": device.where, "serial": device.serial, "server": self._server()}
        self.form.set_record(self.form.record.model_copy(update=update))
        self.changed.emit()

    def show_reading(self, reading: LiveValues | None) -> None:
        if reading is None:
            self.live_label.setText("")
            return
        card = self.form.record
        drive_v, sensor_v = round(reading.drive_v, 3) + 0.0, round(reading.sensor_v, 4) + 0.0  # no negative zero
        text = f"{card.drive_channel} {drive_v:.3f} V\n{card.displacement_channel} {sensor_v:.4f} V"
        self.live_label.setText(text.replace("-", "−"))


class SensorTile(Tile):
    """The displacement sensor and its calibration."""

    def __init__(self, *items: QWidget) -> None:
        super().__init__("sensor", "Sensor", 4)
        self.form = TableForm(
            "sensor",
            SensorTable,
            (
                "preset",
                "name",
                "serial",
                "gain_m_per_v",
                "gain_relative_uncertainty",
                "zero_v",
                "valid_low_v",
                "valid_high_v",
                "calibrated",
                "expires",
            ),
            ("calibration_points",),
        )
        self.build(self.form, *items)
        self.form.changed.connect(self.changed)

    def set_config(self, config: BenchConfig) -> None:
        self.form.set_record(config.sensor)

    def show_reading(self, reading: LiveValues | None) -> None:
        if reading is None:
            text = ""
        elif math.isnan(reading.displacement_um):
            text = "out of range"
        else:
            text = f"{round(reading.displacement_um, 2) + 0.0:+.2f} µm".replace("-", "−")
        self.live_label.setText(text)
