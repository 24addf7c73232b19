"""Picture of a run: points or curves with the model, estimates and the last recording (matplotlib)."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from app.identification import points_of_run
from app.plotting.panels import draw_measured, draw_reference, new_figure
from app.plotting.threshold_line import UNCOMFORTABLE, threshold_line
from model import AmplifierMap, Array, Series, SeriesAxis, Specimen, format_estimate, shown_unit
from model.response import (
    ABDOMEN_THRESHOLD,
    PerceptionThreshold,
    driven_amplitudes,
    fourier_series,
    frequency_response,
    lag_factor,
)
from protocols import usable_mask
from protocols.base import Figure, ModelState
from protocols.registry import aspects_of
from protocols.runfile.reader import Run, translate_read_errors
from protocols.runfile.schema import ENTRY_COLUMN

RESPONSE_COLUMNS = {"frequency", "peak_to_peak", "peak_to_peak_errors", "fundamental", "fundamental_errors"}
"""Columns that are drawn on the model's curve."""
POINT_COLORS = ("tab:red", "tab:blue", "tab:green", "tab:orange", "tab:purple")


def draw_run(
    run: Run, path: Path, specimen: Specimen | None = None, threshold: PerceptionThreshold = ABDOMEN_THRESHOLD
) -> None:
    """Draw a run into a PNG, PDF or SVG file; pictures of simulated runs are marked SIMULATED.

    Raises:
        RunReadError: the run file is damaged.
        OSError: the picture cannot be written.
    """
    with translate_read_errors(run.path):
        figure = run_figure(run, specimen or Specimen(), threshold)
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
        f"{run.record.title}   {run.record.start_time[:19]} UTC   {run.record.state}", fontsize=11, parse_math=False
    )
    if run.record.simulated:
        figure.text(0.5, 0.5, "SIMULATED", fontsize=64, color="red", alpha=0.12, ha="center", va="center", rotation=25)
    return figure


def _panels(run: Run, threshold: PerceptionThreshold) -> list[tuple[Callable[[Any, Run, Specimen], None], float]]:
    """Return the plots above the last recording, with their relative heights."""
    points = run.points()
    if points.keys() >= RESPONSE_COLUMNS | {"elongation"}:
        return [(partial(_draw_series, threshold=threshold), 3)]
    if points.keys() >= RESPONSE_COLUMNS:
        return [(partial(_draw_response, threshold=threshold), 3)]
    panels: list[tuple[Callable[[Any, Run, Specimen], None], float]] = []
    figures = [*aspects_of(run.record.protocol).figures(points_of_run(run))]
    if any(figure.lines for figure in figures):
        return [(partial(_draw_figure, figure=figure), 3) for figure in figures]
    if curves := run.series():
        panels.append((_draw_curves, 3))
        if all(curve.coherence is not None for curve in curves):
            panels.append((_draw_coherence, 0.8))
    if not curves or len(points[run.record.axes[0]]) > 1:
        panels += [(partial(_draw_figure, figure=figure), 2) for figure in figures]
    return panels


def _draw_response(axes: Any, run: Run, specimen: Specimen, threshold: PerceptionThreshold) -> None:
    points = run.points()
    f = points["frequency"]
    amplitude_v = float(run.record.parameters["peak_to_peak_v"]) / 2
    top = max(float(f.max()) if f.size else 250.0, 250.0)
    curve_f = np.linspace(5.0, 1.05 * top, 500)
    amplifier = run.record.amplifier_map
    free = replace(specimen, membrane=None, delta=0.0)
    whole, fundamental = _driven(free, curve_f, amplitude_v, amplifier)
    axes.plot(curve_f, 1e6 * whole, "-", color="tab:blue", lw=1.2, label="model, max - min")
    axes.plot(curve_f, 2e6 * fundamental, "--", color="tab:blue", lw=1, label="model, 2 x fundamental")
    good = usable_mask(points["quality"])
    for name, scale, label, marker, size, color in (  # an imported table may have one of them only
        ("peak_to_peak", 1e6, "measured, max - min", "o", 6, "tab:red"),
        ("fundamental", 2e6, "measured, 2 x fundamental", "s", 4, "tab:orange"),
    ):
        measured = Series(f, points[name], points[f"{name}_errors"], usable=good).scaled(1.0, scale)
        draw_measured(axes, measured, label, fmt=marker, ms=size, mec=color, ecolor=color)
    axes.set(xlabel="frequency (Hz)", ylabel="displacement of the centre (µm)", xlim=(0, curve_f[-1]), ylim=(0, None))
    draw_reference(axes, threshold_line(threshold, curve_f), UNCOMFORTABLE, "tab:green", 9)
    found = "\n".join(map(format_estimate, run.record.estimates))
    axes.legend(title=found or None, fontsize=9, title_fontsize=9, loc="best")


def _driven(
    specimen: Specimen, frequency_hz: Array, amplitude_v: float, amplifier: AmplifierMap
) -> tuple[Array, Array]:
    """Return max - min and amplitude of the fundamental, m, with the lag of the MFC."""
    skin = specimen.skin if specimen.membrane is not None else None
    whole, fundamental = driven_amplitudes(specimen.acting_tactor, frequency_hz, amplitude_v, amplifier, skin)
    lag = np.abs(lag_factor(specimen.hysteresis, specimen.creep, frequency_hz, amplitude_v, amplifier=amplifier))
    return whole * lag, fundamental * lag


