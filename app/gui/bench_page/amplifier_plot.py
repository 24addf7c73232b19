"""Characteristic of the amplifier: volts on the specimen over volts at the input, with rest and the live value."""

import numpy as np

from app.gui.face import set_length
from app.gui.plots import MODEL_WIDTH, SOLID, Chart, Panel, Picture, layer
from model import AmplifierMap

LEAST_STEP_V = 0.01
"""Noise of the input, less than a pixel: the plot is not drawn again for it."""


class AmplifierPlot(Chart):
    """The amplifier's map as two lines that meet at rest."""

    def __init__(self) -> None:
        super().__init__("characteristic of the amplifier", headed=False, zooms=False)
        self._map: AmplifierMap | None = None
        self._input: float | None = None
        set_length(self, height=172)
        self.setObjectName("bench.amplifier.plot")
        self.setAccessibleName("characteristic of the amplifier")

    def show_map(self, amplifier: AmplifierMap) -> None:
        """Draw a characteristic."""
        if amplifier != self._map:
            self._map = amplifier
            self._draw_map()

    def show_input(self, volts: float | None) -> None:
        """Mark the present volts at the input; None for no mark."""
        before = self._input
        same = volts == before if volts is None or before is None else abs(volts - before) < LEAST_STEP_V
        if not same:
            self._input = volts
            self._draw_map()

    def _draw_map(self) -> None:
        if self._map is None:
            return
        inputs = np.array([self._map.low_v, self._map.rest_v, self._map.high_v])
        volts = self._map.specimen_v(inputs)
        layers = [
            layer(name="characteristic", x=inputs, y=volts, tone="model", line=SOLID, width=MODEL_WIDTH),
            layer(name="rest", x=inputs[1:2], y=np.zeros(1), tone="text2", symbol="o", label="rest", copied=False),
        ]
        if self._input is not None:
            now = np.array([self._input])
            layers.append(
                layer(
                    name="now", x=now, y=self._map.specimen_v(now), symbol="o", hollow=True, label="now", copied=False
                )
            )
        self.show_picture(
            Picture(
                x_title="Amplifier's input, V",
                panels=(Panel(title="Specimen, V", ticks=tuple(map(float, volts))),),
                layers=tuple(layers),
                log=(False, False),
            )
        )
