"""Calibration of the displacement sensor: live volts beside the typed position, points, line, uncertainty and dates."""

import math
from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QLineEdit

from app.common import UnitError, sentence_case, to_number, typeset
from app.config import CalibrationPoint, SensorCalibration, SensorCalibrationError, calibrate_sensor
from app.gui.bench_page.calibration_plot import CalibrationPlot
from app.gui.widgets import (
    StatusLine,
    column,
    configure,
    fill_table,
    make_button,
    make_label,
    make_labelled_grid,
    make_line_edit,
    make_panel,
    make_read_only_table,
    row,
)
from app.live import LiveValues
from model import format_with_uncertainty

VALID_FOR = timedelta(days=365)
"""Initial value of the due date; the laboratory's own rule takes precedence."""

RESULT_HEIGHT = 96

HELP_TEXT = (
    "Put the target at a position that you know (gauge blocks, a micrometer), wait until the volts stand still, type the position and "
    "take the point; two or more. Positions increase in the direction that is to count as positive displacement."
)
UNCERTAINTY_TIP = "of one position; half the stated tolerance divided by 1.7 for gauge blocks"
COLUMNS = ("position (µm)", "volts", "residual (µm)")


class CalibrationPanel(QFrame):
    """Two or more points, the line through them, and the sensor's gain and zero.

    Args:
        move_target: moves the target of a simulated bench by metres; None on a real one.
    """

    applied = Signal(dict)
    """Values of the table [sensor]."""

    def __init__(self, move_target: Callable[[float], object] | None) -> None:
        super().__init__()
        self._move_target, self._moved_m = move_target, 0.0
        self._reading: LiveValues | None = None
        self.points: list[CalibrationPoint] = []
        self.result: SensorCalibration | None = None
        self.volts_label = make_label("no live volts", "value", wrap=False, name="bench.calibration.volts")
        today = datetime.now(UTC).astimezone().date()
        self.position_edit, self.uncertainty_edit, self.calibrated_edit, self.expires_edit = (
            make_line_edit(f"bench.calibration.{name}", label, text=text, toolTip=tip, minimumWidth=70)
            for name, label, tip, text in (
                ("position", "position of the target in µm", "µm or with a unit", ""),
                ("uncertainty", "standard uncertainty of a position in µm", UNCERTAINTY_TIP, ""),
                ("calibrated", "calibrated on", "YYYY-MM-DD", today.isoformat()),
                ("expires", "calibration due on", "YYYY-MM-DD", (today + VALID_FOR).isoformat()),
            )
        )
        self.take_button = make_button("Take point", self.take_point, "go", name="bench.calibration.take")
        self.move_button = make_button(
            "Move the simulated target there", self.move_target, name="bench.calibration.move"
        )
        if move_target is None:  # showing it before it has a parent would open a window
            self.move_button.hide()
        self.remove_button = make_button("Remove point", self.remove_point, name="bench.calibration.remove")
        self.apply_button = make_button("Use this calibration", self.apply, "go", name="bench.calibration.apply")
        self.message_label = configure(StatusLine(), "bench.calibration.message")
        # A fixed height: the buttons below do not move with the text.
        top = Qt.AlignmentFlag.AlignTop
        self.result_label = make_label(
            "", "large", True, "bench.calibration.result", minimumHeight=RESULT_HEIGHT, alignment=top
        )
        self.table = make_read_only_table(
            COLUMNS,
            "bench.calibration.points",
            "points of the calibration",
            stretched="all",
            showGrid=True,
            minimumHeight=120,
            maximumHeight=300,
        )
        self.plot = CalibrationPlot()
        self.plot.is_simulated = move_target is not None
        self._build()
        self._update()

    def show_reading(self, reading: LiveValues | None) -> None:
        """Show the live volts; None where the bench is not open, or a run has the card."""
        self._reading = reading
        if reading is None:
            self.volts_label.setText("no live volts")
        elif math.isnan(reading.sensor_error_v):
            self.volts_label.setText(f"{reading.sensor_v:.4f} V")
        else:
            text = format_with_uncertainty(reading.sensor_v, reading.sensor_error_v, "V")
            self.volts_label.setText(typeset(text))
        self.take_button.setEnabled(reading is not None)
        self.move_button.setEnabled(reading is not None)

    def move_target(self) -> None:
        """Move the target of the simulated bench to the typed position."""
        position_m = self._typed_m(self.position_edit, "position")
        if position_m is not None and self._move_target is not None:
            self._move_target(position_m - self._moved_m)
            self._moved_m = position_m

    def take_point(self) -> None:
        """Add the live volts at the typed position."""
        position_m = self._typed_m(self.position_edit, "position")
        uncertainty_m = self._typed_m(self.uncertainty_edit, "standard uncertainty of a position")
        reading = self._reading
        if position_m is None or uncertainty_m is None or reading is None:
            return
        if uncertainty_m <= 0:
            self._complain(
                "The standard uncertainty of a position must be positive: the uncertainty of your gauge, e.g. 0.5 µm."
            )
        elif math.isnan(reading.sensor_error_v):
            self._complain("The volts have just begun to be averaged: wait a second, then take the point.")
        elif math.isnan(reading.displacement_um):
            self._complain(
                f"The sensor reports out of range ({reading.sensor_v:.3f} V): move the target into its range, or correct valid low "
                "and valid high in its tile."
            )
        else:
            self.points.append(CalibrationPoint(position_m, uncertainty_m, reading.sensor_v, reading.sensor_error_v))
            self.message_label.show_message("")
            self._update()
            self.position_edit.selectAll()
            self.position_edit.setFocus()

    def remove_point(self) -> None:
        """Remove the selected point, or the last one."""
        if self.points:
            at = self.table.currentRow()
            self.points.pop(at if 0 <= at < len(self.points) else -1)
            self._update()

    def apply(self) -> None:
        """Emit the values of the sensor's table."""
        if self.result is None:
            return
        days = {}
        for name, edit in (("calibrated", self.calibrated_edit), ("expires", self.expires_edit)):
            days[name] = edit.text().strip()
            try:
                if days[name]:
                    date.fromisoformat(days[name])
            except ValueError:
                self._complain(f"{edit.accessibleName()}: {days[name]!r} is no day; write it as 2026-11-21.")
                return
        self.applied.emit(
            {
                **self.result.rounded(),
                "calibration_points": tuple((point.position_m, round(point.volts, 6)) for point in self.points),
                **days,
            }
        )
        self.message_label.show_message("The values are in the sensor's tile; Save writes them into the bench file.")

    def _typed_m(self, edit: QLineEdit, quantity: str) -> float | None:
        text = edit.text().strip()
        try:
            if not text:
                raise UnitError("give a value in µm")
            return to_number(f"{text} µm" if text.lstrip("+-−").replace(".", "", 1).isdigit() else text, "m")
        except UnitError as error:
            self._complain(f"{sentence_case(quantity)}: {error}")
            edit.setFocus()
            return None

    def _complain(self, text: str) -> None:
        self.message_label.show_message(text, is_error=True)

    def _update(self) -> None:
        """Fit the line again."""
        text = ""
        try:
            self.result = calibrate_sensor(self.points)
        except SensorCalibrationError as error:
            self.result = None
            text = str(error) if len(self.points) > 1 else HELP_TEXT
        else:
            text = _describe(self.result, len(self.points))
        self.result_label.setText(sentence_case(text))
        self.apply_button.setEnabled(self.result is not None)
        self.remove_button.setEnabled(bool(self.points))
        residuals_m = [None] * len(self.points) if self.result is None else self.result.residuals_m
        rows = [
            (
                f"{1e6 * point.position_m:g}",
                f"{point.volts:.5f}",
                "" if residual_m is None else f"{1e6 * residual_m:+.3f}",
            )
            for point, residual_m in zip(self.points, residuals_m, strict=True)
        ]
        fill_table(self.table, [[typeset(cell) for cell in cells] for cells in rows])
        self.plot.show_points(self.points, self.result)

    def _build(self) -> None:
        editors = {
            "position (µm)": self.position_edit,
            "standard uncertainty of a position (µm)": self.uncertainty_edit,
            "calibrated on": self.calibrated_edit,
            "due on": self.expires_edit,
        }
        fields = make_labelled_grid(editors, (8, 4), stretch={1: 1}, wrap=True)
        left = column(
            self.volts_label,
            fields,
            row(self.take_button, self.move_button, self.remove_button, None),
            self.message_label,
            self.result_label,
            row(self.apply_button, None),
            None,
        )
        heading = make_label("Calibrate the sensor", "heading", wrap=False)
        make_panel(heading, row((left, 3), (self.table, 2), (self.plot, 3)), frame=self)


def _describe(calibration: SensorCalibration, count: int) -> str:
    gain = 1e3 * calibration.gain_m_per_v
    text = f"gain {format_with_uncertainty(gain, abs(gain) * calibration.gain_relative_uncertainty, 'mm/V')}"
    text += (
        f" ({1e2 * calibration.gain_relative_uncertainty:.2g} %, standard uncertainty), zero {calibration.zero_v:.4f} V"
    )
    if count > 2:
        return f"{text}, largest residual {1e6 * max(map(abs, calibration.residuals_m)):.2g} µm"
    return f"{text}; two points show no deviation from a line: a third one would"
