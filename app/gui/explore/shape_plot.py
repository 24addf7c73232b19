"""The beam in motion, slowed down: both halves, its envelope, where the MFC lies and where the cylinder sits."""

import time

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.explore.engine import PHASES, Shape
from app.gui.plots.base import Corner, paint, quiet, round_step
from app.gui.plots.copy import Copying, as_text, drawn
from app.gui.widgets.theme import Theme

TURN_S = 1.6
"""How long one period is shown."""


class ShapePlot(QWidget):
    """`refresh` moves it on; it rests while nothing is known or it is not seen."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._shape: Shape | None = None
        self._top_um, self._drawn = 0.0, -1
        self.frames = 0
        self.canvas = pg.PlotWidget(enableMenu=False)
        self.plot = self.canvas.getPlotItem()
        quiet(self.plot, self.font())
        self.plot.setContentsMargins(0, 0, 8, 0)
        self.plot.getAxis("left").setWidth(62)
        self.plot.setLabel("left", "shape (µm)")
        self.plot.setLabel("bottom", "along the beam (mm)")
        self._envelope = [pg.PlotCurveItem(antialias=True) for _ in range(2)]
        self._fill = pg.FillBetweenItem(*self._envelope)
        self.beam, self.layer = pg.PlotCurveItem(antialias=True), pg.PlotCurveItem(antialias=True, connect="finite")
        self.cylinder = pg.PlotCurveItem(antialias=True)
        self._clamps = [pg.PlotCurveItem() for _ in range(2)]
        for item in (self._fill, *self._envelope, self.layer, self.beam, self.cylinder, *self._clamps):
            self.plot.addItem(item)
        self.words = Corner(self.plot, "", self.font(), right=False)
        self.copying = Copying(self.canvas, self._table)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.canvas)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.canvas.setBackground(theme.panel)
        paint(self.plot, theme)
        self.beam.setPen(pg.mkPen(theme.model, width=2))
        self.layer.setPen(pg.mkPen(theme.warn, width=5))
        self.cylinder.setPen(pg.mkPen(theme.text, width=7))
        for line in self._envelope:
            line.setPen(pg.mkPen(theme.line, width=1))
        fill = pg.mkColor(theme.model)
        fill.setAlpha(26)
        self._fill.setBrush(fill)
        for clamp in self._clamps:
            clamp.setPen(pg.mkPen(theme.dim, width=6))
        self.words.colour(theme.text)

    def _table(self) -> str:
        shown = list(drawn("the beam", self.beam))
        for name, line in zip(("lowest", "highest"), self._envelope, strict=True):
            shown += drawn(name, line)
        return as_text(shown, "along the beam (mm)", "deflection (µm), by the model", simulated=False)

    def show_shape(self, shape: Shape, frequency_hz: float) -> None:
        """Another motion."""
        self._shape, self._drawn = shape, -1
        low, high = (1e6 * both(v) for v in (shape.deflection.min(0), shape.deflection.max(0)))
        x = 1e3 * along(shape)
        for line, values in zip(self._envelope, (low, high), strict=True):
            line.setData(x, values)
        top = max(float(np.abs(low).max()), float(np.abs(high).max()), 1.0)
        if not 0.4 * self._top_um < 1.1 * top < self._top_um:
            step = round_step(1.3 * top, 5)
            self._top_um = step * np.ceil(1.3 * top / step)
        self.plot.setYRange(-self._top_um, self._top_um, padding=0)
        reach = 2e3 * float(shape.x[-1])
        self.plot.setXRange(-0.03 * reach, 1.03 * reach, padding=0)
        edge = 0.25 * self._top_um
        for clamp, at in zip(self._clamps, (0.0, reach), strict=True):
            clamp.setData([at, at], [-edge, edge])
        slower = TURN_S * frequency_hz
        self.words.say(f"{frequency_hz:.4g} Hz, slowed {slower:.0f} times; MFC thick, cylinder in the middle")
        self.refresh()

    def refresh(self) -> None:
        """Move on with the clock."""
        if self._shape is None or not self.isVisible():
            return
        phase = int(time.monotonic() / TURN_S * PHASES) % PHASES
        if phase == self._drawn:
            return
        self._drawn = phase
        self.frames += 1
        shape = self._shape
        w, x = 1e6 * both(shape.deflection[phase]), along(shape)
        length = 2 * shape.x[-1]
        self.beam.setData(1e3 * x, w)
        covered = (x >= shape.L1) & (x <= length - shape.L1)
        self.layer.setData(1e3 * x[covered], w[covered])
        middle = (x >= shape.L2) & (x <= length - shape.L2)
        self.cylinder.setData(1e3 * x[middle], np.full(int(middle.sum()), float(w[len(w) // 2])))


def along(shape: Shape) -> np.ndarray:
    """Positions on the whole beam, m, from one clamp to the other."""
    return np.concatenate((shape.x, 2 * shape.x[-1] - shape.x[-2::-1]))


def both(half: np.ndarray) -> np.ndarray:
    """The other half of the beam does the same."""
    return np.concatenate((half, half[-2::-1]))
