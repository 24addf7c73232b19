"""A picture of a finished run: the response on the model's curve, the last recording, what was identified."""

from pathlib import Path
from typing import Any

import numpy as np

from app.config import AmplifierTable
from app.words import quantity
from model.parameters import Tactor
from model.response import amplifier_response
from protocols.quality import Quality
from protocols.runreader import Run, intact

RESPONSE = {"frequency", "peak_to_peak", "peak_to_peak_errors", "fundamental", "fundamental_errors"}
"""Columns that are drawn on the model's curve."""

THRESHOLD_M = 50e-6
"""Discrimination threshold of the skin on the abdomen below 250 Hz (paper, Sec. I)."""


def draw_run(run: Run, path: Path, tactor: Tactor | None = None) -> None:
    """Draw a run into a PNG, PDF or SVG file; SIMULATED is written across it where it is.

    Raises:
        RunError: the run file is damaged.
        OSError: the picture cannot be written.
    """
    with intact(run.path):
        figure = figure_of(run, tactor or Tactor())
    figure.savefig(path)


def figure_of(run: Run, tactor: Tactor) -> Any:
    """The picture of a run as a matplotlib figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 7), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    response, trace = figure.subplots(2, 1, height_ratios=[3, 1])
    (_draw_response if run.points().keys() >= RESPONSE else _draw_points)(response, run, tactor)
    _draw_trace(trace, run)
    figure.suptitle(f"{run.title}   {run.start_time[:19]} UTC   {run.state}", fontsize=11)
    if run.simulated:
        figure.text(0.5, 0.5, "SIMULATED", fontsize=64, color="red", alpha=0.12, ha="center", va="center", rotation=25)
    return figure


def _draw_response(axes: Any, run: Run, tactor: Tactor) -> None:
    points = run.points()
    f = points["frequency"]
    amplitude_v = float(run.parameters["peak_to_peak_v"]) / 2
    top = max(float(f.max()) if f.size else 250.0, 250.0)
    curve_f = np.linspace(5.0, 1.05 * top, 500)
    amplifier = AmplifierTable.model_validate(run.configuration.get("amplifier", {})).map  # as it was then
    curve = amplifier_response(tactor, curve_f, amplitude_v, amplifier.rest_v, amplifier)
    axes.plot(curve_f, 1e6 * curve.peak_to_peak, "-", color="tab:blue", lw=1.2, label="model, max - min")
    axes.plot(curve_f, 2e6 * np.abs(curve.fundamental), "--", color="tab:blue", lw=1, label="model, 2 x fundamental")
    good = np.array([Quality(int(q)).usable for q in points["quality"]], bool)
    for shown, face, words in ((good, "tab:red", ""), (~good, "none", ", flagged")):
        if shown.any():
            axes.errorbar(
                f[shown], 1e6 * points["peak_to_peak"][shown], 1e6 * points["peak_to_peak_errors"][shown],
                fmt="o", ms=6, mfc=face, mec="tab:red", ecolor="tab:red", label="measured, max - min" + words,
            )  # fmt: skip
            axes.errorbar(
                f[shown], 2e6 * points["fundamental"][shown], 2e6 * points["fundamental_errors"][shown],
                fmt="s", ms=4, mfc=face, mec="tab:orange", ecolor="tab:orange",
                label="measured, 2 x fundamental" + words,
            )  # fmt: skip
    axes.axhline(1e6 * THRESHOLD_M, color="tab:green", lw=1)
    axes.text(
        0.99 * curve_f[-1], 1e6 * THRESHOLD_M, "50 µm: felt on the abdomen", color="tab:green", ha="right", va="bottom"
    )
    axes.set(xlabel="frequency (Hz)", ylabel="displacement of the centre (µm)", xlim=(0, curve_f[-1]), ylim=(0, None))
    found = [f"{e.name} {quantity(e.value, e.standard_error, e.unit)}" for e in run.estimates()]
    axes.legend(title="\n".join(found) or None, fontsize=9, title_fontsize=9, loc="upper right")


def _draw_points(axes: Any, run: Run, _tactor: Tactor) -> None:
    """The points of any protocol over the axis it names, SI."""
    points, units, (x, y) = run.points(), run.units(), run.axes
    errors = points.get(f"{y}_errors")
    axes.errorbar(points[x], points[y], errors, fmt="o", color="tab:red", label="measured")
    axes.set(xlabel=f"{x} ({units[x]})", ylabel=f"{y} ({units[y]})")
    axes.legend(fontsize=9)


def _draw_trace(axes: Any, run: Run) -> None:
    recordings = list(run.recordings())
    if not recordings:
        axes.text(0.5, 0.5, "nothing was recorded", ha="center", transform=axes.transAxes)
        return
    last = recordings[-1]
    shown = min(len(last.displacement_m), round(0.1 * last.rate_hz))
    t = 1e3 * np.arange(shown) / last.rate_hz
    axes.plot(t, 1e6 * last.displacement_m[:shown], color="tab:red", lw=0.8)
    axes.set(xlabel="time (ms)", ylabel="displacement (µm)", xlim=(0, t[-1]))
    axes.set_title("last recording", fontsize=9)
    twin = axes.twinx()
    twin.plot(t, last.drive_v[:shown], color="tab:gray", lw=0.8)
    twin.set_ylabel("drive (V)")
