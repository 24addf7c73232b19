"""Plot of a sensor's calibration: positions over volts and the fitted line, above the residuals."""

from collections.abc import Iterable, Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QWidget

from app.config import CalibrationPoint, SensorCalibration
from app.gui.face import Tokens, follow_tokens
from app.gui.plots import PlotBase, series_of
from model import Series

LEAST_RANGE_UM = 0.01


class CalibrationPlot(PlotBase):
    """Points and line; residuals below on the same volts."""

    ACCESSIBLE_NAME = "plot: points and line of the calibration"
    LOG_AXES = (False, False)

    def __init__(self, parent: QWidget | None = None) -> None:
        canvas = pg.GraphicsLayoutWidget()
        plots = [canvas.addPlot(row=at, col=0, enableMenu=False) for at in (0, 1)]
        super().__init__(parent, canvas=canvas, plots=plots, axis_width=56)
        plots[1].setXLink(plots[0])
        plots[0].getAxis("bottom").setStyle(showValues=False)
        canvas.ci.layout.setRowStretchFactor(0, 3)
        canvas.ci.layout.setRowStretchFactor(1, 2)
        for plot, label in zip(plots, ("position (µm)", "residual (µm)"), strict=True):
            plot.setLabel("left", label)
            plot.setMouseEnabled(x=False, y=False)
        plots[1].setLabel("bottom", "sensor's output (V)")
        self._line, self._zero = pg.PlotDataItem(), pg.InfiniteLine(0.0, angle=0)
        self._points, self._residuals = pg.ScatterPlotItem(size=9), pg.ScatterPlotItem(size=9)
        for plot, items in zip(plots, ((self._line, self._points), (self._zero, self._residuals)), strict=True):
            for item in items:
                plot.addItem(item)
        self.setFixedHeight(300)
        self.setObjectName("bench.calibration.plot")
        self.setAccessibleName("calibration: positions, line and residuals")
        self._add_head()
        follow_tokens(self, self.apply_theme)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        self._line.setPen(pg.mkPen(theme.model, width=2))
        self._zero.setPen(pg.mkPen(theme.line))
        for item in (self._points, self._residuals):
            item.setBrush(pg.mkBrush(theme.ink))
            item.setPen(pg.mkPen(theme.ink))

    def show_points(self, points: Sequence[CalibrationPoint], calibration: SensorCalibration | None) -> None:
        """Draw the points, and the line if there is one."""
        volts = np.array([point.volts for point in points])
        positions_um = np.array([1e6 * point.position_m for point in points])
        self._points.setData(volts, positions_um)
        if len(points) > 1:
            self._plots[0].setXRange(volts.min(), volts.max(), padding=0.08)
            self._plots[0].setYRange(positions_um.min(), positions_um.max(), padding=0.12)
        if calibration is None:
            self._line.setData([], [])
            self._residuals.clear()
            return
        ends = np.array([volts.min(), volts.max()])
        self._line.setData(ends, 1e6 * calibration.gain_m_per_v * (ends - calibration.zero_v))
        residuals_um = 1e6 * np.array(calibration.residuals_m)
        self._residuals.setData(volts, residuals_um)
        largest_um = max(float(np.abs(residuals_um).max()), LEAST_RANGE_UM)
        self._plots[1].setYRange(-largest_um, largest_um, padding=0.15)

    def _series(self) -> Iterable[Series]:
        return [*series_of("points", self._points), *series_of("line", self._line)]
