"""Tiles of the instruments in the order of the wires: source, amplifier, card and sensor."""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, QSize, Signal
from PySide6.QtGui import QColor, QPaintEvent, QPen, QResizeEvent
from PySide6.QtWidgets import QComboBox, QFrame, QGridLayout, QWidget

from app.common import typeset
from app.config import BenchConfig, FoundDevice
from app.gui.bench_page.amplifier_plot import AmplifierPlot
from app.gui.bench_page.table_form import TableForm
from app.gui.face import CENTRE, draw_text, painting, px, set_length, tokens
from app.gui.status import LAMP_SIGNS
from app.gui.widgets import (
    IconView,
    Item,
    column,
    configure,
    make_button,
    make_combo,
    make_label,
    make_progress_bar,
    row,
    show_text,
)
from app.live import LiveValues
from app.session import InstrumentStatus, Lamp, format_measured_volts

SOURCE_KINDS = {"generator": "generator", "supply": "dc-supply"}
"""Kind of source of each role that a scan finds, which is also the name of its table."""
REMEDIES = {
    "generator": "Correct its address",
    "amplifier": "Check the wiring",
    "sensor": "Align the laser",
    "card": "Correct its device",
}
"""Text of the button of the remedy, by role. A wiring check is also the remedy for an instrument that answers with wrong values."""

WIRES, WIRE_PX = ("drive", "HV", "signal"), 44
"""Names of the wires between the tiles of a row, and their length."""

TRACE_LENGTH, LEAST_SPAN = 100, 0.01
"""Values of the trace of a tile; and its least height in their unit, so that noise of no account looks like none."""

RANGE_STEPS = 1000


class TraceLine(QWidget):
    """The last live values as a line without axes, between their lowest and highest; none while there are none."""

    def __init__(self) -> None:
        super().__init__()
        self._values: deque[float] = deque(maxlen=TRACE_LENGTH)
        set_length(self, height=28)

    def add(self, value: float) -> None:
        """Add a value; one that is not a number ends the line."""
        if math.isfinite(value):
            self._values.append(value)
        else:
            self._values.clear()
        self.update()

    def paintEvent(self, _event: QPaintEvent) -> None:
        if not self._values:
            return
        low, high, height = min(self._values), max(self._values), self.height() - 4
        middle, scale = (low + high) / 2, height / max(high - low, LEAST_SPAN)
        x = np.linspace(0, self.width(), TRACE_LENGTH)[-len(self._values) :]
        y = 2 + height / 2 - (np.array(self._values) - middle) * scale
        with painting(self) as painter:
            painter.setPen(QPen(QColor(tokens().text), 1.25))
            painter.drawPath(pg.arrayToQPath(x, y))


