"""Layers of a result curve for the lower plot: residual of its fit, loop less its mean line, phase, coherence."""

from collections.abc import Sequence

import numpy as np

from model import Array, shown_unit
from protocols.base import Series

NOTHING, RESIDUAL, LESS_MEAN, PHASE, COHERENCE = "nothing", "residual", "less mean", "phase", "coherence"
LAYER_TITLES = {RESIDUAL: "Residual", LESS_MEAN: "Less mean", PHASE: "Phase, °", COHERENCE: "Coherence"}
"""Titles of the vertical axis of the lower panel, without units that depend on the curve."""

LAYER_LABELS = {
    NOTHING: "no lower plot",
    RESIDUAL: "lower plot: residual of the fit",
    LESS_MEAN: "lower plot: loop less its mean line",
    PHASE: "lower plot: phase",
    COHERENCE: "lower plot: coherence",
}
ISOLATED_FACTOR, NEIGHBOURS = 4.0, 4
"""A line whose error is so many times the median of so many neighbours on either side has an error bar instead of a band."""


def layers_of(curves: Sequence[Series]) -> tuple[str, ...]:
    """Return the layers of curves, the initial one first."""
    if not curves:
        return (NOTHING,)
    if any(curve.is_loop for curve in curves):
        return LESS_MEAN, NOTHING
    last = curves[-1]
    has = [layer for layer, there in ((COHERENCE, last.coherence is not None), (PHASE, last.is_complex)) if there]
    if any(curve.fit is not None for curve in curves):
        has.append(RESIDUAL)
    return (*has, NOTHING)


def layer_series(curve: Series, layer: str) -> Series | None:
    """Return a layer of a curve in display units with the errors of its y; None where it has no such layer."""
    shown = displayed(curve)
    if layer == RESIDUAL and shown.fit is not None:
        return Series(shown.x, shown.plotted - shown.fit, shown.errors, name=curve.title)
    if layer == LESS_MEAN and curve.is_loop:
        from protocols.signals import subtract_mean_line

        return Series(shown.x, subtract_mean_line(shown.x, shown.plotted), shown.errors, name=curve.title)
    if layer == PHASE and (phase := curve.phase) is not None:
        there = np.isfinite(phase)
        degrees = np.full(phase.size, np.nan)
        degrees[there] = np.degrees(np.unwrap(phase[there]))
        turns = 360.0 * np.round(np.nanmean(degrees[:1]) / 360.0) if there[:1].any() else 0.0
        return Series(shown.x, degrees - turns, name=curve.title)
    if layer == COHERENCE and curve.coherence is not None:
        return Series(shown.x, curve.coherence, name=curve.title)
    return None


def displayed(curve: Series) -> Series:
    """Return a curve in the units of a display."""
    return curve.scaled(*(shown_unit(axis.unit)[0] for axis in (curve.x_axis, curve.y_axis)))


def isolated(errors: Array) -> Array:
    """Return which errors stand out of their neighbours', (N,): a band over them would be a bow tie."""
    padded = np.pad(np.nan_to_num(errors, nan=np.inf), NEIGHBOURS, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1)
    median = np.median(windows, axis=1)
    return np.asarray(np.isfinite(errors) & (errors > ISOLATED_FACTOR * median))
