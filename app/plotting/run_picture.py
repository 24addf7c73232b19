"""Picture of a run: points or curves with the model, estimates and the last recording (matplotlib)."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from app.identification import points_of_run
from app.plotting.panels import (
    UNCOMFORTABLE,
    axis_label,
    draw_measured,
    draw_reference,
    mark_simulated,
    new_figure,
    threshold_line,
)
from model import Array, Specimen, format_estimate, format_time, shown_unit
from model.response import ABDOMEN_THRESHOLD, PerceptionThreshold, fourier_series, frequency_response
from protocols import aspects_of
from protocols.base import Figure, ModelState
from protocols.runfile import ENTRY_COLUMN, Run, translate_read_errors

LEGEND_ROWS_INSIDE = 10
"""Lines of title and labels up to which a legend is inside the axes; a longer one would hide the curves."""
POINT_COLORS = ("tab:red", "tab:blue", "tab:green", "tab:orange", "tab:purple")


def draw_run(run: Run, path: Path, threshold: PerceptionThreshold = ABDOMEN_THRESHOLD) -> None:
    """Draw a run into a PNG, PDF or SVG file; pictures of simulated runs are marked SIMULATED.

    Raises:
        RunReadError: the run file is damaged.
        OSError: the picture cannot be written.
    """
    with translate_read_errors(run.path):
        figure = run_figure(run, Specimen(), threshold)
    figure.savefig(path)


def run_figure(
    run: Run, specimen: Specimen, threshold: PerceptionThreshold = ABDOMEN_THRESHOLD, layout: str = "constrained"
) -> Any:
    """Return the picture of a run as a matplotlib figure; responses have the perception threshold."""
    panels = [*_panels(run, threshold), (_draw_trace, 1)]
    height_in = 4.2 + 2.8 * sum(height for _, height in panels[:-1]) / 3
    figure = new_figure(figsize=(10, height_in), dpi=110, layout=layout)
    every = figure.subplots(len(panels), 1, height_ratios=[height for _, height in panels])
    for axes, (draw, _) in zip(every, panels, strict=True):
        draw(axes, run, specimen)
    figure.suptitle(
        f"{run.record.title}   {format_time(run.record.start_time, seconds=True)} UTC   {run.record.state}",
        fontsize=11,
        parse_math=False,
    )
    if run.record.simulated:
        mark_simulated(figure)
    return figure


def _panels(run: Run, threshold: PerceptionThreshold) -> list[tuple[Callable[[Any, Run, Specimen], None], float]]:
    """Return the plots above the last recording, with their relative heights."""
    panels: list[tuple[Callable[[Any, Run, Specimen], None], float]] = []
    figures = [*aspects_of(run.record.protocol).figures(points_of_run(run))]
    draw = partial(_draw_figure, threshold=threshold)
    if any(figure.lines or figure.models for figure in figures):
        return [(partial(draw, figure=figure), 3) for figure in figures]
    if curves := run.series():
        panels.append((_draw_curves, 3))
        if all(curve.coherence is not None for curve in curves):
            panels.append((_draw_coherence, 0.8))
    if not curves or len(run.points()[run.record.axes[0]]) > 1:
        panels += [(partial(draw, figure=figure), 2) for figure in figures]
    return panels


def _draw_curves(axes: Any, run: Run, specimen: Specimen) -> None:
    """Draw the curves of the entries; frequency responses with the model's."""
    curves, points = run.series(), run.points()
    amplifier, amplitude_v = run.record.amplifier_map, float(run.record.parameters.get("peak_to_peak_v", 2.0)) / 2
    for colour, curve in zip(_curve_colors(len(curves)), curves, strict=True):
        x, y = curve.x, curve.plotted
        factor, unit = shown_unit(curve.y_axis.unit)
        axes.plot(x, factor * y, "-", color=colour, lw=1.2, label=curve.label or "measured")
        if curve.errors is not None:
            low, high = y - 2 * curve.errors, y + 2 * curve.errors
            axes.fill_between(x, factor * low, factor * high, color=colour, alpha=0.3, lw=0)
        if curve.y_axis.unit == "m/V":
            mass = points["mass"][points[ENTRY_COLUMN] == curve.entry] if "mass" in points else np.empty(0)
            tactor = specimen.acting_tactor
            loaded = replace(tactor, m_add=float(mass[-1])) if mass.size else tactor
            f = x[:: max(x.size // 300, 1)]
            gain = abs(fourier_series("sine", amplitude_v, amplifier.rest_v, amplifier, 1)[1]) / amplitude_v
            axes.plot(f, factor * gain * np.abs(frequency_response(loaded, f)), "--", color=colour, lw=0.9)
        axes.set(xlabel=f"{curve.x_axis.name} ({curve.x_axis.unit})", ylabel=f"{curve.y_axis.name} ({unit})")
    texts = [*map(format_estimate, run.record.estimates)]
    if any(curve.y_axis.unit == "m/V" for curve in curves):
        texts.append("dashed: model")
    _add_legend(axes, texts, 8)
    if all((curve.plotted >= 0).all() for curve in curves):
        axes.set_ylim(0, None)


def _draw_coherence(axes: Any, run: Run, _specimen: Specimen) -> None:
    curves = run.series()
    for colour, curve in zip(_curve_colors(len(curves)), curves, strict=True):
        axes.plot(curve.x, curve.coherence, color=colour, lw=0.8)
    axes.set(xlabel=f"{curves[0].x_axis.name} ({curves[0].x_axis.unit})", ylabel="coherence", ylim=(None, 1.0))
    axes.ticklabel_format(useOffset=False)


def _draw_figure(
    axes: Any, run: Run, specimen: Specimen, figure: Figure, threshold: PerceptionThreshold = ABDOMEN_THRESHOLD
) -> None:
    """Draw a figure of the run's protocol in display units; points that no fit may use are hollow."""
    if not (drawn := figure.points or figure.lines):
        axes.text(0.5, 0.5, "no usable points", ha="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    x_axis, y_axis = drawn[0].x_axis, drawn[0].y_axis
    (over, x_unit), (factor, y_unit) = shown_unit(x_axis.unit), shown_unit(y_axis.unit)
    for color, line in zip(_curve_colors(len(figure.lines)), figure.lines, strict=True):
        axes.plot(over * line.x, factor * line.plotted, "-", color=color, lw=1.2, label=line.label)
    state, grid = ModelState(specimen, run.record.amplifier_map), _model_grid(figure)
    _draw_points(axes, figure, state, grid, (over, factor))
    if figure.model is not None and grid.size and (y := figure.model(state, grid)) is not None:
        axes.plot(over * grid, factor * y, "--", color="tab:blue", lw=1, label="model")
    _draw_comparisons(axes, figure, factor)
    axes.set(xlabel=axis_label(x_axis, x_unit), ylabel=axis_label(y_axis, y_unit))
    if figure.models:
        axes.set(xlim=(0, grid[-1]))
    if figure.has_threshold:
        draw_reference(axes, threshold_line(threshold, grid), UNCOMFORTABLE, "tab:green", 9)
    title = ["dashed: model", *map(format_estimate, run.record.estimates)] if figure.models else []
    small = figure.lines or figure.spans
    _add_legend(axes, title, 8 if small else 9)


def _add_legend(axes: Any, title: Sequence[str], size: int) -> None:
    """Add a legend where anything has a label: inside the axes, or a long one beside them if the layout makes room."""
    if labels := axes.get_legend_handles_labels()[1]:
        is_long = len(title) + len(labels) > LEGEND_ROWS_INSIDE and axes.figure.get_layout_engine() is not None
        place = {"loc": "upper left", "bbox_to_anchor": (1, 1)} if is_long else {}
        axes.legend(title="\n".join(title) or None, fontsize=size, title_fontsize=9, **place)


def _draw_points(axes: Any, figure: Figure, state: ModelState, grid: Array, factors: tuple[float, float]) -> None:
    """Draw each series of points, scaled by the factors of x and y, with its own model where it has one."""
    many = len(figure.points) > len(POINT_COLORS)
    colors = _curve_colors(len(figure.points)) if many else POINT_COLORS[: len(figure.points)]
    for at, (color, series) in enumerate(zip(colors, figure.points, strict=True)):
        marker = figure.markers.get(series.label, "o" if many else "os^Dv"[at])
        size, label = 4 if at else 6, series.label or "measured"
        draw_measured(axes, series.scaled(*factors), label, face=color, fmt=marker, color=color, ms=size)
        if series.label in figure.models and grid.size:
            y = figure.models[series.label](state, grid)
            axes.plot(factors[0] * grid, None if y is None else factors[1] * y, "--", color=color, lw=1)


def _draw_comparisons(axes: Any, figure: Figure, factor: float) -> None:
    """Draw levels and spans to compare with, and set the limits of y."""
    for level in figure.levels:
        axes.axhline(factor * level, color="tab:green", lw=0.8)
    for span, color in zip(figure.spans, _curve_colors(len(figure.spans)), strict=True):
        low, high = (factor * max(value, 1e-4) for value in span[:2])
        axes.axhspan(0.97 * low, 1.03 * high, color=color, alpha=0.15, lw=0)
        axes.text(0.99, (low * high) ** 0.5, span.label, fontsize=7, ha="right", va="center", transform=axes.get_yaxis_transform())  # fmt: skip
    if figure.log_limits:
        axes.set(yscale="log", ylim=tuple(factor * limit for limit in figure.log_limits))
    elif figure.from_zero:
        axes.set(ylim=(0, None))


def _model_grid(figure: Figure) -> Array:
    x = np.concatenate([series.x for series in figure.points]) if figure.points else np.empty(0)
    return figure.model_grid(x) if x.size or figure.grid is not None else x


def _curve_colors(count: int) -> Any:
    from matplotlib import colormaps

    return colormaps["viridis"](np.linspace(0.0, 0.85, count))


def _draw_trace(axes: Any, run: Run, _specimen: Specimen) -> None:
    last = run.trace.last_recording()
    if last is None:
        text = "imported: there are no samples" if run.record.imported else "nothing was recorded"
        axes.text(0.5, 0.5, text, ha="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    last = last.parts()[0]
    shown = min(len(last.displacement_m), round(0.1 * last.rate_hz))
    t = 1e3 * np.arange(shown) / last.rate_hz
    axes.plot(t, 1e6 * last.displacement_m[:shown], color="tab:red", lw=0.8)
    axes.set(xlabel="time (ms)", ylabel=f"{run.record.sensor.quantity} (µ{run.record.sensor.unit})", xlim=(0, t[-1]))
    axes.set_title("last recording", fontsize=9)
    twin = axes.twinx()
    twin.plot(t, last.drive_v[:shown], color="tab:gray", lw=0.8)
    twin.set_ylabel("drive (V)")