def _draw_series(axes: Any, run: Run, specimen: Specimen, threshold: PerceptionThreshold) -> None:
    """Draw dwells at several elongations, each in one color with its model curve."""
    from model import Membrane

    points = run.points()
    good = usable_mask(points["quality"])
    amplifier, amplitude_v = run.record.amplifier_map, float(run.record.parameters["peak_to_peak_v"]) / 2
    parts = np.unique(points["part"])
    curve_f = np.linspace(5.0, 1.05 * max(float(points["frequency"].max(initial=0.0)), 100.0), 300)
    for colour, part in zip(_curve_colors(len(parts)), parts, strict=True):
        of_part = points["part"] == part
        elongation = float(points["elongation"][of_part][0])
        free = np.isnan(elongation)
        membrane = specimen.membrane or Membrane()
        pressed = replace(
            specimen, membrane=None if free else membrane, delta=0.0 if free else elongation / membrane.L_m
        )
        whole, _ = _driven(pressed, curve_f, amplitude_v, amplifier)
        axes.plot(curve_f, 1e6 * whole, "--", color=colour, lw=0.9)
        label = "free" if free else f"{1e3 * elongation:.2f} mm"
        measured = Series(points["frequency"], points["peak_to_peak"], points["peak_to_peak_errors"], usable=good)
        shown = measured.at(of_part).scaled(1.0, 1e6)
        draw_measured(axes, shown, label, face=colour, flagged="", fmt="o", ms=5, color=colour)
    axes.set(
        xlabel="frequency (Hz)",
        ylabel="peak-to-peak displacement of the centre (µm)",
        xlim=(0, curve_f[-1]),
        ylim=(0, None),
    )
    draw_reference(axes, threshold_line(threshold, curve_f), UNCOMFORTABLE, "tab:green", 9)
    axes.legend(title="measured; dashed: model", fontsize=8, title_fontsize=9, ncols=2)


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
    found = [*map(format_estimate, run.record.estimates)]
    if any(curve.y_axis.unit == "m/V" for curve in curves):
        found.append("dashed: model")
    axes.legend(title="\n".join(found) or None, fontsize=8, title_fontsize=9)
    if all((curve.plotted >= 0).all() for curve in curves):
        axes.set_ylim(0, None)


def _draw_coherence(axes: Any, run: Run, _specimen: Specimen) -> None:
    curves = run.series()
    for colour, curve in zip(_curve_colors(len(curves)), curves, strict=True):
        axes.plot(curve.x, curve.coherence, color=colour, lw=0.8)
    axes.set(xlabel=f"{curves[0].x_axis.name} ({curves[0].x_axis.unit})", ylabel="coherence", ylim=(None, 1.0))
    axes.ticklabel_format(useOffset=False)


def _draw_figure(axes: Any, run: Run, specimen: Specimen, figure: Figure) -> None:
    """Draw a figure of the run's protocol in display units; points that no fit may use are hollow."""
    x_axis, y_axis = (figure.points or figure.lines)[0].x_axis, (figure.points or figure.lines)[0].y_axis
    (over, x_unit), (factor, y_unit) = shown_unit(x_axis.unit), shown_unit(y_axis.unit)
    for color, line in zip(_curve_colors(len(figure.lines)), figure.lines, strict=True):
        axes.plot(over * line.x, factor * line.plotted, "-", color=color, lw=1.2, label=line.label)
    for at, series in enumerate(figure.points):
        color, marker = POINT_COLORS[at % len(POINT_COLORS)], figure.markers.get(series.label, "os^Dv"[at % 5])
        shown = series.scaled(over, factor)
        draw_measured(axes, shown, series.label or "measured", face=color, fmt=marker, color=color)
    _draw_model(axes, run, specimen, figure, over, factor)
    for level in figure.levels:
        axes.axhline(factor * level, color="tab:green", lw=0.8)
    for span, color in zip(figure.spans, _curve_colors(len(figure.spans)), strict=True):
        low, high = (factor * max(value, 1e-4) for value in span[:2])
        axes.axhspan(0.97 * low, 1.03 * high, color=color, alpha=0.15, lw=0)
        axes.text(0.99, (low * high) ** 0.5, span.label, fontsize=7, ha="right", va="center", transform=axes.get_yaxis_transform())  # fmt: skip
    axes.set(xlabel=_axis_label(x_axis, x_unit), ylabel=_axis_label(y_axis, y_unit))
    if figure.log_limits:
        axes.set(yscale="log", ylim=tuple(factor * limit for limit in figure.log_limits))
    axes.legend(fontsize=8 if figure.lines or figure.spans else 9)


def _draw_model(axes: Any, run: Run, specimen: Specimen, figure: Figure, over: float, factor: float) -> None:
    """Draw the model's curve of a figure, where it has one and the specimen can be computed."""
    x = np.concatenate([series.x for series in figure.points]) if figure.points else np.empty(0)
    if figure.model is None or not x.size:
        return
    grid = figure.model_grid(x)
    y = figure.model(ModelState(specimen, run.record.amplifier_map), grid)
    if y is not None:
        axes.plot(over * grid, factor * y, "--", color="tab:blue", lw=1, label="model")


def _curve_colors(count: int) -> Any:
    from matplotlib import colormaps

    return colormaps["viridis"](np.linspace(0.0, 0.85, count))


def _axis_label(axis: SeriesAxis, unit: str) -> str:
    name = axis.description or axis.name.replace("_", " ")
    return f"{name} ({unit})" if unit else name


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
    axes.set(xlabel="time (ms)", ylabel="displacement (µm)", xlim=(0, t[-1]))
    axes.set_title("last recording", fontsize=9)
    twin = axes.twinx()
    twin.plot(t, last.drive_v[:shown], color="tab:gray", lw=0.8)
    twin.set_ylabel("drive (V)")
