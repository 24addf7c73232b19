"""Layers of a result curve for the lower plot: residual of its fit, loop less its mean line, phase, coherence."""

from collections.abc import Sequence

import numpy as np

from app.gui.plots.series import PlotSeries
from model import Array, shown_unit
from protocols.base import ResultCurve

NOTHING, RESIDUAL, LESS_MEAN, PHASE, COHERENCE = "nothing", "residual", "less mean", "phase", "coherence"
LAYER_LABELS = {
    NOTHING: "no lower plot",
    RESIDUAL: "lower plot: residual of the fit",
    LESS_MEAN: "lower plot: loop less its mean line",
    PHASE: "lower plot: phase",
    COHERENCE: "lower plot: coherence",
}
ISOLATED_FACTOR, NEIGHBOURS = 4.0, 4
"""A line whose error is so many times the median of so many neighbours on either side has an error bar instead of a band."""


def layers_of(curves: Sequence[ResultCurve]) -> tuple[str, ...]:
    """Return the layers that curves have, the one to begin with first."""
    if not curves:
        return (NOTHING,)
    if any(is_loop(curve) for curve in curves):
        return LESS_MEAN, NOTHING
    columns = curves[-1].columns
    has = [name for name in (COHERENCE, PHASE) if name in columns]
    if any(f"{curve.y}_fit" in curve.columns for curve in curves):
        has.append(RESIDUAL)
    return (*has, NOTHING)


def is_loop(curve: ResultCurve) -> bool:
    """Return whether the curve goes back along its axis."""
    return bool((np.diff(curve.columns[curve.x].values) < 0).any())


def layer_series(curve: ResultCurve, layer: str) -> PlotSeries | None:
    """Return a layer of a curve in display units with the errors of its y; None where it has no such layer."""
    x, y = curve.columns[curve.x], curve.columns[curve.y]
    errors = curve.columns.get(f"{curve.y}_errors")
    name, factor = f"{curve.name} {curve.label}".strip(), shown_unit(y.unit)[0]
    places = shown_unit(x.unit)[0] * x.values
    error = None if errors is None else factor * errors.values
    fitted = curve.columns.get(f"{curve.y}_fit")
    if layer == RESIDUAL and fitted is not None:
        return PlotSeries(name, places, factor * (y.values - fitted.values), error)
    if layer == LESS_MEAN and is_loop(curve):
        from protocols.signals import subtract_mean_line

        return PlotSeries(name, places, factor * subtract_mean_line(x.values, y.values), error)
    if layer == PHASE and (phase := curve.columns.get(PHASE)) is not None:
        there = np.isfinite(phase.values)
        degrees = np.full(phase.values.size, np.nan)
        degrees[there] = np.degrees(np.unwrap(phase.values[there]))
        turns = 360.0 * np.round(np.nanmean(degrees[:1]) / 360.0) if there[:1].any() else 0.0
        return PlotSeries(name, places, degrees - turns)
    if layer == COHERENCE and (coherence := curve.columns.get(COHERENCE)) is not None:
        return PlotSeries(name, places, coherence.values)
    return None


def layer_label(curve: ResultCurve, layer: str) -> str:
    """Return the label of the vertical axis of a layer."""
    unit = shown_unit(curve.columns[curve.y].unit)[1]
    return {RESIDUAL: f"residual ({unit})", LESS_MEAN: f"less mean ({unit})", PHASE: "phase (°)"}.get(layer, layer)


def isolated(errors: Array) -> Array:
    """Return which errors stand out of their neighbours', (N,): a band over them would be a bow tie."""
    padded = np.pad(np.nan_to_num(errors, nan=np.inf), NEIGHBOURS, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1)
    median = np.median(windows, axis=1)
    return np.asarray(np.isfinite(errors) & (errors > ISOLATED_FACTOR * median))
