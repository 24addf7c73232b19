"""Points of any protocol over its axes, with error bars, as they arrive."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QWidget

from app.common.units import display_unit
from app.gui.plots.base import PlotBase
from app.gui.plots.copy import series_as_text, series_of
from app.gui.plots.response_plot import EntrySelection
from app.gui.widgets.form import set_style_kind
from app.gui.widgets.theme import Theme
from app.session.messages import describe_point, format_estimate
from protocols.base.events import RunEnded
from protocols.base.protocol import Protocol
from protocols.base.quality import Quality
from protocols.runfile.schema import point_columns

HOLLOW_HINT = "hollow: not usable, point at it for the reason"
EMPTY_TEXT = "Points appear here as they are measured"


class PointsPlot(PlotBase):
    """One symbol a point; hollow where no fit may use it, its words on hover; a click chooses it."""

    repeat_requested = Signal(tuple)

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(theme, parent)
        self._kind: type[Protocol] | None = None
        self._points: Sequence[Any] = ()
        self._entries: Sequence[int] = ()
        self._shown_indices: Sequence[int] = ()
        self._outcome: RunEnded | None = None
        self._bars = pg.ErrorBarItem(beam=0.0)
        self.scatter = pg.ScatterPlotItem(size=9, antialias=True, hoverable=True, hoverSize=14, tip=_tooltip)
        for item in (self._bars, self.scatter):
            self._plot.addItem(item)
        self.caption, self.hint_label, self.repeat_button = QLabel(), QLabel(HOLLOW_HINT), QPushButton()
        self.curves_button = QPushButton("Show the curves")
        set_style_kind(self.curves_button, "choice")
        self.curves_button.hide()
        set_style_kind(self.caption, "caption")
        set_style_kind(self.hint_label, "note")
        self.selection = EntrySelection(self.repeat_button, self._draw)
        self.repeat_button.clicked.connect(lambda: self.repeat_requested.emit(self.selection.pop()))
        self.scatter.sigClicked.connect(lambda _, spots: self.selection.toggle(self._shown_indices, spots))
        head = QHBoxLayout()
        for widget in (self.caption, self.repeat_button):
            head.addWidget(widget)
        head.addStretch()
        head.addWidget(self.hint_label)
        head.addWidget(self.curves_button)
        head.setSpacing(14)
        self._add_head(head)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        super().set_theme(theme)
        self._bars.setData(pen=pg.mkPen(theme.measured))
        self._draw()

    def set_protocol(self, kind: type[Protocol]) -> None:
        """Whose points will come."""
        if kind is self._kind:
            return
        self._kind, self._points, self._entries = kind, (), ()
        self.caption.setText(kind.title)
        known = point_columns(kind.point_type)
        for side, name in zip(("bottom", "left"), kind.axes, strict=True):
            unit, _, _ = known[name]
            _, shown = display_unit(unit)
            self._plot.setLabel(side, name.replace("_", " ") + (f" ({shown})" if shown else ""))
        self._draw()

    def show_points(self, points: Sequence[Any], entries: Sequence[int], can_run: bool) -> None:
        """Draw the points of the present run."""
        self.selection.set_allowed(can_run)
        if points is not self._points:
            self._points, self._entries = points, entries
            self.selection.retain(entries)
            self._draw()

    def show_estimates(self, outcome: RunEnded | None) -> None:
        """Write what was identified from the points."""
        self._outcome = outcome
        told = "" if outcome is None else ",   ".join(format_estimate(e) for e in outcome.estimates[:3])
        self.estimates_label.set_text(
            told or ("" if self._shown_indices else EMPTY_TEXT if outcome is None else "no points were measured")
        )

    def _table(self) -> str:
        across, up = (self._plot.getAxis(side).labelText for side in ("bottom", "left"))
        return series_as_text(
            series_of(self.caption.text(), self.scatter, self._bars), across, up, self.simulated_label.visible
        )

    def _draw(self) -> None:
        if self._kind is None:
            return
        known = point_columns(self._kind.point_type)
        x_name, y_name = self._kind.axes
        at = [
            i
            for i, p in enumerate(self._points)
            if isinstance(p, self._kind.point_type) and _has_position(p, x_name, y_name)
        ]
        points: list[Any] = [self._points[i] for i in at]
        x, y, errors = (
            display_unit(known.get(name, ("1", "", 0))[0])[0] * np.array([float(getattr(p, name, 0.0)) for p in points])
            for name in (x_name, y_name, f"{y_name}_errors")
        )
        ink = QColor(self._theme.measured)
        usable = [Quality(p.quality).usable for p in points]
        self._shown_indices = [self._entries[i] if i < len(self._entries) else -1 for i in at]
        chosen = [entry in self.selection.entries for entry in self._shown_indices]
        pens = [pg.mkPen(QColor(self._theme.accent if taken else ink), width=4 if taken else 2) for taken in chosen]
        fills = [pg.mkBrush(ink if good else self._theme.panel) for good in usable]
        words = [describe_point(p) for p in points]
        self.scatter.setData(x=x, y=y, symbol="o", pen=pens, brush=fills, data=words)
        self._bars.setData(x=x, y=y, height=2 * np.nan_to_num(errors))
        self.hint_label.setVisible(not all(usable))
        for side in ("left", "bottom"):  # between what limits, nobody knows yet
            self._plot.getAxis(side).setStyle(showValues=bool(points))
        self._plot.autoRange(padding=0.08)
        self.show_estimates(self._outcome)


def _has_position(point: Any, *names: str) -> bool:
    """Whether a point has a place in the plot; Qt does not survive painting what has none."""
    return all(math.isfinite(float(getattr(point, name))) for name in names)


def _tooltip(x: float, y: float, data: object) -> str:
    del x, y
    return str(data)
