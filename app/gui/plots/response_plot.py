"""Response plot: measured amplitude over frequency on the model's curve, above the threshold line of the skin."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor, QResizeEvent
from PySide6.QtWidgets import QCheckBox, QComboBox, QHBoxLayout, QPushButton

from app.common import format_point
from app.gui.face import Tokens, follow_tokens, tokens
from app.gui.plots.base import PlotBase, caption_label, finite_max, legend_share, stable_range
from app.gui.plots.items import BarsItem, ScatterItem
from app.gui.plots.model_curves import ModelCurveItems
from app.gui.plots.residual_strip import NOTHING, PHASE, RESIDUAL, STRIP_QUANTITIES, ResidualStrip
from app.gui.plots.series import LEGEND_ICON_SIZE, SERIES, legend_icon, series_of
from app.gui.widgets import ElidedLabel, Menu, configure, make_choice, row, set_style_kind
from app.live import ModelCurves, elongations_of
from model import Series
from protocols.base import Quality
from protocols.runfile import is_response


class EntrySelection:
    """Selected entries of the plan, and the button that repeats them, visible while something is selected.

    Args:
        changed: called when the selection changes.
        repeat: called with the selected entries when the button is clicked.
    """

    def __init__(self, changed: Callable[[], None], repeat: Callable[[tuple[int, ...]], object]) -> None:
        self.button, self._changed, self._repeat = QPushButton(), changed, repeat
        self.entries: frozenset[int] = frozenset()
        self.button.setToolTip("A run that continues this one and measures the selected points again")
        self.button.hide()
        self.button.clicked.connect(self._on_clicked)

    def toggle(self, entries: Sequence[int], spots: Sequence[Any]) -> None:
        """Select the clicked points, or deselect them."""
        self._set_entries(self.entries ^ {entries[spot.index()] for spot in spots if spot.index() < len(entries)})

    def retain(self, entries: Sequence[int]) -> None:
        """Deselect all entries but these: other points are displayed."""
        self._set_entries(self.entries & set(entries))

    def _on_clicked(self) -> None:
        selected = tuple(sorted(self.entries))
        self._set_entries(frozenset())
        self._repeat(selected)

    def _set_entries(self, entries: frozenset[int]) -> None:
        if entries != self.entries:
            self.entries = entries
            count = len(entries)
            self.button.setText(f"Measure {'this point' if count == 1 else f'these {count} points'} again")
            self.button.setVisible(count > 0)
            self._changed()


STRIP_LABELS = {NOTHING: "no lower plot", RESIDUAL: "lower plot: residual", PHASE: "lower plot: phase"}

HEAD_SPACING, TICK_BOX_WIDTH = 10, 36

HOLLOW_HINT = "hollow: not usable"
HOLLOW_TOOLTIP = "Fits ignore hollow points; point at one for the reason"


class ResponsePlot(PlotBase):
    """Measured points of one run and the model's curve. A click on a point selects it."""

    ACCESSIBLE_NAME = "plot: response over frequency"

    MAX_ESTIMATES = None
    repeat_requested = Signal(tuple)

    def __init__(self) -> None:
        super().__init__(grid=True)
        self._curve: ModelCurves | None = None
        self._points: Sequence[Any] = ()
        self._entries: Sequence[int] = ()
        self._last_points: Sequence[Any] = ()
        self._max_hz = 250.0
        self.plot.setLabels(left="peak-to-peak displacement (µm)", bottom="frequency (Hz)")
        self._felt = self._add_threshold(labelled=True, width=1.5)
        self.model_curves = ModelCurveItems(self.plot)
        self._bars = [BarsItem(beam=0.0) for _ in SERIES]
        self.scatters = [
            ScatterItem(size=s.size_px, antialias=True, hoverable=True, hoverSize=s.size_px + 5, tip=hover_text)
            for s in SERIES
        ]
        for item in (*self._bars, *self.scatters):
            self.plot.addItem(item)
        self.series_boxes = [QCheckBox(series.label) for series in SERIES]
        self.hint_label = ElidedLabel()
        self.hint_label.setToolTip(HOLLOW_TOOLTIP)
        self.strip_box = configure(QComboBox(), accessibleName="lower plot", minimumContentsLength=4)
        self.strip_box.addItems([STRIP_LABELS[quantity] for quantity in STRIP_QUANTITIES])
        self.strip_box.setToolTip("Lower plot: measured less model, or the phase")
        self.strip_box.currentIndexChanged.connect(self._select_strip)
        self.selection = EntrySelection(self._draw_points, self.repeat_requested.emit)
        self.scatters[0].sigClicked.connect(lambda _, spots: self.selection.toggle(self._entries, spots))
        self.curves_button = make_choice("Show the curves")
        self._add_head(self._head_row())
        follow_tokens(self, self.apply_theme)
        self.plot.getViewBox().sigResized.connect(lambda *_: self._scale())  # the legend's share of the height

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        for series, color, box, bars in zip(SERIES, self._series_colors, self.series_boxes, self._bars, strict=True):
            bars.setData(pen=pg.mkPen(color))
            box.setIcon(legend_icon(series, theme.model, color, self.devicePixelRatioF()))
            box.setIconSize(LEGEND_ICON_SIZE)
        self.model_curves.apply_theme(theme)
        self._draw_points()

    def show_model_curve(self, curve: ModelCurves) -> None:
        """Draw the model's curve."""
        if curve is self._curve:
            return
        self._curve = curve
        self._max_hz = curve.request.max_hz
        self.model_curves.show_curve(curve)
        self._draw_points()

    def show_points(self, points: Sequence[Any], entries: Sequence[int] = (), can_run: bool = False) -> None:
        """Draw the points of the run."""
        self.selection.button.setEnabled(can_run)
        if points is self._last_points:
            return
        self._entries = entries
        self.selection.retain(entries)
        self._last_points = points
        # Points of other protocols, such as the wiring check, appear in the log only.
        self._points = tuple(filter(is_response, points))
        self._draw_points()

    def _draw_points(self) -> None:
        x = np.array([p.frequency for p in self._points])
        usable = [Quality(p.quality).usable for p in self._points]
        texts = [format_point(p) for p in self._points]
        for at, series in enumerate(SERIES):
            y = np.array([series.values_of(p) for p in self._points])
            errors = np.array([series.errors_of(p) for p in self._points])
            inks = self._point_colors(at)
            taken = [i < len(self._entries) and self._entries[i] in self.selection.entries for i in range(len(x))]
            pens = [
                pg.mkPen(QColor(tokens().accent) if t else ink, width=5 if t else 2)
                for t, ink in zip(taken, inks, strict=True)
            ]
            fills = [pg.mkBrush(ink if good else tokens().surface) for good, ink in zip(usable, inks, strict=True)]
            # An imported table may have one of the two only, and Qt crashes when it paints a point that is not finite.
            there = np.flatnonzero(np.isfinite(y)).tolist()
            pens, fills, texts_there = ([every[i] for i in there] for every in (pens, fills, texts))
            self.scatters[at].setData(
                x=x[there], y=y[there], symbol=series.symbol, pen=pens, brush=fills, data=texts_there
            )
            self._bars[at].setData(x=x[there], y=y[there], height=2 * np.nan_to_num(errors[there]))
        self._draw_strip()
        self._scale()

    def _scale(self) -> None:
        self._warn_mismatch()
        tops = [self._felt.top_um * 1.5]
        for series, box in zip(SERIES, self.series_boxes, strict=True):
            if box.isChecked():
                tops += [finite_max(series.values_of(point)) for point in self._points]
        tops += self.model_curves.maxima()
        right = max([self._max_hz, *(1.03 * p.frequency for p in self._points)])
        self.plot.setXRange(0, right, padding=0)
        top = max(tops) / (1 - legend_share(self.model_curves.legend, self.plot))
        self.plot.setYRange(0, stable_range(0.0, top, None)[1], padding=0)

    def _warn_mismatch(self) -> None:
        """Warn if curve and points belong to different drives: the form was changed after the run."""
        hollow = any(not Quality(p.quality).usable for p in self._points)
        hint = HOLLOW_HINT if hollow else ""
        if self._points and self._curve is not None:
            curve_v = 2 * self._curve.request.amplitude_v
            points_v = 2 * float(np.median([p.drive_amplitude for p in self._points]))
            if abs(points_v - curve_v) > 0.02 * curve_v:
                hint = f"points at {points_v:.3g} V, curve at {curve_v:.3g} V peak to peak"
            if bare := [e for e in elongations_of(self._points) if self._curve.at_elongation(e) is None]:
                hint = f"no curve of {', '.join(f'{1e3 * e:g}' for e in bare)} mm"
        self.hint_label.setText(hint)
        self.hint_label.setVisible(bool(hint))
        set_style_kind(self.hint_label, "fault" if hint and hint != HOLLOW_HINT else "note")

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        boxes = (*self.series_boxes, self.model_curves.band_box)
        written = (self.fontMetrics().horizontalAdvance(f"Response {self.strip_box.currentText()}"),)
        drawn = (
            self.fontMetrics().horizontalAdvance(box.accessibleName()) + box.iconSize().width() + TICK_BOX_WIDTH
            for box in boxes
        )
        needed = sum((*written, *drawn)) + (len(boxes) + 2) * HEAD_SPACING
        for box in boxes:  # rather the symbol alone, with its tool tip, than half a word
            box.setText(box.accessibleName() if needed <= self.width() else "")

    def _head_row(self) -> QHBoxLayout:
        for at, box in enumerate(self.series_boxes):
            box.setChecked(True)
            box.setToolTip(f"{SERIES[at].label}: measured points and the model's curve")
            box.toggled.connect(self._on_series_toggled)
        self.hint_label.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        curves, title = self.model_curves, caption_label("Response")
        boxes = (*self.series_boxes, curves.band_box)
        for box in boxes:
            box.setAccessibleName(box.text())
        self.curves_button.hide()
        return row(
            title, *boxes, self.selection.button,
            (curves.source_label, 3), self.hint_label, self.strip_box, self.curves_button, spacing=HEAD_SPACING,
        )  # fmt: skip

    def _on_series_toggled(self) -> None:
        for items in zip(self.series_boxes, self._bars, self.scatters, strict=True):
            box, bars, scatter = items
            bars.setVisible(box.isChecked())
            scatter.setVisible(box.isChecked())
        self.model_curves.select_series([box.isChecked() for box in self.series_boxes])
        self._scale()

    @cached_property
    def residual_strip(self) -> ResidualStrip:
        """The plot below the response; created when first used."""
        return self._add_strip(ResidualStrip(self.plot))

    def _draw_strip(self) -> None:
        if "residual_strip" in vars(self):
            self.residual_strip.draw(self._points, self._curve, self._point_colors(0))

    def _select_strip(self, index: int) -> None:
        self.residual_strip.quantity = STRIP_QUANTITIES[index]
        self._draw_strip()

    def _fill_menu(self, menu: Menu) -> None:
        menu.addSeparator()
        for at, quantity in enumerate(STRIP_QUANTITIES):
            action = menu.addAction(STRIP_LABELS[quantity].capitalize(), partial(self.strip_box.setCurrentIndex, at))
            action.setCheckable(True)
            action.setChecked(at == self.strip_box.currentIndex())

    def _series(self) -> Iterable[Series]:
        for series, scatter, bars in zip(SERIES, self.scatters, self._bars, strict=True):
            yield from series_of(f"{series.label}, measured", scatter, bars)
        yield from self.model_curves.plot_series()

    def _point_colors(self, series_index: int) -> list[QColor]:
        default = self._series_colors[series_index]
        return [self.model_curves.color_at(getattr(p, "elongation", math.nan), default) for p in self._points]

    @property
    def _series_colors(self) -> tuple[str, str]:
        return tokens().ink, tokens().ink


def hover_text(x: float, y: float, data: str) -> str:  # noqa: ARG001 - as pyqtgraph calls it
    """Return the text of a point."""
    return data
