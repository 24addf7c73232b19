"""Model curves under measured points, with error bands: the free tactor and each elongation of the membrane."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QSize
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import QCheckBox

from app.gui.face import Tokens, tokens
from app.gui.plots.base import LEGEND_STYLE, BandFill, curve_color
from app.gui.plots.items import CurveItem, linear_data
from app.gui.plots.series import SERIES, series_of
from app.gui.widgets import ElidedLabel, configure, set_style_kind
from app.live import COVERAGE, ModelCurves, ResponseCurves
from model import Series

LEGEND_COLUMNS = 3
NO_ERRORS_TEXT = "The paper's values have no errors: identify this specimen and accept the estimates"


class DrawnCurve:
    """The plot items of one model curve: a line and a band for each series."""

    def __init__(self, plot: Any) -> None:
        self._plot = plot
        self.lines = [CurveItem(antialias=True) for _ in SERIES]
        self.fills = [BandFill(plot) for _ in SERIES]
        self.curves: ResponseCurves | None = None
        for line in self.lines:
            plot.addItem(line)

    def set_color(self, color: str) -> None:
        """Set the colour of lines and bands."""
        for series, line, fill in zip(SERIES, self.lines, self.fills, strict=True):
            line.setPen(pg.mkPen(color, width=1.5, style=series.line))
            fill.set_color(color)

    def show(self, curves: ResponseCurves) -> None:
        """Draw curves and their bands, if they have any."""
        self.curves = curves
        for series, line, fill in zip(SERIES, self.lines, self.fills, strict=True):
            drawn = curves[series.column].scaled(1.0, series.factor)
            line.setData(drawn.x, drawn.plotted)
            fill.show_band(drawn.x, drawn.band)

    @property
    def label(self) -> str:
        """`free`, `2.54 mm`; empty before a curve is drawn."""
        return "" if self.curves is None else self.curves[SERIES[0].column].label

    def remove(self) -> None:
        """Remove the items from the plot."""
        for item in (*self.lines, *self.fills):
            self._plot.removeItem(item)


class ModelCurveItems:
    """The model curves of a plot, the check box of their bands, and the label of the model they belong to."""

    def __init__(self, plot: Any) -> None:
        self._plot = plot
        self._model: ModelCurves | None = None
        self.free = DrawnCurve(plot)
        self.on_membrane: list[DrawnCurve] = []
        """On the membrane, in order of rising elongation."""
        self.legend = plot.addLegend(offset=(-8, 4), colCount=LEGEND_COLUMNS, **LEGEND_STYLE)
        box = QCheckBox(f"{100 * COVERAGE:g} % band")
        self.band_box = configure(box, checked=True, enabled=False, iconSize=QSize(24, 14))
        self.band_box.toggled.connect(lambda _: self._update_visibility())
        self.source_label = configure(ElidedLabel(), kind="note")
        self._series: Sequence[bool] = [True for _ in SERIES]

    @property
    def all_curves(self) -> list[DrawnCurve]:
        return [self.free, *self.on_membrane]

    def color_at(self, elongation_m: float, default: str) -> QColor:
        """Return the colour of points at an elongation (NaN: free) if several curves are drawn, else `default`."""
        if self._model is None or not self.on_membrane:
            return QColor(default)
        for at, each in enumerate(self.all_curves):
            if self._model.at_elongation(elongation_m) is each.curves:
                return curve_color(at)
        return QColor(tokens().text)  # no curve at this elongation

    def apply_theme(self, theme: Tokens) -> None:
        """Apply a theme."""
        self.legend.setLabelTextColor(theme.text)
        for at, each in enumerate(self.all_curves):
            each.set_color(curve_color(at).name() if self.on_membrane else theme.model)
        self._label_curves()
        swatch = QPixmap(self.band_box.iconSize())
        swatch.fill(self.free.fills[0].brush().color())
        self.band_box.setIcon(QIcon(swatch))

    def show_curve(self, curve: ModelCurves) -> None:
        """Draw the curves of the free tactor and on the membrane, and name their model."""
        self._model = curve
        while len(self.on_membrane) > len(curve.on_membrane):
            self.on_membrane.pop().remove()
        while len(self.on_membrane) < len(curve.on_membrane):
            self.on_membrane.append(DrawnCurve(self._plot))
        for each, shown in zip(self.all_curves, (curve.free, *curve.on_membrane.values()), strict=True):
            each.show(shown)
        self.apply_theme(tokens())
        of, has_band = curve.active_model, curve.free[SERIES[0].column].band is not None
        why = f"Where the model's curve lies with {100 * COVERAGE:g} %, by the errors of the calibration"
        self.band_box.setEnabled(has_band)
        self.band_box.setToolTip(why if has_band else of.problem or NO_ERRORS_TEXT)
        self.source_label.setText(f"curve{'s' if curve.on_membrane else ''}: {of.description}")
        where = "The tactor, free and on the membrane," if curve.on_membrane else "The free tactor"
        self.source_label.setToolTip(of.problem or f"{where} with {of.description}")
        set_style_kind(self.source_label, "fault" if of.problem else "note")
        self._update_visibility()

    def select_series(self, series: Sequence[bool]) -> None:
        """Set which series are drawn."""
        self._series = series
        self._update_visibility()

    def maxima(self) -> list[float]:
        """Return the maximum of each visible line."""
        seen = [line for each in self.all_curves for line in each.lines if line.isVisible()]
        return [float(np.nanmax(y)) for _, y in (linear_data(line) for line in seen) if y is not None and len(y)]

    def plot_series(self) -> list[Series]:
        """Return the data of the visible lines and bands."""
        shown: list[Series] = []
        for each in self.all_curves:
            where = f", {each.label}" if self.on_membrane and each.label else ""
            for series, line, fill in zip(SERIES, each.lines, each.fills, strict=True):
                shown += series_of(f"{series.label}{where}, {self.source_label.text()}", line)
                if fill.ends is not None and fill.isVisible():
                    names = (f"{series.label}{where}, {self.band_box.text()}, {end} end" for end in ("lower", "upper"))
                    shown += [
                        Series(fill.ends[0], end, name=name) for name, end in zip(names, fill.ends[1:], strict=True)
                    ]
        return shown

    def _label_curves(self) -> None:
        """Fill the legend, in the text colour of the theme."""
        self.legend.clear()
        for each in self.all_curves:
            if self.on_membrane and each.label:
                self.legend.addItem(each.lines[0], each.label)

    def _update_visibility(self) -> None:
        for each in self.all_curves:
            for line, fill, shown in zip(each.lines, each.fills, self._series, strict=True):
                line.setVisible(shown)
                fill.setVisible(shown and self.band_box.isChecked())
