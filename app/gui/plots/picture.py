"""Contents of a plot as values: layers, regions, rules and spots over the axes of its panels."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor

from app.common import sentence_case
from app.gui.face import tokens
from model import Array, Band, Mask, Series

FURTHER_COLORS = ("#8e44ad", "#138d75", "#c2185b", "#5d6d7e", "#2e7d32")
"""Colours of further curves, when the colours of the tokens are in use; light theme."""

ON_AXIS = "on-axis"
"""Symbol of a point on the horizontal axis: it stands above it, where nothing is cut, and is half as large as its size."""

CURVE_SYMBOLS = ("t1", "d", "p", "s", "t", "star", "h", "o")
"""Symbols of the n-th of several curves: shapes are distinguishable without colours."""

RING = "ring"
"""Symbol around points of another layer."""

DATA_WIDTH, MODEL_WIDTH = 1.25, 1.75
POINT_PX, EMPTY_PX = 9, 7
SOLID, DASHED, DOTTED = Qt.PenStyle.SolidLine, Qt.PenStyle.DashLine, Qt.PenStyle.DotLine


def curve_tone(index: int) -> str:
    """Return the tone of the n-th of several curves."""
    return f"curve:{index}"


def curve_symbol(index: int) -> str:
    """Return the symbol of the n-th of several curves."""
    return CURVE_SYMBOLS[index % len(CURVE_SYMBOLS)]


def color_of(tone: str) -> QColor:
    """Return the colour of a tone: the name of a token, or a name from `curve_tone`."""
    name, _, index = tone.partition(":")
    if name != "curve":
        return QColor(getattr(tokens(), name))
    given = tokens().layers
    at = int(index) % (len(given) + len(FURTHER_COLORS))
    if at < len(given):
        return QColor(given[at])
    further = QColor(FURTHER_COLORS[at - len(given)])
    return further.lighter(160) if tokens().dark else further


def axis_title(name: str, unit: str = "") -> str:
    """Return the title of an axis: `Frequency, Hz`."""
    return f"{sentence_case(name)}{f', {unit}' if unit else ''}"


def unit_of(title: str) -> str:
    """Return the unit in the title of an axis; empty without one."""
    return title.rpartition(", ")[2] if ", " in title else ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layer:
    """One series of a plot as line, symbols, or both.

    Attributes:
        series: values in the units of the axes, with error bars, the band about the line, and which points are usable: the others
            are empty with a cross. Its name stands in tables and read-outs.
        tone: colour, as `color_of` understands it.
        line: style of the line; None for no line.
        symbol: shape of the points; empty for no points.
        hollow: whether the symbols are empty.
        chosen: (N,), whether each point is selected.
        texts: of the points, for the pointer: strings, or functions that return one.
        label: written beside the line or points; what stands before two spaces is shown alone where there is no free place.
        label_at: share of the points at which the label stands on the line itself; None: beside it, where there is space.
        group: chip above the plot that hides the layer; empty for no chip.
        panel: index of the panel.
        copied: whether the table of the plot has the series.
        drawn: decimated x, y for the line, if the series is too long to be drawn.
    """

    series: Series
    tone: str = "ink"
    line: Qt.PenStyle | None = None
    width: float = DATA_WIDTH
    symbol: str = ""
    size: int = POINT_PX
    hollow: bool = False
    chosen: Mask | None = None
    texts: Sequence[Any] = ()
    label: str = ""
    label_at: float | None = None
    group: str = ""
    panel: int = 0
    copied: bool = True
    drawn: tuple[Array, Array] | None = None

    @property
    def name(self) -> str:
        """Of the series."""
        return self.series.name

    @property
    def x(self) -> Array:
        """(N,)."""
        return self.series.x

    @property
    def y(self) -> Array:
        """(N,)."""
        return np.asarray(self.series.y, float)

    @property
    def usable(self) -> Mask:
        """(N,), whether each point is usable."""
        return np.broadcast_to(True if self.series.usable is None else self.series.usable, self.y.shape)

    def value_at(self, x: float, reach: float) -> tuple[float, float] | None:
        """Return value and standard error at a place: of the nearest point within `reach`, or on the line; None without one."""
        there = np.flatnonzero(np.isfinite(self.x) & np.isfinite(self.y))
        if not there.size:
            return None
        if self.symbol:
            at = int(there[np.abs(self.x[there] - x).argmin()])
            if abs(self.x[at] - x) > reach:
                return None
            return float(self.y[at]), math.nan if self.series.errors is None else float(self.series.errors[at])
        xs, ys = self.x[there], self.y[there]
        if (np.diff(xs) < 0).any():
            return None
        return (float(np.interp(x, xs, ys)), math.nan) if xs[0] <= x <= xs[-1] else None


def layer(
    *,
    name: str,
    x: Array,
    y: Array,
    errors: Array | None = None,
    band: Sequence[Array] | None = None,
    usable: Mask | None = None,
    **look: Any,
) -> Layer:
    """Return a layer of values, with its look as in `Layer`."""
    ends = None if band is None else Band(*band)
    return Layer(series=Series(x, y, errors, name=name, band=ends, usable=usable), **look)


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A stretch of the x axis, or of the y axis, with a tone and a label inside it."""

    low: float
    high: float
    tone: str
    label: str = ""
    along_y: bool = False
    panel: int = 0
    text_tone: str = "sand_text"


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """A line across the plot at a value of the x axis, or of the y axis, with a label at its end."""

    at: float
    label: str = ""
    tone: str = "text2"
    style: Qt.PenStyle = DASHED
    along_y: bool = False
    panel: int = 0
    marked: bool = False
    """Whether a triangle marks it at the top."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """A ring around one point, or a filled dot in a column at the present place, with a label."""

    x: float
    y: float
    label: str
    tone: str = "ink"
    column: bool = False
    panel: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One pair of axes.

    Attributes:
        title: of the vertical axis, with its unit.
        share: of the height, beside the other panels.
        low: value that the vertical axis begins with; None: by the data. `high` likewise.
        x_labels: whether its horizontal axis has labels.
        ticks: values of the vertical ticks; empty: round ones.
    """

    title: str = ""
    share: int = 1
    low: float | None = None
    high: float | None = None
    x_labels: bool = True
    ticks: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """All that a plot shows.

    Attributes:
        title: heading above the plot.
        note: text beside the heading; `alarming`: it is a warning.
        x_title: title of the common horizontal axis, with its unit.
        x: its range; None: by the data.
        log: whether x and y can be logarithmic.
        dates: whether x are seconds since 1970.
        empty: text in the middle while there are no data.
        simulated: whether exported pictures and tables say SIMULATED.
    """

    title: str = ""
    note: str = ""
    alarming: bool = False
    x_title: str = ""
    panels: tuple[Panel, ...] = (Panel(),)
    layers: tuple[Layer, ...] = ()
    regions: tuple[Region, ...] = ()
    rules: tuple[Rule, ...] = ()
    spots: tuple[Spot, ...] = ()
    x: tuple[float, float] | None = None
    log: tuple[bool, bool] = (True, True)
    dates: bool = False
    empty: str = ""
    simulated: bool = False

    @property
    def groups(self) -> dict[str, Layer]:
        """The chips above the plot, each with the layer whose shape it shows."""
        groups: dict[str, Layer] = {}
        measured = [each for each in self.layers if each.tone == "ink"]
        for layer in (*reversed(measured), *(each for each in self.layers if each.tone != "ink")):
            if layer.group:
                groups.setdefault(layer.group, layer)
        return groups
