"""Animated deflection shape of the beam: both halves, envelope, MFC layer and cylinder, in slow motion."""

import time

import numpy as np
from PySide6.QtCore import QTimer
from PySide6.QtGui import QHideEvent, QShowEvent

from app.explore import PHASES, BeamMotion
from app.gui.plots import SOLID, Chart, Panel, Picture, layer, round_step

CYCLE_S = 1.6
"""Duration of one displayed period."""

PARTS = {"beam": ("model", 2.0), "MFC": ("amber_text", 5.0), "cylinder": ("text", 7.0), "clamps": ("text2", 6.0)}
"""Tone and width of the drawn parts."""


class ShapePlot(Chart):
    """The animation pauses without a motion and while the plot is hidden."""

    def __init__(self) -> None:
        super().__init__("shape of the beam")
        self._motion: BeamMotion | None = None
        self._max_um, self._drawn_phase = 0.0, -1
        self._about = ""
        self.frames = 0
        self._timer = QTimer(self, interval=round(1000 * CYCLE_S / PHASES))
        self._timer.timeout.connect(self.tick)

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._timer.start()

    def hideEvent(self, event: QHideEvent) -> None:
        super().hideEvent(event)
        self._timer.stop()

    def show_motion(self, motion: BeamMotion, frequency_hz: float) -> None:
        self._motion, self._drawn_phase = motion, -1
        top = max(1e6 * float(np.abs(motion.deflection).max()), 1.0)
        if not 0.4 * self._max_um < 1.1 * top < self._max_um:
            step = round_step(1.3 * top, 5)
            self._max_um = step * np.ceil(1.3 * top / step)
        self._about = f"slowed {CYCLE_S * frequency_hz:.0f} times"
        self._draw_phase(0)
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
        shapes = self._shapes(self._motion, phase)
        for name, (x, y) in shapes.items():  # the lines alone move: everything else stays
            self.panels[0].drawn_layer(name).line.setData(x, y, connect="finite")

    def _shapes(self, motion: BeamMotion, phase: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Return positions, mm, and deflections, µm, of the parts."""
        w, x = 1e6 * mirror_half(motion.deflection[phase]), beam_positions(motion)
        length, edge = 2 * motion.x[-1], 0.25 * self._max_um
        covered = (x >= motion.L1) & (x <= length - motion.L1)
        middle = (x >= motion.L2) & (x <= length - motion.L2)
        ends = np.array([0.0, 0.0, np.nan, 1e3 * length, 1e3 * length])
        return {
            "beam": (1e3 * x, w),
            "MFC": (1e3 * x[covered], w[covered]),
            "cylinder": (1e3 * x[middle], np.full(int(middle.sum()), float(w[len(w) // 2]))),
            "clamps": (ends, np.array([-edge, edge, np.nan, -edge, edge])),
        }

    def _draw_phase(self, phase: int) -> None:
        motion = self._motion
        assert motion is not None
        low, high = (1e6 * mirror_half(v) for v in (motion.deflection.min(0), motion.deflection.max(0)))
        x, reach = 1e3 * beam_positions(motion), 2e3 * float(motion.x[-1])
        layers = [layer(name="envelope", x=x, y=high, band=(low, high), tone="model", line=SOLID, width=0.5)]
        for name, (at, y) in self._shapes(motion, phase).items():
            tone, width = PARTS[name]
            copied = name == "beam"
            layers.append(layer(name=name, x=at, y=y, tone=tone, width=width, line=SOLID, copied=copied))
        self.show_picture(
            Picture(
                title="Motion", x_title="Along the beam, mm", panels=(Panel(title="Shape, µm", low=-self._max_um, high=self._max_um),),
                layers=tuple(layers), x=(-0.03 * reach, 1.03 * reach), log=(False, False), note=self._about,
            )
        )  # fmt: skip


def beam_positions(motion: BeamMotion) -> np.ndarray:
    """Return positions on the whole beam, m, from one clamp to the other."""
    return np.concatenate((motion.x, 2 * motion.x[-1] - motion.x[-2::-1]))


def mirror_half(half: np.ndarray) -> np.ndarray:
    """Return the deflection of the whole beam, which is symmetric."""
    return np.concatenate((half, half[-2::-1]))
