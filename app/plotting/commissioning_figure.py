"""Picture of a commissioning: the recorded output of each exercise, with its level of rest (matplotlib)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from app.common import minmax_decimate
from app.plotting.panels import mark_simulated, new_figure
from protocols.commissioning import Trace

COLUMNS, DRAWN_COLUMNS = 3, 2000


def draw_commissioning(title: str, traces: Sequence[Trace], rest_v: float, simulated: bool, path: Path) -> None:
    """Draw the recorded outputs into a PNG, PDF or SVG file.

    Raises:
        OSError: the picture cannot be written.
    """
    rows = max(-(-len(traces) // COLUMNS), 1)
    figure = new_figure(figsize=(11, 2.6 * rows + 0.6), dpi=110, layout="constrained")
    panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axes, trace in zip(panels, traces, strict=False):
        times = np.arange(trace.volts.size) / trace.rate_hz
        axes.axhline(rest_v, color="0.6", linewidth=0.8)
        axes.plot(
            *minmax_decimate(times, trace.volts, max(times.size // DRAWN_COLUMNS, 1)), linewidth=0.7, color="#0072B2"
        )
        axes.axvline(trace.stop_s - trace.start_s, color="#D55E00", linewidth=0.8, linestyle="--")
        axes.set_title(trace.name, fontsize=9, parse_math=False)
        axes.set_xlabel("time, s", fontsize=8)
        axes.set_ylabel("amplifier's input, V", fontsize=8)
        axes.tick_params(labelsize=7)
    for axes in panels[len(traces) :]:
        axes.set_axis_off()
    figure.suptitle(title, fontsize=11, parse_math=False)
    if simulated:
        mark_simulated(figure)
    figure.savefig(path)
