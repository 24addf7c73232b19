"""Figure panels of model lines, error bands and measured points with error bars, drawn with matplotlib.

Colors of Okabe and Ito, which colour-blind readers can distinguish; markers and hollow faces carry the same information in
black and white.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np

from model import COVERAGE_FACTOR_95, Array, Role, Series, SeriesAxis
from model.response import UNCOMFORTABLE_HZ, PerceptionThreshold


@dataclass(frozen=True, slots=True)
class StackedBar:
    """A horizontal bar of named shares whose sum is 1."""

    label: str
    shares: tuple[tuple[str, float], ...]
    note: str = ""
    """At its end."""


class ShadedRange(NamedTuple):
    """A band of x that begins between two values, and its label."""

    low: float
    high: float
    label: str


UNCOMFORTABLE = ShadedRange(*UNCOMFORTABLE_HZ, "uncomfortable")


def threshold_line(threshold: PerceptionThreshold, frequency_hz: Array) -> Series:
    """Return the line of a perception threshold in µm over rising frequencies; one value if it is level."""
    f = frequency_hz[frequency_hz > 0]
    places = f[:1] if len(threshold.frequency_hz) == 1 else f
    y_um = 1e6 * np.atleast_1d(threshold.amplitude_at(places))
    return Series(places, y_um, label=threshold.line_label, role=Role.REFERENCE)


def mark_simulated(figure: Any) -> None:
    """Write SIMULATED across a figure."""
    figure.text(0.5, 0.5, "SIMULATED", fontsize=64, color="red", alpha=0.12, ha="center", va="center", rotation=25)


@dataclass(frozen=True, slots=True)
class PlotPanel:
    """One pair of axes in display units, with a residual strip where points have model values."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[Series, ...] = ()
    """Of the model, with their bands."""
    points: tuple[Series, ...] = ()
    """With error bars of 95 %; hollow where not usable. The residual strip shows the difference from their fit, the model's values."""
    reference: Series | None = None
    """A labelled line to compare with; level if it has one value."""
    shaded: ShadedRange | None = None
    from_zero: bool = True
    unit: str = ""
    """Unit of y and of the residuals."""
    markers: Sequence[str] = "os^Dv"
    """Of the points, in turn."""
    styles: Sequence[Any] = "-"
    """Of the lines, in turn."""
    own_legend: bool = False
    """Lines in colors of their own, with a legend of these axes instead of the plot's."""
    bars: tuple[StackedBar, ...] = ()
    """Horizontal bars, from the top; with them there are no lines and points."""