class Tile(QFrame):
    """One instrument: title and state, live value, identity, the discovered instruments, and its tables.

    Args:
        role: of the instrument.
        title: of the tile.
        number: in the order of the wires.
        tables: names of the tables of the bench file, each with its permanently visible fields.
        items: shown below them.
        picture: shown below the live value, above its trace.
    """

    changed = Signal()
    remedy_requested = Signal(str)
    """The operator asks for the remedy of a problem: a key of `REMEDIES`."""

    def __init__(
        self, role: str, title: str, number: int, tables: Mapping[str, Sequence[str]], *items: Item,
        picture: QWidget | None = None,
    ) -> None:  # fmt: skip
        super().__init__()
        configure(self, f"bench.tile.{role}", kind="panel", accessibleName=title)
        self.role = role
        self.forms = {name: TableForm.of_bench(name, main) for name, main in tables.items()}
        self.form, *_ = self.forms.values()
        self.title_label = make_label(f"{number}  {title}", "heading", wrap=False)
        self.state_icon = IconView(14)
        self.state_label = make_label(kind="note-size", wrap=False, name=f"bench.{role}.state")
        self.identity_label = make_label(kind="small", name=f"bench.{role}.identity")
        self.problem_label = make_label(kind="caution", name=f"bench.{role}.problem", visible=False)
        self._mended_by = role
        self.remedy_button = make_button("", self._ask_remedy, "link", name=f"bench.{role}.remedy", visible=False)
        self.live_label = make_label(kind="present", wrap=False, name=f"bench.{role}.live")
        self.live_note = make_label(kind="note", wrap=False, name=f"bench.{role}.live-note")
        self.trace = TraceLine()
        for part, height in ((self.live_label, 34), (self.live_note, 16)):
            set_length(part, height=height)  # without a value as well, so that nothing moves when a run begins
        self.instrument_box = make_combo(
            f"bench.{role}.found",
            f"{title}: instruments that were found",
            toolTip="Instruments of the scan; a choice fills in address, driver and serial number",
            visible=False,
            sizeAdjustPolicy=QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon,
            minimumContentsLength=10,
        )
        self._instruments: tuple[FoundDevice, ...] = ()
        self.instrument_box.activated.connect(self._on_instrument_chosen)

        column(
            row(self.title_label, None, self.state_icon, self.state_label, spacing=6),
            self.identity_label,
            self.live_label,
            self.live_note,
            *(() if picture is None else (picture,)),
            self.trace,
            self.problem_label,
            row(self.remedy_button, None),
            self.instrument_box,
            *self.forms.values(),
            *items,
            None,
            parent=self,
            margins=(10, 8, 10, 8),
            spacing=4,
        )
        for form in self.forms.values():
            form.changed.connect(self._on_changed)

    def set_config(self, config: BenchConfig) -> None:
        """Show the tables of a bench."""
        for name, form in self.forms.items():
            form.set_record(getattr(config, name))
        self._show_tables()

    def show_reading(self, reading: LiveValues | None) -> None:
        """Show the live value; None: there is none."""
        figure, note, value = ("", "", math.nan) if reading is None else self._live_value(reading)
        self.live_label.setText(typeset(figure))
        self.live_note.setText(typeset(note))
        self.trace.add(value)

    def use(self, device: FoundDevice) -> None:
        """Fill in an instrument of the scan; no scan covers the tiles that do not override this."""
        del device

    def set_status(self, status: InstrumentStatus | None, problem: str, connect: str) -> None:
        """Show identity and state of the instrument of the open bench; None for a bench that is not open.

        `connect` is the text of the button that opens it.
        """
        wrong = status is not None and status.lamp in (Lamp.SUSPECT, Lamp.MISSING)
        self.remedy_button.setVisible(wrong)
        if status is None:
            self.problem_label.hide()
            self.state_icon.show_icon("", "")
            self.state_label.setText("")
            self.identity_label.setText(f"{connect} to see its identity and live values")
            return
        self.state_icon.show_icon(*LAMP_SIGNS[status.lamp])
        self.state_label.setText(status.remark if status.lamp is Lamp.WAITING and status.remark else str(status.lamp))
        self.identity_label.setText(str(status.identity))
        show_text(self.problem_label, (problem or status.remark) * wrong)
        is_own = status.lamp is Lamp.MISSING or self.role == "sensor"
        self._mended_by = self.role if is_own else "amplifier"
        self.remedy_button.setText(f"{REMEDIES[self._mended_by]} …")

    def show_instruments(self, devices: Sequence[FoundDevice]) -> None:
        """List the discovered instruments of this tile; a single one is filled in."""
        self._instruments = tuple(devices)
        self.instrument_box.clear()
        self.instrument_box.addItem(f"found: {len(devices)}, choose one" if devices else "nothing was found")
        self.instrument_box.addItems([f"{device.identity or device.role} at {device.where}" for device in devices])
        self.instrument_box.show()
        if len(devices) == 1:
            self.instrument_box.setCurrentIndex(1)
            self.use(devices[0])

    def _live_value(self, reading: LiveValues) -> tuple[str, str, float]:
        """Return the live value of this instrument as text, its meaning, and the value as a number for the trace."""
        return f"{reading.drive_v:z.3f} V", "its output, as the card sees it", reading.drive_v

    def _ask_remedy(self) -> None:
        self.remedy_requested.emit(self._mended_by)

    def _show_tables(self) -> None:
        """Show parts of the tile that depend on its tables."""

    def _on_changed(self) -> None:
        self._show_tables()
        self.changed.emit()

    def _on_instrument_chosen(self, index: int) -> None:
        if index > 0:
            self.use(self._instruments[index - 1])


