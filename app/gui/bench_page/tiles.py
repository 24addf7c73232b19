"""Tiles of the instruments in the order of the wires: source, amplifier, card and sensor."""

import math
from collections.abc import Callable, Mapping, Sequence

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
    """One instrument: title and state, live value, identity, the instruments that a scan found, and its tables.

    Args:
        role: of the instrument.
        title: of the tile.
        number: in the order of the wires.
        forms: of the tables of the bench file, by their names.
        items: shown below them.
    """

    changed = Signal()

    def __init__(self, role: str, title: str, number: int, forms: Mapping[str, TableForm], *items: Item) -> None:
        super().__init__()
        configure(self, f"bench.tile.{role}", kind="panel", accessibleName=title)
        self.role, self.forms = role, forms
        self.title_label = make_label(f"{number}  {title}", "caption", wrap=False)
        self.state_label = make_label(kind="note-size", wrap=False, name=f"bench.{role}.state")
        self.identity_label = make_label(kind="small", name=f"bench.{role}.identity")
        self.live_label = make_label(kind="value", name=f"bench.{role}.live")
        self.found_box = configure(
            QComboBox(),
            f"bench.{role}.found",
            accessibleName=f"{title}: instruments that were found",
            toolTip="Instruments of the scan; a choice fills in address, driver and serial number",
            visible=False,
            sizeAdjustPolicy=QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon,
            minimumContentsLength=10,
        )
        self._found: tuple[FoundDevice, ...] = ()
        self.found_box.activated.connect(self._on_found_chosen)

        column(
            row(self.title_label, STRETCH, self.state_label),
            self.live_label,
            self.identity_label,
            self.found_box,
            *forms.values(),
            *items,
            STRETCH,
            parent=self,
            margins=(10, 8, 10, 8),
            spacing=4,
        )
        for form in forms.values():
            form.changed.connect(self._on_changed)

    def set_config(self, config: BenchConfig) -> None:
        """Show the tables of a bench."""
        for name, form in self.forms.items():
            form.set_record(getattr(config, name))
        self._show_tables()

    def show_reading(self, reading: LiveValues | None) -> None:
        """Show the live value; None: there is none."""
        self.live_label.setText("" if reading is None else self._live_text(reading).replace("-", "−"))

    def use(self, device: FoundDevice) -> None:
        """Fill in an instrument of the scan; no scan covers the tiles that do not override this."""
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

    def _live_text(self, reading: LiveValues) -> str:
        """Return the live value of this instrument."""
        del reading
        return ""

    def _show_tables(self) -> None:
        """Show parts of the tile that depend on its tables."""

    def _on_changed(self) -> None:
        self._show_tables()
        self.changed.emit()

    def _on_found_chosen(self, index: int) -> None:
        if index > 0:
            self.use(self._found[index - 1])


class SourceTile(Tile):
    """The instrument at the amplifier's input: a generator, a DC supply or an output of the card."""

    def __init__(self) -> None:
        self.source_form = TableForm("source", SourceTable, ("kind",))
        self.generator_form = TableForm("generator", GeneratorTable, ("resource", "driver", "serial"))
        self.supply_form = TableForm("supply", SupplyTable, ("resource", "serial", "channel"))
        forms = {"source": self.source_form, "generator": self.generator_form, "supply": self.supply_form}
        super().__init__("generator", "Generator", 1, forms)

    def use(self, device: FoundDevice) -> None:
        kind, form = ("dc-supply", self.supply_form) if device.role == "supply" else ("generator", self.generator_form)
        self.source_form.set_record(self.source_form.record.model_copy(update={"kind": kind}))
        update = {"resource": device.where, "serial": device.serial}
        form.set_record(form.record.model_copy(update=update))
        self._on_changed()

    def _show_tables(self) -> None:
        kind = self.source_form.record.kind
        self.generator_form.setVisible(kind == "generator")
        self.supply_form.setVisible(kind == "dc-supply")


class AmplifierTile(Tile):
    """The amplifier and its characteristic."""

    def __init__(self, theme: WindowTheme) -> None:
        self.form = TableForm(
            "amplifier",
            AmplifierTable,
            ("name", "serial", "rest_v", "low_v", "high_v", "slope_below", "slope_above"),
        )
        self.plot = AmplifierPlot(theme)
        super().__init__("amplifier", "Amplifier", 2, {"amplifier": self.form}, self.plot)

    def show_reading(self, reading: LiveValues | None) -> None:
        super().show_reading(reading)
        self.plot.show_input(None if reading is None else reading.drive_v)

    def _live_text(self, reading: LiveValues) -> str:
        volts = round(float(self.form.record.amplifier_map.specimen_v([reading.drive_v])[0]))
        return f"{volts:+d} V with high voltage" if volts else "0 V with high voltage"

    def _show_tables(self) -> None:
        if not self.form.has_faults:
            self.plot.show_map(self.form.record.amplifier_map)


class CardTile(Tile):
    """The data acquisition card and its two inputs."""

    def __init__(self, server: Callable[[], str]) -> None:
        self._server = server
        self.form = TableForm(
            "card",
            CardTable,
            ("device", "serial", "drive_channel", "displacement_channel", "range_v", "terminal", "server"),
        )
        super().__init__("card", "Card", 3, {"card": self.form})

    def use(self, device: FoundDevice) -> None:
        update = {"device": device.where, "serial": device.serial, "server": self._server()}
        self.form.set_record(self.form.record.model_copy(update=update))
        self.changed.emit()

    def _live_text(self, reading: LiveValues) -> str:
        card = self.form.record
        drive_v, sensor_v = round(reading.drive_v, 3) + 0.0, round(reading.sensor_v, 4) + 0.0  # no negative zero
        return f"{card.drive_channel} {drive_v:.3f} V\n{card.displacement_channel} {sensor_v:.4f} V"


class SensorTile(Tile):
    """The displacement sensor and its calibration."""

    def __init__(self, *items: QWidget) -> None:
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
        super().__init__("sensor", "Sensor", 4, {"sensor": self.form}, *items)

    def _live_text(self, reading: LiveValues) -> str:
        if math.isnan(reading.displacement_um):
            return "out of range"
        return f"{round(reading.displacement_um, 2) + 0.0:+.2f} µm"
