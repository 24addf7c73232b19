"""Plot of a control chart: Shewhart chart with its zones above the EWMA, values that break a rule marked."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from app.fleet import GoldenChart
from app.gui.face import Tokens, follow_tokens
from app.gui.plots import CurveItem, PlotBase, ScatterItem, ZoomBox, hover_text
from model import Series, format_quantity, shown_unit

SIGMAS = (-3, -2, -1, 0, 1, 2, 3)
LINE_NAMES = {-3: "−3 σ", 0: "centre", 3: "+3 σ"}
EWMA = "EWMA"


class ControlChartPlot(PlotBase):
    """Values by their number; values that break a rule are filled squares with the rule in their text."""

    ACCESSIBLE_NAME = "plot: control chart, single values above their weighted average"
    LOG_AXES = (False, False)

    def __init__(self, parent: QWidget | None = None) -> None:
        canvas = pg.GraphicsLayoutWidget()
        canvas.ci.setContentsMargins(0, 0, 10, 0)
        plots = [canvas.addPlot(row=at, col=0, enableMenu=False, viewBox=ZoomBox()) for at in (0, 1)]
        super().__init__(parent, canvas=canvas, plots=plots)
        plots[1].setXLink(plots[0])
        plots[1].setMouseEnabled(x=False, y=False)  # it follows the upper plot
        plots[0].getAxis("bottom").setStyle(showValues=False)
        plots[1].setLabel("bottom", "number of the value, oldest first")
        for at, stretch in enumerate((3, 2)):
            canvas.ci.layout.setRowStretchFactor(at, stretch)
        self._chart: GoldenChart | None = None
        self._unit = "1"
        self.sigma_lines = {k: pg.InfiniteLine(0.0, angle=0, label="", labelOpts=_label_at(0.995)) for k in SIGMAS}
        self.centre_line = pg.InfiniteLine(0.0, angle=0)
        self.marks = [pg.InfiniteLine(0.0, angle=90, label="", labelOpts=_label_at(0.1, upright=True)) for _ in (0, 1)]
        """Ends of the baseline, and onset of a lasting change."""
        self.line, self.average, self.upper_limit, self.lower_limit = (CurveItem() for _ in range(4))
        self.points, self.broken, self.beyond = (
            ScatterItem(size=size, symbol=symbol, hoverable=True, hoverSize=14, tip=hover_text)
            for size, symbol in ((6, "o"), (10, "s"), (9, "s"))
        )
        for item in (*self.sigma_lines.values(), *self.marks):
            plots[0].addItem(item, ignoreBounds=True)
        for item in (self.line, self.points, self.broken):
            plots[0].addItem(item)
        for item in (self.centre_line, self.average, self.upper_limit, self.lower_limit, self.beyond):
            plots[1].addItem(item)
        self._add_head()
        follow_tokens(self, self.apply_theme)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        dash, dot = Qt.PenStyle.DashLine, Qt.PenStyle.DotLine
        for k, line in self.sigma_lines.items():
            color = theme.green_text if abs(k) == 3 or k == 0 else theme.text2
            line.setPen(pg.mkPen(color, style=dash if abs(k) == 3 else dot if k else Qt.PenStyle.SolidLine))
            line.label.setColor(color)
        self.centre_line.setPen(pg.mkPen(theme.text2))
        for mark, color in zip(self.marks, (theme.text2, theme.red_text), strict=True):
            mark.setPen(pg.mkPen(color, style=dash))
            mark.label.setColor(color)
        for curve in (self.line, self.average):
            curve.setPen(pg.mkPen(theme.model, width=1.5))
        for curve in (self.upper_limit, self.lower_limit):
            curve.setPen(pg.mkPen(theme.red_text, style=dash))
        self.points.setBrush(pg.mkBrush(theme.model))
        self.points.setPen(pg.mkPen(theme.model))
        for item in (self.broken, self.beyond):
            item.setBrush(pg.mkBrush(theme.red_text))
            item.setPen(pg.mkPen(theme.red_text))
        if self._chart is not None:
            self.show_chart(self._chart, self._unit, self.corner_label.text, self.simulated)

    def show_chart(self, chart: GoldenChart, unit: str, title: str, simulated: bool) -> None:
        """Draw a chart of values in a unit."""
        self._chart, self._unit = chart, unit
        self.show_simulated(simulated)
        self.corner_labels[0].set_text(title)
        self.corner_labels[1].set_text("weighted moving average (EWMA) with its limits")
        factor, bench_unit = shown_unit(unit)
        one = chart.chart
        x, y = np.arange(1, one.values.size + 1, dtype=float), factor * one.values
        for plot, name in zip(self._plots, ("value", "EWMA"), strict=True):
            plot.setLabel("left", f"{name} ({bench_unit})" if bench_unit else name)
        for k, line in self.sigma_lines.items():
            line.setValue(factor * (one.centre + k * one.sigma))
            line.label.setFormat(LINE_NAMES.get(k, ""))
        self.centre_line.setValue(factor * one.centre)
        onset = one.onset
        for mark, at, text in zip(
            self.marks, (one.baseline, onset), ("end of baseline", "lasting change"), strict=True
        ):
            mark.setValue(at + 0.5)
            mark.label.setFormat(text)
            mark.setVisible(0 < at < one.values.size)
        rules = [one.rules.get(at, ()) for at in range(one.values.size)]
        texts = [_describe(chart, at, broken) for at, broken in enumerate(rules)]
        shewhart = np.array([any(rule != EWMA for rule in broken) for broken in rules], bool)
        ewma = np.array([EWMA in broken for broken in rules], bool)
        self.line.setData(x, y)
        self.average.setData(x, factor * one.average)
        for curve, side in ((self.upper_limit, 1), (self.lower_limit, -1)):
            curve.setData(x, factor * (one.centre + side * one.average_limit))
        for item, mask, values in (
            (self.points, ~shewhart, y),
            (self.broken, shewhart, y),
            (self.beyond, ewma, factor * one.average),
        ):
            item.setData(x=x[mask], y=values[mask], data=[text for text, on in zip(texts, mask, strict=True) if on])
        self._rescale()

    def _rescale(self) -> None:
        if self._chart is None:
            return
        one, factor = self._chart.chart, shown_unit(self._unit)[0]
        for plot, values, limit in (
            (self._plots[0], one.values, 3.3 * one.sigma),
            (self._plots[1], one.average, 1.1 * float(one.average_limit.max())),
        ):
            ends = np.concatenate((values, [one.centre - limit, one.centre + limit])) * factor
            plot.setYRange(float(ends.min()), float(ends.max()), padding=0.1)
        self._plots[0].setXRange(0.0, one.values.size + 1.0, padding=0.01)

    def _series(self) -> Iterable[Series]:
        if self._chart is None:
            return []
        one, factor = self._chart.chart, shown_unit(self._unit)[0]
        x = np.arange(1, one.values.size + 1, dtype=float)
        errors = factor * np.array([value.total for value in self._chart.values])
        return [
            Series(x, factor * one.values, errors, name="value"),
            Series(x, factor * one.average, name="EWMA"),
            Series(x, factor * (one.centre + one.average_limit), name="EWMA, upper limit"),
            Series(x, factor * (one.centre - one.average_limit), name="EWMA, lower limit"),
        ]

    def _column_names(self) -> tuple[str, str]:
        return "number", self._plots[0].getAxis("left").labelText


def _label_at(position: float, upright: bool = False) -> dict[str, Any]:
    return {"position": position, "anchors": [(1, 0), (0, 0)] if upright else [(1, 1), (1, 1)]}


def _describe(chart: GoldenChart, at: int, rules: Sequence[str]) -> str:
    value = chart.values[at]
    figure = format_quantity(value.value, value.total, value.unit, value.name)
    broken = f"\nbreaks: {', '.join(rules)}" if rules else ""
    return f"no. {at + 1}, {value.start_time[:10]}: {figure}{broken}"
