"""Pictures of the points of any protocol over its axes, and of the curves that entries return in addition."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.common import axis_name, format_point, minmax_decimate
from app.gui.plots.curve_layers import LAYER_TITLES, LESS_MEAN, NOTHING, RESIDUAL, displayed, isolated, layer_series
from app.gui.plots.picture import (
    DASHED,
    DATA_WIDTH,
    DOTTED,
    MODEL_WIDTH,
    SOLID,
    Layer,
    Panel,
    Picture,
    axis_title,
    curve_tone,
    layer,
)
from app.live import ModelCurves
from model import Array, ParameterError, shown_unit
from protocols.base import Protocol, Quality, Series
from protocols.runfile import RunReadError, point_columns

EMPTY_TEXT = "Points appear here as they are measured"
MODEL_PLACES = 40
"""Number of abscissae of the model's curve."""

MAX_DRAWN_POINTS = 4000
"""A longer curve is drawn as its min/max decimation to about this number of points."""

MAX_MARKED_POINTS = 30
"""A curve of at most this number of points has a mark and an error bar at each."""

MAX_LABELS = 12
SIGMAS = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class PointsView:
    """The points of a protocol on its axes, with its fit lines and their residuals, and the model's curve."""

    kind: type[Protocol]
    points: Sequence[Any] = ()
    chosen: Sequence[bool] = ()
    curves: ModelCurves | None = None
    lower: str = RESIDUAL
    simulated: bool = False
    is_over: bool = False

    def rows(self) -> list[int]:
        """Return the indices of the points that can be drawn."""
        return [
            i for i, p in enumerate(self.points)
            if isinstance(p, self.kind.point_type) and all(np.isfinite(float(getattr(p, n))) for n in self.kind.axes)
        ]  # fmt: skip

    def picture(self) -> Picture:
        x_name, y_name = self.kind.axes
        columns = point_columns(self.kind.point_type)
        (x_factor, x_unit), (y_factor, y_unit) = (shown_unit(columns[name][0]) for name in self.kind.axes)
        rows = self.rows()
        points: list[Any] = [self.points[i] for i in rows]
        x, y, errors = (
            factor * np.array([float(getattr(p, name, np.nan)) for p in points])
            for name, factor in ((x_name, x_factor), (y_name, y_factor), (f"{y_name}_errors", y_factor))
        )
        measured = layer(
            name=self.kind.title, x=x, y=y, errors=errors, symbol="o",
            usable=np.array([Quality(p.quality).usable for p in points], bool),
            chosen=np.array([bool(self.chosen) and self.chosen[i] for i in rows], bool),
            texts=[format_point(p) for p in points], group="measured",
        )  # fmt: skip
        layers: list[Layer] = self._model(x, x_factor, y_factor)
        residuals: list[Layer] = []
        for line in self.kind.fit_lines(points) if points else ():
            layers.append(
                layer(
                    name=line.label, x=x_factor * line.x, y=y_factor * line.y, tone="model", line=SOLID,
                    width=MODEL_WIDTH, label=line.label, group="fit",
                )
            )  # fmt: skip
            fitted = list(line.fitted_rows)
            residuals.append(
                layer(
                    name=f"residual, {line.label}", x=x[fitted], y=y[fitted] - y_factor * np.interp(x[fitted] / x_factor, line.x, line.y),
                    errors=errors[fitted], symbol="o", size=7, panel=1,
                )
            )  # fmt: skip
        panels = [Panel(title=axis_title(axis_name(y_name), y_unit), share=3)]
        if residuals and self.lower == RESIDUAL:
            panels.append(Panel(title=axis_title("residual", y_unit), x_labels=False))
            ends = np.array([x.min(), x.max()])
            zero = layer(name="zero", x=ends, y=np.zeros(2), tone="model", line=SOLID, panel=1, copied=False)
            layers += [zero, *residuals]
        note = "" if all(Quality(p.quality).usable for p in points) else "crossed: not usable"
        return Picture(
            title=self.kind.title, note=note, x_title=axis_title(axis_name(x_name), x_unit), panels=tuple(panels),
            layers=(*layers, measured) if points else (), simulated=self.simulated,
            empty="No points were measured" if self.is_over else EMPTY_TEXT,
        )  # fmt: skip

    def _model(self, x: Array, x_factor: float, y_factor: float) -> list[Layer]:
        """Return the layer of the model over the range of the points, where the protocol has one."""
        if self.curves is None or self.curves.request.protocol != self.kind.name or not x.size:
            return []
        grid, y = np.linspace(x.min(), x.max(), MODEL_PLACES), None
        with suppress(ParameterError, RunReadError):  # outside the range of the model, or failed aspects
            y = self.curves.over_axes(grid / x_factor)
        if y is None:
            return []
        label = f"Model: {self.curves.active_model.description}"
        look: dict[str, Any] = {"tone": "model", "line": DASHED, "width": MODEL_WIDTH, "label": label, "group": "Model"}
        return [layer(name="model", x=grid, y=y_factor * y, **look)]


