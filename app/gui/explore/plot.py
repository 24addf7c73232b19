"""Explore plot: amplitude and phase of the model over frequency, kept curves, measured runs, felt bands."""

from collections.abc import Sequence

import numpy as np

from app.archive import MeasuredResponse
from app.explore import ExploreResult, KeptCurve
from app.gui.plots import (
    DASHED,
    DISPLACEMENT,
    FREQUENCY,
    MODEL_WIDTH,
    SERIES,
    SOLID,
    Chart,
    Layer,
    Panel,
    Picture,
    Spot,
    Threshold,
    curve_tone,
    layer,
    run_layers,
)
from model.response import PeriodicResponse


class ExplorePlot(Chart):
    """Draws results of the model; its cursor is the frequency of the motion."""

    def __init__(self) -> None:
        super().__init__("response of the model")
        self._result: ExploreResult | None = None
        self._kept_settings: tuple[KeptCurve, ...] = ()
        self._runs: Sequence[MeasuredResponse] = ()
        self._shown = (True, False, False)
        self._max_hz = 250.0
        self._draw_all()

    def show_result(self, result: ExploreResult, kept_curves: tuple[KeptCurve, ...]) -> None:
        self._result = result
        if result.kept_curves is not None:
            self._kept_settings = kept_curves
        self._draw_all()

    def show_runs(self, runs: Sequence[MeasuredResponse]) -> None:
        self._runs = tuple(runs)
        self._draw_all()

    def show_series(self, peak_to_peak: bool, fundamental: bool, phase: bool) -> None:
        self._shown = (peak_to_peak, fundamental, phase)
        self._draw_all()

    def show_range(self, max_hz: float) -> None:
        self._max_hz = max_hz
        self._draw_all()

    def _draw_all(self) -> None:
        result, shown = self._result, [s for s, on in zip(SERIES, self._shown, strict=False) if on]
        curves: list[tuple[str, str, PeriodicResponse]] = []
        if result is not None:
            kept = zip(self._kept_settings, result.kept_curves or (), strict=False)
            curves = [("Model", "model", result.curve)]
            curves += [(k.label, curve_tone(at), line) for at, (k, line) in enumerate(kept)]
        layers = [layer for each in curves for layer in self._curve_layers(*each, shown)]
        for at, run in enumerate(self._runs):
            layers += run_layers(run, len(self._kept_settings) + at, shown or SERIES[:1])
        panels = [Panel(title=DISPLACEMENT, low=0.0, share=5)]
        if self._shown[2]:
            panels.append(Panel(title="Phase, °", low=-180.0, high=0.0, share=2))
            for at, run in enumerate(self._runs):
                layers.append(
                    layer(
                        name=run.title, x=run.frequency_hz, y=np.degrees(run.phase), symbol="o", size=7,
                        tone=curve_tone(len(self._kept_settings) + at), panel=1,
                    )
                )  # fmt: skip
        picture = Picture(
            title="Response", x_title=FREQUENCY, panels=tuple(panels), layers=tuple(layers), x=(0.0, self._max_hz),
            simulated=any(run.simulated for run in self._runs), spots=self._spots(),
        )  # fmt: skip
        self.show_picture(self._threshold().add_to(picture))

    def _curve_layers(self, name: str, tone: str, line: PeriodicResponse, shown: Sequence[object]) -> list[Layer]:
        layers = []
        for series in SERIES:
            if series in shown:
                is_first = series is shown[0]
                layers.append(
                    layer(
                        name=f"{name}: {series.label}", x=line.frequency_hz, y=series.values_of(line), tone=tone,
                        line=series.line if tone == "model" else DASHED, width=MODEL_WIDTH, label=name if is_first else "",
                        group=name,
                    )
                )  # fmt: skip
        if self._shown[2]:
            y = np.degrees(line.phase)
            layers.append(
                layer(name=f"{name}: phase", x=line.frequency_hz, y=y, tone=tone, line=SOLID, panel=1, group=name)
            )
        return layers

    def _spots(self) -> tuple[Spot, ...]:
        if self._result is None or not self._shown[0]:
            return ()
        line = self._result.curve
        top = int(line.peak_to_peak.argmax())
        um, hz = 1e6 * float(line.peak_to_peak[top]), float(line.frequency_hz[top])
        return (Spot(x=hz, y=um, label=f"Largest {um:.0f} µm at {hz:.0f} Hz"),)

    def _threshold(self) -> Threshold:
        result = self._result
        if result is None:
            return Threshold()
        threshold_um = 1e6 * result.threshold_m
        if np.ptp(threshold_um) == 0:
            return Threshold(result.threshold_label, float(threshold_um[0]))
        return Threshold(result.threshold_label, curve=(result.curve.frequency_hz, threshold_um))
