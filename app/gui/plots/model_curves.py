"""The model's curves under the points, each within its errors: of the free tactor, and on a membrane at every elongation."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QSize
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import QCheckBox

from app.gui.plots.base import SERIES, Fill, ink
from app.gui.plots.copy import Shown, drawn
from app.gui.widgets.elided_label import Elided
from app.gui.widgets.form import mark
from app.gui.widgets.theme import Theme
from app.live.overlay import COVERAGE, Curve

LEGEND_COLUMNS = 3
NO_ERRORS = "The paper's values have no errors: identify this specimen and accept the estimates"


class Drawn:
    """One curve of the model: a line for each series, and the ground it lies in."""

    def __init__(self, plot: Any) -> None:
        self._plot = plot
        self.lines = [pg.PlotCurveItem(antialias=True) for _ in SERIES]
        self.fills = [Fill(plot) for _ in SERIES]
        self.curve: Curve | None = None
        for line in self.lines:
            plot.addItem(line)

    def colour(self, ink: str) -> None:
        """Take another colour."""
        for series, line, fill in zip(SERIES, self.lines, self.fills, strict=True):
            line.setPen(pg.mkPen(ink, width=1.5, style=series.line))
            fill.colour(ink)

    def show(self, curve: Curve) -> None:
        """Draw a curve, with its band where it has one."""
        self.curve = curve
        for series, line, fill in zip(SERIES, self.lines, self.fills, strict=True):
            line.setData(curve.frequency_hz, series.factor * getattr(curve, series.column))
            if curve.band is None:
                fill.empty()
            else:
                low, high = (series.factor * end for end in getattr(curve.band, series.column))
                fill.show_between(curve.frequency_hz, low, high)

    def remove(self) -> None:
        """Take it from the plot."""
        for item in (*self.lines, *self.fills):
            self._plot.removeItem(item)


class ModelCurves:
    """Curves in a plot, a legend's entry that ticks their bands off, and a line that says whose they are."""

    def __init__(self, plot: Any) -> None:
        self._plot = plot
        self._theme: Theme | None = None
        self.free = Drawn(plot)
        self.on: list[Drawn] = []
        """On the membrane, by rising elongation."""
        self.legend = plot.addLegend(offset=(-8, 4), labelTextSize="9pt", verSpacing=-6, colCount=LEGEND_COLUMNS)
        self.box = QCheckBox(f"{100 * COVERAGE:g} % band")
        self.box.setChecked(True)
        self.box.setEnabled(False)
        self.box.setIconSize(QSize(24, 14))
        self.box.toggled.connect(lambda _: self._show())
        self.source = Elided()
        mark(self.source, "note")
        self._series: Sequence[bool] = [True for _ in SERIES]

    @property
    def lines(self) -> list[Any]:
        """Those of the free tactor, one of each series."""
        return self.free.lines

    @property
    def fills(self) -> list[Fill]:
        """The grounds of the free tactor, one of each series."""
        return self.free.fills

    @property
    def every(self) -> list[Drawn]:
        return [self.free, *self.on]

    def colour_at(self, elongation_m: float, otherwise: str) -> QColor:
        """The colour of what was measured at an elongation (NaN: free) where several curves are drawn."""
        if not self.on:
            return QColor(otherwise)
        assert self._theme is not None
        for at, each in enumerate(self.every):
            if self.free.curve is not None and self.free.curve.at(elongation_m) is each.curve:
                return ink(at, self._theme)
        return QColor(self._theme.text)  # of this elongation there is no curve

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        self.legend.setLabelTextColor(theme.text)
        for at, each in enumerate(self.every):
            each.colour(ink(at, theme).name() if self.on else theme.model)
        self._name()
        swatch = QPixmap(self.box.iconSize())
        swatch.fill(self.free.fills[0].brush().color())
        self.box.setIcon(QIcon(swatch))

    def show_curve(self, curve: Curve) -> None:
        """Draw a curve and those on the membrane, and say whose they are."""
        while len(self.on) > len(curve.on):
            self.on.pop().remove()
        while len(self.on) < len(curve.on):
            self.on.append(Drawn(self._plot))
        for each, shown in zip(self.every, (curve, *curve.on), strict=True):
            each.show(shown)
        if self._theme is not None:
            self.set_theme(self._theme)
        of, band = curve.believed, curve.band
        why = f"Where the model's curve lies with {100 * COVERAGE:g} %, by the errors of the calibration"
        self.box.setEnabled(band is not None)
        self.box.setToolTip(why if band is not None else of.trouble or NO_ERRORS)
        self.source.setText(f"curve{'s' if curve.on else ''}: {of.words}")
        where = "The tactor, free and on the membrane," if curve.on else "The free tactor"
        self.source.setToolTip(of.trouble or f"{where} with {of.words}")
        mark(self.source, "fault" if of.trouble else "note")
        self._show()

    def choose(self, series: Sequence[bool]) -> None:
        """Which series are drawn."""
        self._series = series
        self._show()

    def tops(self) -> list[float]:
        """The largest of every line that is seen."""
        seen = [line for each in self.every for line in each.lines if line.isVisible()]
        return [float(np.nanmax(y)) for _, y in (line.getData() for line in seen) if y is not None and len(y)]

    def table(self) -> list[Shown]:
        """The lines and bands that are seen, as numbers."""
        shown: list[Shown] = []
        for each in self.every:
            where = f", {label_of(each.curve)}" if self.on and each.curve is not None else ""
            for series, line, fill in zip(SERIES, each.lines, each.fills, strict=True):
                shown += drawn(f"{series.words}{where}, {self.source.text()}", line)
                if fill.ends is not None and fill.isVisible():
                    names = (f"{series.words}{where}, {self.box.text()}, {end} end" for end in ("lower", "upper"))
                    shown += [Shown(name, fill.ends[0], end) for name, end in zip(names, fill.ends[1:], strict=True)]
        return shown

    def _name(self) -> None:
        """Which colour is which, in words of the present theme's."""
        self.legend.clear()
        for each in self.every:
            if self.on and each.curve is not None:
                self.legend.addItem(each.lines[0], label_of(each.curve))

    def _show(self) -> None:
        for each in self.every:
            for line, fill, shown in zip(each.lines, each.fills, self._series, strict=True):
                line.setVisible(shown)
                fill.setVisible(shown and self.box.isChecked())


def label_of(curve: Curve) -> str:
    """`free`, `2.54 mm`."""
    return "free" if curve.elongation_m is None else f"{1e3 * curve.elongation_m:g} mm"