@dataclass(frozen=True, slots=True, eq=False)
class CurvesView:
    """Curves of a run with the axes of the newest; the model's is added to a frequency response of the free tactor."""

    curves: Sequence[Series]
    model: ModelCurves | None = None
    lower: str = NOTHING
    simulated: bool = False

    @property
    def visible(self) -> list[Series]:
        """Those with the axes of the newest curve."""
        last = self.curves[-1]
        names = last.x_axis.name, last.y_axis.name
        return [c for c in self.curves if (c.x_axis.name, c.y_axis.name) == names]

    def picture(self) -> Picture:
        shown = self.visible
        last = shown[-1]
        layers = self._model_layers(last)
        for at, curve in enumerate(shown):
            layers += self._layers(curve, curve_tone(at) if len(shown) > 1 else "ink", at >= len(shown) - MAX_LABELS)
        x_title, y_title = (axis_title(a.name, shown_unit(a.unit)[1]) for a in (last.x_axis, last.y_axis))
        panels = [Panel(title=y_title, share=1 if self.lower == LESS_MEAN else 3, low=None if last.is_loop else 0.0)]
        if self.lower != NOTHING:
            unit = shown_unit(last.y_axis.unit)[1] if self.lower in (RESIDUAL, LESS_MEAN) else ""
            panels.append(Panel(title=axis_title(LAYER_TITLES[self.lower], unit), x_labels=False))
            for at, curve in enumerate(shown):
                if (series := layer_series(curve, self.lower)) is not None:
                    tone = curve_tone(at) if len(shown) > 1 else "ink"
                    layers += self._layers(series, tone, False, panel=1)
        return Picture(
            title=last.name.capitalize() or "Curves", x_title=x_title, panels=tuple(panels), layers=tuple(layers),
            simulated=self.simulated,
        )  # fmt: skip

    @staticmethod
    def _layers(curve: Series, tone: str, labelled: bool, panel: int = 0) -> list[Layer]:
        drawn = curve if panel else displayed(curve)
        x, y, errors = drawn.x, drawn.plotted, drawn.errors
        few, per_column = x.size <= MAX_MARKED_POINTS, -(-2 * x.size // MAX_DRAWN_POINTS)
        name, label = drawn.title or ("" if panel else "curve"), curve.label if labelled else ""
        band, alone = None, np.zeros(x.size, bool)
        if errors is not None:
            alone = np.isfinite(errors) if few else isolated(errors)
            half = np.where(alone, np.nan, SIGMAS * errors)
            band = (y - half, y + half)
        layers = [
            layer(
                name=name, x=x, y=y, band=None if few else band, tone=tone, line=SOLID, width=DATA_WIDTH, label=label,
                group=label, panel=panel, drawn=None if x.size <= MAX_DRAWN_POINTS else minmax_decimate(x, y, per_column),
            )
        ]  # fmt: skip
        if few or alone.any():
            at = np.flatnonzero(alone | few)
            bars = None if errors is None else SIGMAS * errors[at]
            look: dict[str, Any] = {
                "tone": tone,
                "symbol": "o",
                "size": 7,
                "panel": panel,
                "copied": False,
                "group": label,
            }
            layers.append(layer(name=f"{name}, points", x=x[at], y=y[at], errors=bars, **look))
        if drawn.fit is not None and not panel:
            shade = tone if tone != "ink" else "model"
            layers.append(layer(name=f"{name}, fit", x=x, y=drawn.fit, tone=shade, line=DOTTED, width=1.5))
        return layers

    def _model_layers(self, last: Series) -> list[Layer]:
        """Return the response to one volt at the amplifier's input: the fundamental divided by its amplitude."""
        if self.model is None or last.y_axis.unit != "m/V":
            return []
        factor = shown_unit("m/V")[0] / self.model.request.amplitude_v
        drawn = self.model.free["fundamental"].scaled(1.0, factor)
        label = f"Model: {self.model.active_model.description}"
        return [
            layer(
                name=label, x=drawn.x, y=drawn.plotted, band=drawn.band, tone="model", line=DASHED, width=MODEL_WIDTH,
                label=label, group="Model",
            )
        ]  # fmt: skip