class TileGrid(QWidget):
    """Tiles in a row, with the wires between them, where there is room, else in two columns or one."""

    def __init__(self, tiles: Sequence[QWidget]) -> None:
        super().__init__()
        self._tiles, self._columns = tuple(tiles), 0
        self._layout = QGridLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(8)
        self._layout.setSizeConstraint(QGridLayout.SizeConstraint.SetNoConstraint)
        self._arrange(1)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        fitting = [columns for columns in (4, 2) if self._least_width(columns) <= self.width()]
        self._arrange(fitting[0] if fitting else 1)

    def minimumSizeHint(self) -> QSize:
        return QSize(self._least_width(1), super().minimumSizeHint().height())

    def _least_width(self, columns: int) -> int:
        widths = [tile.minimumSizeHint().width() for tile in self._tiles]
        gap = px(WIRE_PX) if columns == len(self._tiles) else self._layout.verticalSpacing()
        return sum(max(widths[at::columns]) for at in range(columns)) + (columns - 1) * gap

    def _arrange(self, columns: int) -> None:
        if columns == self._columns:
            return
        for at in range(max(self._columns, columns)):
            self._layout.setColumnStretch(at, int(at < columns))
        self._columns = columns
        in_row = columns == len(self._tiles)
        self._layout.setHorizontalSpacing(px(WIRE_PX) if in_row else self._layout.verticalSpacing())
        for at, tile in enumerate(self._tiles):
            self._layout.addWidget(tile, at // columns, at % columns)

    def paintEvent(self, _event: QPaintEvent) -> None:
        if self._columns != len(self._tiles):
            return
        head, ink = px(7), tokens().text2
        with painting(self) as painter:
            for name, before, after in zip(WIRES, self._tiles, self._tiles[1:], strict=False):
                left, right, y = before.geometry().right() + 2.0, after.x() - 2.0, before.y() + px(84)
                painter.setPen(QPen(QColor(ink), 1.75))
                painter.setBrush(QColor(ink))
                painter.drawLine(QPointF(left, y), QPointF(right - head, y))
                painter.drawPolygon(
                    [QPointF(right, y), QPointF(right - head, y - head / 2), QPointF(right - head, y + head / 2)]
                )
                area = QRectF(left, y + px(6), right - left, px(18))
                draw_text(painter, area, name, ink, align=CENTRE)


class SourceTile(Tile):
    """The instrument at the amplifier's input: a generator, a DC supply or an output of the card."""

    def __init__(self) -> None:
        super().__init__(
            "generator",
            "Generator",
            1,
            {
                "source": ("kind",),
                "generator": ("resource", "driver", "serial"),
                "supply": ("resource", "serial", "channel"),
            },
        )

    @property
    def address_editor(self) -> QWidget:
        """Field of the instrument's address; for an output of the card, the field of the kind."""
        name = next((name for name, kind in SOURCE_KINDS.items() if self.form.record.kind == kind), "")
        return self.forms[name].rows["resource"].editor if name else self.form.rows["kind"].editor

    def use(self, device: FoundDevice) -> None:
        self.form.update_record(kind=SOURCE_KINDS[device.role])
        self.forms[device.role].update_record(resource=device.where, serial=device.serial)
        self._on_changed()

    def _show_tables(self) -> None:
        for name, kind in SOURCE_KINDS.items():
            self.forms[name].setVisible(self.form.record.kind == kind)


class AmplifierTile(Tile):
    """The amplifier and its characteristic."""

    def __init__(self) -> None:
        self.plot = AmplifierPlot()  # in the place of the trace
        shown = ("rest_v", "low_v", "high_v", "slope_below", "slope_above")
        super().__init__("amplifier", "Amplifier", 2, {"amplifier": shown}, picture=self.plot)
        self.trace.hide()

    def show_reading(self, reading: LiveValues | None) -> None:
        super().show_reading(reading)
        self.plot.show_input(None if reading is None else reading.drive_v)

    def _live_value(self, reading: LiveValues) -> tuple[str, str, float]:
        volts = float(self.form.record.amplifier_map.specimen_v([reading.drive_v])[0])
        return format_measured_volts(volts, volts), "at the specimen if high voltage is on", math.nan  # it has its plot

    def _show_tables(self) -> None:
        if not self.form.has_faults:
            self.plot.show_map(self.form.record.amplifier_map)


class CardTile(Tile):
    """The data acquisition card and its two inputs."""

    def __init__(self, server: Callable[[], str]) -> None:
        self._server = server
        shown = ("device", "serial", "drive_channel", "displacement_channel", "range_v", "terminal", "server")
        super().__init__("card", "Card", 4, {"card": shown})

    def use(self, device: FoundDevice) -> None:
        server = "" if device.driver else self._server()
        self.form.update_record(driver=device.driver or "ni", device=device.where, serial=device.serial, server=server)
        self.changed.emit()

    def _live_value(self, reading: LiveValues) -> tuple[str, str, float]:
        card, sensor = self.form.record, f"{reading.sensor_v:z.4f} V"
        return (
            f"{reading.drive_v:z.3f} V",
            f"{card.drive_channel}, drive; {card.displacement_channel}, sensor: {sensor}",
            reading.drive_v,
        )


class SensorTile(Tile):
    """The displacement sensor and its calibration."""

    def __init__(self, *items: QWidget) -> None:
        shown = (
            "preset",
            "quantity",
            "gain_m_per_v",
            "gain_relative_uncertainty",
            "valid_low_v",
            "valid_high_v",
            "expires",
        )
        self.range_bar = make_progress_bar(RANGE_STEPS, 8, "bench.sensor.range")
        self.range_bar.setAccessibleName("place of the laser's spot in the sensor's range")
        super().__init__("sensor", "Sensor", 3, {"sensor": shown}, *items, picture=self.range_bar)

    def show_reading(self, reading: LiveValues | None) -> None:
        super().show_reading(reading)
        share = 0.0 if reading is None else self._range_share(reading)
        self.range_bar.setValue(round(RANGE_STEPS * min(max(share, 0.0), 1.0)))

    def _range_share(self, reading: LiveValues) -> float:
        """Return the place of the spot in the sensor's range; 0.5 is its middle."""
        low, high = self.form.record.valid_low_v, self.form.record.valid_high_v
        return float((reading.sensor_v - low) / (high - low)) if high > low else 0.0

    def _live_value(self, reading: LiveValues) -> tuple[str, str, float]:
        share = self._range_share(reading)
        is_velocity = self.form.record.quantity == "velocity"
        if not 0 <= share <= 1 or (math.isnan(reading.displacement_um) and not is_velocity):
            return "out of range", f"move the sensor: it gives {reading.sensor_v:z.3f} V", math.nan
        where = f"at {100 * share:.0f} % of its range, aim at 50 %"
        if is_velocity:
            return f"{reading.sensor_v:z.3f} V", where, reading.sensor_v
        return f"{reading.displacement_um:+z.2f} µm", where, reading.displacement_um
