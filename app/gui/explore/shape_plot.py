"""Animated deflection shape of the beam: both halves, envelope, MFC layer and cylinder, in slow motion."""

import time
from collections.abc import Iterable

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QWidget

from app.explore import PHASES, BeamMotion
from app.gui.face import Tokens, follow_tokens
from app.gui.plots import PlotBase, round_step, series_of
from model import Series

CYCLE_S = 1.6
"""Duration of one displayed period."""


class ShapePlot(PlotBase):
    """`tick` advances the animation; it pauses without a motion and while the plot is hidden."""

    ACCESSIBLE_NAME = "plot: shape of the beam"
    LOG_AXES = (False, False)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._motion: BeamMotion | None = None
        self._max_um, self._drawn_phase = 0.0, -1
        self.frames = 0
        self.show_simulated(False)  # the model is not a simulated measurement
        self.plot.setLabel("left", "shape (µm)")
        self.plot.setLabel("bottom", "along the beam (mm)")
        self._envelope = [pg.PlotCurveItem(antialias=True) for _ in range(2)]
        self._fill = pg.FillBetweenItem(*self._envelope)
        self.beam, self.layer = pg.PlotCurveItem(antialias=True), pg.PlotCurveItem(antialias=True, connect="finite")
        self.cylinder = pg.PlotCurveItem(antialias=True)
        self._clamps = [pg.PlotCurveItem() for _ in range(2)]
        for item in (self._fill, *self._envelope, self.layer, self.beam, self.cylinder, *self._clamps):
            self.plot.addItem(item)
        self._add_head()
        follow_tokens(self, self.apply_theme)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        for item, color, width in (
            (self.beam, theme.model, 2),
            (self.layer, theme.amber_text, 5),
            (self.cylinder, theme.text, 7),
            *((line, theme.line, 1) for line in self._envelope),
            *((clamp, theme.text2, 6) for clamp in self._clamps),
        ):
            item.setPen(pg.mkPen(color, width=width))
        fill = pg.mkColor(theme.model)
        fill.setAlpha(26)
        self._fill.setBrush(fill)

    def _series(self) -> Iterable[Series]:
        for name, line in zip(("the beam", "lowest", "highest"), (self.beam, *self._envelope), strict=True):
            yield from series_of(name, line)

    def _column_names(self) -> tuple[str, str]:
        return "along the beam (mm)", "deflection (µm), by the model"

    def show_motion(self, motion: BeamMotion, frequency_hz: float) -> None:
        """Show a motion."""
        self._motion, self._drawn_phase = motion, -1
        low, high = (1e6 * mirror_half(v) for v in (motion.deflection.min(0), motion.deflection.max(0)))
        x = 1e3 * beam_positions(motion)
        for line, values in zip(self._envelope, (low, high), strict=True):
            line.setData(x, values)
        top = max(float(np.abs(low).max()), float(np.abs(high).max()), 1.0)
        if not 0.4 * self._max_um < 1.1 * top < self._max_um:
            step = round_step(1.3 * top, 5)
            self._max_um = step * np.ceil(1.3 * top / step)
        self.plot.setYRange(-self._max_um, self._max_um, padding=0)
        reach = 2e3 * float(motion.x[-1])
        self.plot.setXRange(-0.03 * reach, 1.03 * reach, padding=0)
        edge = 0.25 * self._max_um
        for clamp, at in zip(self._clamps, (0.0, reach), strict=True):
            clamp.setData([at, at], [-edge, edge])
        slower = CYCLE_S * frequency_hz
        self.corner_label.set_text(
            f"{frequency_hz:.4g} Hz, slowed {slower:.0f} times; MFC thick, cylinder in the middle"
        )
        self.tick()

    def tick(self) -> None:
        """Draw the phase that the clock has reached."""
        if self._motion is None or not self.isVisible():
            return
        phase = int(time.monotonic() / CYCLE_S * PHASES) % PHASES
        if phase == self._drawn_phase:
            return
        self._drawn_phase = phase
        self.frames += 1
        shape = self._motion
        w, x = 1e6 * mirror_half(shape.deflection[phase]), beam_positions(shape)
        length = 2 * shape.x[-1]
        self.beam.setData(1e3 * x, w)
        covered = (x >= shape.L1) & (x <= length - shape.L1)
        self.layer.setData(1e3 * x[covered], w[covered])
        middle = (x >= shape.L2) & (x <= length - shape.L2)
        self.cylinder.setData(1e3 * x[middle], np.full(int(middle.sum()), float(w[len(w) // 2])))


def beam_positions(motion: BeamMotion) -> np.ndarray:
    """Return positions on the whole beam, m, from one clamp to the other."""
    return np.concatenate((motion.x, 2 * motion.x[-1] - motion.x[-2::-1]))


def mirror_half(half: np.ndarray) -> np.ndarray:
    """Return the deflection of the whole beam, which is symmetric."""
    return np.concatenate((half, half[-2::-1]))