@dataclass(frozen=True, slots=True)
class ReportPlot:
    """Panels side by side, `columns` in a row, with a legend and a caption."""

    title: str
    panels: tuple[PlotPanel, ...]
    caption: str = ""
    columns: int = 1
    row_height_in: float = 2.25

    @property
    def rows(self) -> int:
        return -(-len(self.panels) // self.columns)

    def without_residuals(self) -> "ReportPlot":
        """Return the plot with all of its height for the curves."""
        panels = (replace(p, points=tuple(replace(dots, fit=None) for dots in p.points)) for p in self.panels)
        return replace(self, panels=tuple(panels), caption=self.caption.removeprefix(RESIDUALS_NOTE))


MODEL_COLOR, LEVEL_COLOR, SHADE_COLOR = "#0072B2", "#555555", "#B8860B"
LINE_COLORS = ("#0072B2", "#D55E00", "#000000", "#009E73", "#CC79A7")
POINT_COLORS = ("#D55E00", "#000000", "#009E73", "#CC79A7", "#E69F00")
SMALL_PT, NORMAL_PT = 8.0, 8.5
"""Nothing in a report is smaller than 8 pt."""
LEFT_IN, RIGHT_IN, BELOW_IN, ABOVE_IN = 0.66, 0.10, 0.44, 0.24
"""Margins around a pair of axes for tick labels, axis labels and title."""
LEGEND_IN = 0.2
"""Height of a row of the legend above all panels."""
LEGEND_COLUMNS, LEGEND_WIDTH_IN, CHARACTER_IN, HANDLE_IN = 4, 6.4, 0.06, 0.42
"""Most columns and width of the legend, mean width of a character, and width of a symbol with its gap."""
LEGEND_ROW_IN, MOST_LEGEND_SHARE = 1.25 * SMALL_PT / 72, 0.7
"""Height of a row of a legend inside axes, and the largest share of their height for it."""
RESIDUALS_NOTE = "Δ: measured less model. "
"""Begin of a caption that states the strip of residuals."""
FLAGGED = ", flagged"
"""Addition to the label of points that no fit may use."""
STRIP_SHARE = 0.27
"""Share of a panel's height that the residual strip takes."""
LOW_AXES_IN = 1.1
"""Height of axes that the name of a shaded range does not fit into when it stands."""

BAR_COLORS = ("#9ad0f5", "#f3c77b", "#8fd6bd", "#e7b3d0", "#f0e68c", "#f2a285", "#c9c9e8")
"""Of the shares of stacked bars, the largest first; light, so that a name in it is legible."""
BAR_REST_COLOR = "#d9d9d9"
BAR_RIGHT = 1.5
"""Right end of the axis of stacked bars: behind 1 is their note."""
BAR_CHARACTER_SHARE = 0.0145
"""Share that is as wide as a character of its name."""

Box = tuple[float, float, float, float]
"""Left, bottom, width, height in inches."""


def axis_label(axis: SeriesAxis, unit: str) -> str:
    """Return the description of an axis, or its name, with the unit in which it is drawn."""
    name = axis.description or axis.name.replace("_", " ")
    return f"{name} ({unit})" if unit else name


def new_figure(**options: Any) -> Any:
    """Return an empty matplotlib figure that is drawn without a window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    return FigureCanvasAgg(Figure(**options)).figure


def legend_height_in(plot: ReportPlot) -> float:
    """Return the height of the legend above the panels; 0 for none."""
    labels = {line.label for panel in plot.panels for line in panel.lines if not panel.own_legend}
    labels |= {name for panel in plot.panels for name in _unnamed(panel.bars)}
    for points in (points for panel in plot.panels for points in panel.points):
        shown = np.isfinite(points.y)
        labels |= {points.label} if (shown & points.fit_rows).any() else set()
        labels |= {points.label + FLAGGED} if (shown & ~points.fit_rows).any() else set()
    labels -= {""}
    return LEGEND_IN * -(-len(labels) // _legend_columns(labels)) if labels else 0.0


def _legend_columns(labels: Collection[str]) -> int:
    """Return the number of columns of a legend that fits beside the margin of a page."""
    widest = CHARACTER_IN * max(map(len, labels)) + HANDLE_IN
    return max(1, min(len(labels), LEGEND_COLUMNS, int(LEGEND_WIDTH_IN / widest)))


def describe_plot(plot: ReportPlot) -> str:
    """Return the content of a plot as text for readers who do not see it."""
    texts = []
    for panel in plot.panels:
        if panel.bars:
            bars = (
                f"{bar.label}: {', '.join(f'{name} {100 * share:.0f} %' for name, share in bar.shares)}; {bar.note}"
                for bar in panel.bars
            )
            texts.append(". ".join(bars))
            continue
        named = dict.fromkeys(each.label for each in (*panel.lines, *panel.points) if each.label)
        ranges = [
            f"{p.label}: {np.isfinite(p.y).sum()} points, {np.nanmin(p.y):.4g} to {np.nanmax(p.y):.4g}"
            for p in panel.points
            if np.isfinite(p.y).any()
        ]
        texts.append(
            ": ".join(
                filter(
                    None,
                    (panel.title, f"{panel.y_label} over {panel.x_label}; {', '.join(named)}. {'; '.join(ranges)}"),
                )
            )
        )
    return f"{plot.title}. {'. '.join(texts)}"


def draw_plot(figure: Any, plot: ReportPlot, box: Box) -> None:
    """Draw the panels of a plot into a box of the figure, row by row from the top.

    One legend above the panels covers all of them.
    """
    left, bottom, width, height = box
    legend = legend_height_in(plot)
    w, h = width / plot.columns, (height - legend) / plot.rows
    shown: dict[str, Any] = {}
    for i, panel in enumerate(plot.panels):
        row, column = divmod(i, plot.columns)
        axes = _draw_panel(figure, panel, (left + column * w, bottom + height - legend - (row + 1) * h, w, h))
        if panel.own_legend:
            rows_in = LEGEND_ROW_IN * (len(panel.lines) + 0.5)
            share = rows_in / (axes.get_position().height * figure.get_size_inches()[1])
            axes.set_ylim(0, axes.get_ylim()[1] / (1 - min(share, MOST_LEGEND_SHARE)))
            axes.legend(
                fontsize=SMALL_PT,
                frameon=False,
                loc="upper left",
                borderaxespad=0.1,
                labelspacing=0.15,
                handlelength=2.2,
            )
            continue
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    if not shown:
        return
    inches = figure.get_size_inches()
    figure.legend(
        list(shown.values()), list(shown), fontsize=SMALL_PT, frameon=False, ncols=_legend_columns(shown), loc="lower left",
        bbox_to_anchor=((left + LEFT_IN) / inches[0], (bottom + height - legend) / inches[1]), borderaxespad=0.0, borderpad=0.1,
        handlelength=1.6, columnspacing=1.4,
    )  # fmt: skip


def _bar_colors(bars: Sequence[StackedBar]) -> dict[str, str]:
    """Return the colors of the named shares by name, the largest sum first."""
    sums: dict[str, float] = {}
    for name, share in (each for bar in bars for each in bar.shares):
        sums[name] = sums.get(name, 0.0) + share
    return dict(zip(sorted(sums, key=lambda name: -sums[name]), BAR_COLORS, strict=False))


def _has_name(name: str, share: float) -> bool:
    """Return whether a piece of a bar is wide enough for its name and share."""
    return share > BAR_CHARACTER_SHARE * (len(f"{name} {100 * share:.0f} %") + 1)


def _unnamed(bars: Sequence[StackedBar]) -> list[str]:
    """Return the colored shares that have their name in no bar."""
    named = {name for bar in bars for name, share in bar.shares if _has_name(name, share)}
    return [name for name in _bar_colors(bars) if name not in named]


def _draw_bars(axes: Any, bars: Sequence[StackedBar]) -> None:
    """Draw stacked bars with the name of each share in it, where it is wide enough."""
    colors = _bar_colors(bars)
    for name in _unnamed(bars):
        axes.barh(0, 0, color=colors[name], label=name)
    for at, bar in enumerate(bars):
        left = 0.0
        for name, share in bar.shares:
            axes.barh(
                at, share, left=left, height=0.72, color=colors.get(name, BAR_REST_COLOR), edgecolor="white", lw=0.8
            )
            if _has_name(name, share):
                text = f"{name} {100 * share:.0f} %"
                axes.text(left + share / 2, at, text, ha="center", va="center", fontsize=SMALL_PT)
            left += share
        axes.text(1.01, at, bar.note, ha="left", va="center", fontsize=SMALL_PT)
    axes.set_yticks(range(len(bars)), [bar.label for bar in bars])
    axes.set_ylim(len(bars) - 0.5, -0.5)
    axes.set_xlim(0, BAR_RIGHT)
    axes.set_xticks((0, 0.25, 0.5, 0.75, 1), ("0", "25 %", "50 %", "75 %", "100 %"))
    axes.spines["bottom"].set_bounds(0, 1)
    axes.grid(visible=False)


def _draw_panel(figure: Any, panel: PlotPanel, box: Box) -> Any:
    left, bottom, width, height = box
    above = ABOVE_IN if panel.title else 0.06
    inner = (left + LEFT_IN, bottom + BELOW_IN, width - LEFT_IN - RIGHT_IN, height - BELOW_IN - above)
    with_model = [d for d in panel.points if d.fit is not None and (d.fit_rows & np.isfinite(d.y)).any()]
    strip = STRIP_SHARE * inner[3] if with_model else 0.0
    gap = 0.07 if with_model else 0.0
    axes = _add_axes(figure, (inner[0], inner[1] + strip + gap, inner[2], inner[3] - strip - gap))
    if panel.bars:
        _draw_bars(axes, panel.bars)
        axes.set_xlabel(panel.x_label, fontsize=NORMAL_PT)
        axes.set_title(panel.title, fontsize=NORMAL_PT, loc="left", pad=3, y=1.0)
        return axes
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
    axes.patch.set_visible(False)  # the SIMULATED mark across the page must be visible behind the axes
    axes.set_title("", y=1.0)  # a fixed position avoids the automatic placement
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def _draw_lines(axes: Any, panel: PlotPanel) -> None:
    colors = LINE_COLORS if panel.own_legend else (MODEL_COLOR,)
    for style, color, line in zip(cycle(panel.styles), cycle(colors), panel.lines, strict=False):
        if line.band is not None:
            axes.fill_between(line.x, *line.band, color=MODEL_COLOR, alpha=0.3, lw=0)
        axes.plot(line.x, line.y, ls=style, color=color, lw=1.3 if panel.own_legend else 1.1, label=line.label)
    for color, marker, dots in _symbols(panel):
        draw_measured(
            axes,
            dots,
            dots.label,
            face=color,
            hollow="white",
            coverage=COVERAGE_FACTOR_95,
            **_error_bar_style(marker, color),
        )
    if panel.reference is not None:
        draw_reference(axes, panel.reference, panel.shaded)
    if panel.from_zero and all((d.y[d.fit_rows] >= 0).all() for d in panel.points):
        axes.set_ylim(0, None)
    axes.margins(y=0.08)


def _symbols(panel: PlotPanel) -> Iterator[tuple[str, str, Series]]:
    """Yield color and marker of each series of points."""
    return zip(cycle(POINT_COLORS), cycle(panel.markers), panel.points)


def draw_reference(
    axes: Any, line: Series, shaded: ShadedRange | None = None, color: str = LEVEL_COLOR, size: float = SMALL_PT
) -> None:
    """Draw a line to compare with, level if it has one value, and a shaded range; keep the limits of x that the axes have now."""
    low, high = axes.get_xlim()
    if line.x.size == 1:
        axes.axhline(line.y[0], color=color, lw=0.9, ls=(0, (6, 2)))
    else:
        axes.plot(line.x, line.y, color=color, lw=0.9, ls=(0, (6, 2)))
    axes.annotate(
        line.label, (0, line.y[0]), (2, 1.5), xycoords=axes.get_yaxis_transform(), textcoords="offset points",
        ha="left", va="bottom", fontsize=size, color=color,
    )  # fmt: skip
    if shaded is not None and high > shaded.low:
        for begin in (shaded.low, shaded.high):  # darker from the second on
            if begin < high:
                axes.axvspan(begin, high, color=SHADE_COLOR, alpha=0.1, lw=0, zorder=0)
        lying = axes.get_window_extent().height < LOW_AXES_IN * axes.figure.dpi
        axes.annotate(
            shaded.label, (min(high, shaded.high), 0.99), (-2, 0), xycoords=axes.get_xaxis_transform(),
            textcoords="offset points", ha="right", va="top", fontsize=size, color=SHADE_COLOR, rotation=0 if lying else 90,
        )  # fmt: skip
    axes.set_xlim(low, high)


def draw_measured(
    axes: Any,
    points: Series,
    label: str | None,
    face: Any = "tab:red",
    hollow: str = "none",
    flagged: str = FLAGGED,
    coverage: float = 1.0,
    **style: Any,
) -> None:
    """Draw measured points with bars of `coverage` times their errors; unusable ones are hollow, and labelled."""
    x, y, usable = points.x, points.plotted, points.fit_rows
    bars = coverage * np.nan_to_num(
        np.zeros(x.size) if points.errors is None else points.errors, posinf=0.0, neginf=0.0
    )
    finite = np.isfinite(y)
    for shown, fill, suffix in ((finite & usable, face, ""), (finite & ~usable, hollow, flagged)):
        if shown.any():
            axes.errorbar(x[shown], y[shown], bars[shown], mfc=fill, label=label and label + suffix, **style)


def _error_bar_style(marker: str, color: str) -> dict[str, Any]:
    return {
        "fmt": marker, "ms": 3.4, "mew": 0.8, "mec": color, "ecolor": color, "elinewidth": 0.8, "capsize": 0, "zorder": 3,
    }  # fmt: skip


def _draw_residuals(axes: Any, panel: PlotPanel) -> None:
    axes.axhline(0, color=MODEL_COLOR, lw=1.0)
    for line in panel.lines:
        if line.band is not None:
            axes.fill_between(line.x, *(end - line.y for end in line.band), color=MODEL_COLOR, alpha=0.3, lw=0)
    for color, marker, dots in _symbols(panel):
        if dots.fit is not None:
            gap = replace(dots, y=np.where(dots.fit_rows, dots.y - dots.fit, np.nan))
            style = _error_bar_style(marker, color)
            draw_measured(axes, gap, None, face=color, coverage=COVERAGE_FACTOR_95, **style)
    axes.set_ylabel(f"Δ ({panel.unit})" if panel.unit else "Δ", fontsize=NORMAL_PT)
    axes.margins(y=0.15)
    low, high = axes.get_ylim()
    reach = max(abs(low), abs(high))
    axes.set_ylim(-reach, reach)
