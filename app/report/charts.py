"""Drawing a plot into any rectangle of a matplotlib figure: the same for a page of the PDF and for a picture in the HTML.

Colours of Okabe and Ito, which colour-blind readers tell apart; markers and hollow faces say the same in black and white.
"""

from typing import Any

import numpy as np

from app.report.document import MeasuredPoints, PlotPanel, ReportPlot

MODEL_COLOR, LEVEL_COLOR = "#0072B2", "#555555"
POINT_COLORS = ("#D55E00", "#000000", "#009E73", "#CC79A7", "#E69F00")
SMALL_PT, NORMAL_PT = 7.0, 8.0
LEFT_IN, RIGHT_IN, BELOW_IN, ABOVE_IN = 0.62, 0.10, 0.42, 0.22
"""Inches around a pair of axes, for its numbers, labels and title."""
LEGEND_IN = 0.2
"""Above all panels."""
STRIP_SHARE = 0.27
"""Share of a panel's height that its residuals have."""

Box = tuple[float, float, float, float]
"""Left, bottom, width, height in inches."""


def draw_plot(figure: Any, plot: ReportPlot, box: Box, legend: float = LEGEND_IN) -> None:
    """Draw the panels of a plot into a box of the figure, row by row from the top.

    One legend of that height (inches; 0: none) above says what all panels show.
    """
    left, bottom, width, height = box
    w, h = width / plot.columns, (height - legend) / plot.rows
    shown: dict[str, Any] = {}
    for i, panel in enumerate(plot.panels):
        row, column = divmod(i, plot.columns)
        axes = _draw_panel(figure, panel, (left + column * w, bottom + height - legend - (row + 1) * h, w, h))
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    if not legend:
        return
    inches = figure.get_size_inches()
    figure.legend(
        list(shown.values()), list(shown), fontsize=SMALL_PT, frameon=False, ncols=min(len(shown), 4), loc="lower left",
        bbox_to_anchor=((left + LEFT_IN) / inches[0], (bottom + height - legend) / inches[1]), borderaxespad=0.0, borderpad=0.1,
        handlelength=1.6, columnspacing=1.4,
    )  # fmt: skip


def _draw_panel(figure: Any, panel: PlotPanel, box: Box) -> Any:
    left, bottom, width, height = box
    above = ABOVE_IN if panel.title else 0.06
    inner = (left + LEFT_IN, bottom + BELOW_IN, width - LEFT_IN - RIGHT_IN, height - BELOW_IN - above)
    with_model = [d for d in panel.points if d.model_y is not None and (d.usable & np.isfinite(d.y)).any()]
    strip = STRIP_SHARE * inner[3] if with_model else 0.0
    gap = 0.07 if with_model else 0.0
    axes = _add_axes(figure, (inner[0], inner[1] + strip + gap, inner[2], inner[3] - strip - gap))
    _draw_lines(axes, panel)
    lowest = axes
    if with_model:
        lowest = _add_axes(figure, (inner[0], inner[1], inner[2], strip))
        lowest.sharex(axes)
        axes.tick_params(labelbottom=False)
        _draw_residuals(lowest, panel)
    lowest.set_xlabel(panel.x_label, fontsize=NORMAL_PT)
    axes.set_ylabel(panel.y_label, fontsize=NORMAL_PT)
    for each in {axes, lowest}:
        each.yaxis.set_label_coords(-0.48 / inner[2], 0.5)
    axes.set_title(panel.title, fontsize=NORMAL_PT, loc="left", pad=3, y=1.0)
    return axes


def _add_axes(figure: Any, box: Box) -> Any:
    width, height = figure.get_size_inches()
    axes = figure.add_axes((box[0] / width, box[1] / height, box[2] / width, box[3] / height))
    axes.tick_params(labelsize=SMALL_PT, length=2.5)
    axes.grid(color="#dddddd", lw=0.5)
    axes.set_axisbelow(True)
    axes.patch.set_visible(False)  # what is written across the page must be seen here too
    axes.set_title("", y=1.0)  # a title that is told where to stand need not be looked for a place
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return axes


def _draw_lines(axes: Any, panel: PlotPanel) -> None:
    for line in panel.lines:
        if line.lower is not None and line.upper is not None:
            axes.fill_between(line.x, line.lower, line.upper, color=MODEL_COLOR, alpha=0.3, lw=0)
        axes.plot(line.x, line.y, line.style, color=MODEL_COLOR, lw=1.1, label=line.label)
    for colour, dots in zip(POINT_COLORS * len(panel.points), panel.points, strict=False):
        finite = np.isfinite(dots.y)
        for at, face, words in ((finite & dots.usable, colour, ""), (finite & ~dots.usable, "white", ", flagged")):
            if at.any():
                _draw_error_bars(axes, dots, at, dots.y, colour, face, dots.label + words)
    if panel.reference_level is not None:
        value, words = panel.reference_level
        axes.axhline(value, color=LEVEL_COLOR, lw=0.9, ls=(0, (6, 2)))
        axes.annotate(
            words, (0, value), (2, 1.5), xycoords=axes.get_yaxis_transform(), textcoords="offset points",
            ha="left", va="bottom", fontsize=SMALL_PT - 0.5, color=LEVEL_COLOR,
        )  # fmt: skip
    if panel.from_zero and all((d.y[d.usable] >= 0).all() for d in panel.points):
        axes.set_ylim(0, None)
    axes.margins(y=0.08)


def _draw_error_bars(
    axes: Any, points: MeasuredPoints, at: Any, y: Any, color: str, face: str, label: str | None
) -> None:
    half = np.where(np.isfinite(points.half_interval[at]), points.half_interval[at], 0.0)
    axes.errorbar(
        points.x[at], y[at], half, fmt=points.marker, ms=3.4, mew=0.8, mec=color, mfc=face, ecolor=color, elinewidth=0.8,
        capsize=0, label=label, zorder=3,
    )  # fmt: skip


def _draw_residuals(axes: Any, panel: PlotPanel) -> None:
    axes.axhline(0, color=MODEL_COLOR, lw=1.0)
    for line in panel.lines:
        if line.lower is not None and line.upper is not None:
            axes.fill_between(line.x, line.lower - line.y, line.upper - line.y, color=MODEL_COLOR, alpha=0.3, lw=0)
    for colour, dots in zip(POINT_COLORS * len(panel.points), panel.points, strict=False):
        if dots.model_y is not None:
            at = np.isfinite(dots.y) & np.isfinite(dots.model_y) & dots.usable
            if at.any():
                _draw_error_bars(axes, dots, at, dots.y - dots.model_y, colour, colour, None)
    axes.set_ylabel("Δ", fontsize=NORMAL_PT)
    axes.margins(y=0.15)
    low, high = axes.get_ylim()
    reach = max(abs(low), abs(high))
    axes.set_ylim(-reach, reach)
