"""Comparison plot: points of several recorded runs over frequency."""

from collections.abc import Sequence
from typing import Any

from app.archive import MeasuredResponse
from app.gui.plots import DISPLACEMENT, FREQUENCY, Chart, Panel, Picture, Threshold, run_layers


class ComparePlot(Chart):
    """Max - min over frequency of the selected runs, each in its colour and with its symbol."""

    def __init__(self) -> None:
        super().__init__("comparison of the selected runs")
        self._runs: tuple[MeasuredResponse, ...] = ()
        self._threshold, self._note = Threshold(), ""

    def show_runs(self, runs: Sequence[MeasuredResponse], text: str = "") -> None:
        """Draw these runs."""
        self._runs, self._note = tuple(runs), text
        self._draw_runs()

    def show_threshold(self, threshold: Any) -> None:
        """Show a perception threshold; None is the abdomen's."""
        self._threshold = Threshold.of(threshold)
        self._draw_runs()

    def _draw_runs(self) -> None:
        layers = tuple(layer for at, run in enumerate(self._runs) for layer in run_layers(run, at))
        right = max([100.0, *(float(run.frequency_hz.max()) for run in self._runs)])
        picture = Picture(
            note=self._note, x_title=FREQUENCY, panels=(Panel(title=DISPLACEMENT, low=0.0),), layers=layers,
            x=(0.0, 1.04 * right), simulated=any(run.simulated for run in self._runs),
        )  # fmt: skip
        self.show_picture(self._threshold.add_to(picture))
