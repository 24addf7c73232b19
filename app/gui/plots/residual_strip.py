"""Residual plot under the response: measured less model, or the phase, on the same frequency axis."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QColor

from app.gui.face import Tokens, follow_tokens, tokens
from app.gui.plots.base import stable_range
from app.gui.plots.items import BarsItem, CurveItem, ScatterItem
from app.gui.plots.lower_strip import StripBase
from app.gui.plots.series import series_of
from app.live import ModelCurves
from model import Series
from protocols.base import Quality

NOTHING, RESIDUAL, PHASE = "nothing", "residual", "phase"
STRIP_QUANTITIES = (NOTHING, RESIDUAL, PHASE)
HEIGHT = 96


class ResidualStrip(StripBase):
    """Shares the frequency axis of `main_plot`."""

    ACCESSIBLE_NAME = "plot: residual of the points"

    def __init__(self, main_plot: Any) -> None:
        super().__init__(main_plot)
        self.quantity = NOTHING
        self.setFixedHeight(HEIGHT)
        self._line = CurveItem(antialias=True, connect="finite")
        self._bars = BarsItem(beam=0.0)
        self.scatter = ScatterItem(size=8, antialias=True)
        for item in (self._line, self._bars, self.scatter):
            self.plot.addItem(item)
        follow_tokens(self, self.apply_theme)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        self._line.setPen(pg.mkPen(theme.model, width=1.5))
        self._bars.setData(pen=pg.mkPen(theme.ink))

    def _series(self) -> Iterable[Series]:
        return [*series_of("measured", self.scatter, self._bars), *series_of("model", self._line)]

    def _column_names(self) -> tuple[str, str]:
        return "frequency (Hz)", self.plot.getAxis("left").labelText

    def draw(self, points: Sequence[Any], curve: ModelCurves | None, colors: Sequence[QColor]) -> None:
        """Draw the selected quantity of the points, each in its colour, and of the curve."""
        self.setVisible(self.quantity != NOTHING)
        self.simulated = any(Quality.SIMULATED in Quality(p.quality) for p in points)
        if self.quantity == NOTHING:
            return
        x = np.array([p.frequency for p in points])
        residual = self.quantity == RESIDUAL
        y, errors, line = _residual(points, curve) if residual else _phase(points, curve)
        self.plot.setLabel("left", "Δ (%)" if residual else "phase (°)")
        self._line.setData(*line)
        there = np.isfinite(y)  # Qt crashes when it paints a point that is not finite
        seen = [(p, ink) for p, ink, is_there in zip(points, colors, there, strict=True) if is_there]
        fills = [pg.mkBrush(ink if Quality(p.quality).usable else tokens().surface) for p, ink in seen]
        pens = [pg.mkPen(ink, width=2) for _, ink in seen]
        self.scatter.setData(x=x[there], y=y[there], symbol="o", pen=pens, brush=fills)
        half = np.nan_to_num(errors[there])
        self._bars.setData(x=x[there], y=y[there], height=2 * half)
        modelled = np.asarray(line[1])
        every = np.concatenate([y[there] - half, y[there] + half, modelled[np.isfinite(modelled)]])
        lowest, highest = (float(every.min()), float(every.max())) if every.size else (-1.0, 1.0)
        self.plot.setYRange(*stable_range(lowest, highest, None), padding=0.02)


def _residual(points: Sequence[Any], curve: ModelCurves | None) -> tuple[Any, Any, tuple[Any, Any]]:
    """Return measured max - min less the model's, in per cent of the model's, its errors, and the line of zero."""
    if curve is None:
        nothing = np.full(len(points), np.nan)
        return nothing, nothing, ([], [])
    model = np.array([_model_peak_to_peak(point, curve) for point in points])
    y = 100 * (np.array([p.peak_to_peak for p in points]) / model - 1)
    return (
        y,
        100 * np.array([p.peak_to_peak_errors for p in points]) / model,
        (curve.free["peak_to_peak"].x[[0, -1]], [0.0, 0.0]),
    )


def _model_peak_to_peak(point: Any, curve: ModelCurves) -> float:
    """Return the model's max - min at a point, at the point's elongation of the membrane; NaN without such a curve."""
    own = curve.at_elongation(getattr(point, "elongation", None))
    if own is None:
        return math.nan
    return float(np.interp(point.frequency, own["peak_to_peak"].x, own["peak_to_peak"].y))


def _phase(points: Sequence[Any], curve: ModelCurves | None) -> tuple[Any, Any, tuple[Any, Any]]:
    """Return the phase of the fundamental relative to the drive, degrees, unwrapped downwards from zero."""
    y = np.degrees([(p.phase + 0.5) % (2 * np.pi) - 2 * np.pi - 0.5 if p.phase > 0.5 else p.phase for p in points])
    errors = np.degrees([p.phase_errors for p in points])
    if curve is None:
        return y, errors, ([], [])
    # One line after the other with a gap between them: free, then on the membrane.
    every = [curves["fundamental"] for curves in (curve.free, *curve.on_membrane.values())]
    lines = [(one.x, np.degrees(np.unwrap(np.angle(one.y)))) for one in every]
    x, phases = (np.concatenate([np.append(part, np.nan) for part in parts]) for parts in zip(*lines, strict=True))
    return y, errors, (x, phases)
