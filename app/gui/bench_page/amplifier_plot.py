"""Characteristic of the amplifier: volts on the specimen over volts at the input, with rest and the live value."""

from collections.abc import Iterable

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QWidget

from app.gui.face import Tokens, follow_tokens
from app.gui.plots import PlotBase, series_of
from model import AmplifierMap, Series

NAMES = ("characteristic", "rest", "now")


class AmplifierPlot(PlotBase):
    """The amplifier's map as two lines that meet at rest."""

    ACCESSIBLE_NAME = "plot: characteristic of the amplifier"
    LOG_AXES = (False, False)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, axis_width=52)
        self.plot.setLabel("bottom", "amplifier's input (V)")
        self.plot.setLabel("left", "specimen (V)")
        self.plot.setMouseEnabled(x=False, y=False)
        self._curve = pg.PlotDataItem()
        self._rest, self._now = (pg.ScatterPlotItem(size=size) for size in (9, 11))
        for item in (self._curve, self._rest, self._now):
            self.plot.addItem(item)
        self._map: AmplifierMap | None = None
        self.setFixedHeight(150)
        self.setObjectName("bench.amplifier.plot")
        self.setAccessibleName("characteristic of the amplifier")
        self._add_head()
        self.show_simulated(False)
        follow_tokens(self, self.apply_theme)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        self._curve.setPen(pg.mkPen(theme.model, width=2))
        self._rest.setBrush(pg.mkBrush(theme.text2))
        self._rest.setPen(pg.mkPen(theme.text2))
        self._now.setBrush(pg.mkBrush(None))
        self._now.setPen(pg.mkPen(theme.ink, width=2))

    def show_map(self, amplifier: AmplifierMap) -> None:
        """Draw a characteristic."""
        if amplifier == self._map:
            return
        self._map = amplifier
        inputs = np.array([amplifier.low_v, amplifier.rest_v, amplifier.high_v])
        volts = amplifier.specimen_v(inputs)
        self._curve.setData(inputs, volts)
        self._rest.setData([amplifier.rest_v], [0.0])
        self.plot.setXRange(inputs[0], inputs[-1], padding=0.06)
        self.plot.setYRange(float(volts[0]), float(volts[-1]), padding=0.1)

    def show_input(self, volts: float | None) -> None:
        """Mark the present volts at the input; None for no mark."""
        if volts is None or self._map is None:
            self._now.clear()
        else:
            self._now.setData([volts], self._map.specimen_v([volts]))

    def _series(self) -> Iterable[Series]:
        return series_of(NAMES[0], self._curve)
