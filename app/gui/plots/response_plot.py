"""Amplitude over frequency: points as they arrive, on the model's curve, above the line where skin feels them.

Points chosen with the mouse, to be measured again.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QCheckBox, QComboBox, QHBoxLayout, QLabel, QPushButton, QWidget

from app.gui.plots.base import AXIS_WIDTH, LABEL_ON_LINE, SAMPLE, SERIES, FramedPlot, calm_range, sample
from app.gui.plots.copy import Shown, as_text, drawn
from app.gui.plots.model_curves import ModelCurves
from app.gui.plots.residual_strip import SHOWS, Strip
from app.gui.widgets.elided_label import Elided
from app.gui.widgets.form import mark
from app.gui.widgets.theme import Theme
from app.live.overlay import Curve, elongations_of
from app.session.messages import estimate_words, point_words
from protocols.base.events import RunEnded
from protocols.base.quality import Quality


class Selection:
    """Entries of the plan, and the button that measures them again: it is there while something is chosen.

    Args:
        button: measures again.
        changed: called when other entries are chosen.
    """

    def __init__(self, button: QPushButton, changed: Callable[[], None]) -> None:
        self._button, self._changed = button, changed
        self._allowed = False
        self.entries: frozenset[int] = frozenset()
        button.setToolTip("A run that goes on with this one, and measures the chosen points again")
        button.hide()

    def toggle(self, entries: Sequence[int], spots: Sequence[Any]) -> None:
        """A click on points: choose them, or not any more."""
        at = {entries[spot.index()] for spot in spots if spot.index() < len(entries)}
        self._become(self.entries ^ at)

    def keep(self, entries: Sequence[int]) -> None:
        """Other points are shown: what is not among them is not chosen."""
        self._become(self.entries & set(entries))

    def allow(self, allowed: bool) -> None:
        """Whether a run may begin."""
        self._allowed = allowed
        self._show()

    def take(self) -> tuple[int, ...]:
        """What was chosen, which is then done with."""
        taken = tuple(sorted(self.entries))
        self._become(frozenset())
        return taken

    def _become(self, entries: frozenset[int] | set[int]) -> None:
        if entries != self.entries:
            self.entries = frozenset(entries)
            self._show()
            self._changed()

    def _show(self) -> None:
        count = len(self.entries)
        self._button.setText(f"Measure {'this point' if count == 1 else f'these {count} points'} again")
        self._button.setVisible(count > 0)
        self._button.setEnabled(self._allowed)


FELT_UM = 50.0
"""Discrimination threshold of the skin on the abdomen below 250 Hz (paper, Sec. I; `model.response.perception`)."""


HINT = "hollow: not usable"
HINT_TIP = "A hollow point is one that no fit may use; point at it for the reason"


class ResponsePlot(FramedPlot):
    """Measured points and the model's curve; the points are those of one run. A click on a point chooses it."""

    again_pressed = Signal(tuple)

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(theme, parent)
        self._curve: Curve | None = None
        self._points: Sequence[Any] = ()
        self._entries: Sequence[int] = ()
        self._told: Sequence[Any] = ()
        self._top_hz = 250.0
        self._plot.setLabel("left", "amplitude (µm)")
        self._plot.setLabel("bottom", "frequency (Hz)")
        words = f"{FELT_UM:g} µm: felt on the abdomen"
        self._felt = pg.InfiniteLine(FELT_UM, angle=0, label=words, labelOpts=LABEL_ON_LINE)
        self._felt.label.setFont(self.font())
        self._plot.addItem(self._felt)
        self.band = ModelCurves(self._plot)
        self._bars = [pg.ErrorBarItem(beam=0.0) for _ in SERIES]
        self.scatters = [
            pg.ScatterPlotItem(size=s.size_px, antialias=True, hoverable=True, hoverSize=s.size_px + 5, tip=_tip)
            for s in SERIES
        ]
        for item in (*self._bars, *self.scatters):
            self._plot.addItem(item)
        self.shown = [QCheckBox(series.words) for series in SERIES]
        self.hint = Elided()
        self.hint.setToolTip(HINT_TIP)
        self._strip: Strip | None = None
        self.below = QComboBox()
        self.below.addItems([f"below: {words}" for words in SHOWS])
        self.below.setToolTip("What is drawn under the response: measured less model, or the phase")
        self.below.currentIndexChanged.connect(self._show_below)
        self.again = QPushButton()
        self.chosen = Selection(self.again, self._draw_points)
        self.again.clicked.connect(lambda: self.again_pressed.emit(self.chosen.take()))
        self.scatters[0].sigClicked.connect(lambda _, spots: self.chosen.toggle(self._entries, spots))
        self._under(self._head())
        self._scale()
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        super().set_theme(theme)
        self._felt.setPen(pg.mkPen(theme.felt, width=1.5))
        self._felt.label.setColor(QColor(theme.felt))
        for at, (box, bars) in enumerate(zip(self.shown, self._bars, strict=True)):
            bars.setData(pen=pg.mkPen(self._ink(at)))
            box.setIcon(sample(SERIES[at], theme.model, self._ink(at), self.devicePixelRatioF()))
            box.setIconSize(SAMPLE)
        self.band.set_theme(theme)
        if self._strip is not None:
            self._strip.set_theme(theme)
        self._draw_points()

    def show_curve(self, curve: Curve) -> None:
        """Draw the model's curve."""
        if curve is self._curve:
            return
        self._curve = curve
        self._top_hz = curve.question.top_hz
        self.band.show_curve(curve)
        self._draw_points()
        self._scale()

    def show_points(self, points: Sequence[Any], entries: Sequence[int] = (), can_run: bool = False) -> None:
        """Draw the points of the present run."""
        self.chosen.allow(can_run)
        if points is self._told:
            return
        self._entries = entries
        self.chosen.keep(entries)
        self._told = points
        # Other protocols measure other things (the wiring check); they are told in the log.
        self._points = tuple(point for point in points if hasattr(point, SERIES[0].column))
        self._draw_points()
        self._scale()

    def show_found(self, outcome: RunEnded | None) -> None:
        """Write what was identified from the points."""
        self.found.say("" if outcome is None else ",   ".join(estimate_words(e) for e in outcome.estimates))

    def _draw_points(self) -> None:
        x = np.array([p.frequency for p in self._points])
        usable = [Quality(p.quality).usable for p in self._points]
        words = [point_words(p) for p in self._points]
        for at, series in enumerate(SERIES):
            y = series.factor * np.array([getattr(p, series.column) for p in self._points])
            errors = series.factor * np.array([getattr(p, f"{series.column}_errors") for p in self._points])
            inks = [self.band.colour_at(getattr(p, "elongation", math.nan), self._ink(at)) for p in self._points]
            taken = [at < len(self._entries) and self._entries[at] in self.chosen.entries for at in range(len(x))]
            pens = [
                pg.mkPen(QColor(self._theme.accent) if t else ink, width=5 if t else 2)
                for t, ink in zip(taken, inks, strict=True)
            ]
            fills = [pg.mkBrush(ink if good else self._theme.panel) for good, ink in zip(usable, inks, strict=True)]
            # Qt does not survive painting what is nowhere: an imported table may tell one of the two only.
            there = np.flatnonzero(np.isfinite(y)).tolist()
            pens, fills, said = ([every[i] for i in there] for every in (pens, fills, words))
            self.scatters[at].setData(x=x[there], y=y[there], symbol=series.symbol, pen=pens, brush=fills, data=said)
            self._bars[at].setData(x=x[there], y=y[there], height=2 * np.nan_to_num(errors[there]))
        self._draw_strip()

    def _scale(self) -> None:
        self._tell_apart()
        tops = [FELT_UM * 1.5]
        visible = [series for series, box in zip(SERIES, self.shown, strict=True) if box.isChecked()]
        for series in visible:
            sizes = (series.factor * getattr(p, series.column) for p in self._points)
            tops += [size for size in sizes if np.isfinite(size)]
        tops += self.band.tops()
        right = max([self._top_hz, *(1.03 * p.frequency for p in self._points)])
        self._plot.setXRange(0, right, padding=0)
        self._plot.setYRange(0, calm_range(0.0, max(tops), None)[1], padding=0)

    def _tell_apart(self) -> None:
        """Say it where curve and points do not belong to the same drive: the form was changed after the run."""
        hollow = any(not Quality(p.quality).usable for p in self._points)
        words, curve_v = HINT if hollow else "", None if self._curve is None else 2 * self._curve.question.amplitude_v
        if self._points and curve_v is not None:
            points_v = 2 * float(np.median([p.drive_amplitude for p in self._points]))
            if abs(points_v - curve_v) > 0.02 * curve_v:
                words = f"points at {points_v:.3g} V, curve at {curve_v:.3g} V peak to peak"
            bare = [e for e in elongations_of(self._points) if self._curve is not None and self._curve.at(e) is None]
            if bare:
                words = f"no curve of {', '.join(f'{1e3 * e:g}' for e in bare)} mm"
        self.hint.setText(words)
        self.hint.setVisible(bool(words))
        mark(self.hint, "fault" if words and words != HINT else "note")

    def _head(self) -> QHBoxLayout:
        head = QHBoxLayout()
        head.setSpacing(10)
        caption = QLabel("Response")
        caption.setProperty("kind", "caption")
        head.addWidget(caption)
        for at, box in enumerate(self.shown):
            box.setChecked(True)
            box.setToolTip(f"{SERIES[at].words}: measured points and the model's curve")
            box.toggled.connect(self._toggled)
            head.addWidget(box)
        head.addWidget(self.band.box)
        head.addWidget(self.again)
        head.addWidget(self.band.source, 3)
        self.hint.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        head.addWidget(self.hint)
        head.addWidget(self.below)
        return head

    def _toggled(self) -> None:
        for items in zip(self.shown, self._bars, self.scatters, strict=True):
            box, *drawn = items
            for item in drawn:
                item.setVisible(box.isChecked())
        self.band.choose([box.isChecked() for box in self.shown])
        self._scale()

    @property
    def strip(self) -> Strip:
        """What is drawn below; made when somebody wants it."""
        if self._strip is None:
            self._strip = Strip(self._plot, AXIS_WIDTH, self._theme)
            self._strip.set_theme(self._theme)
            self._layout.addWidget(self._strip)
        return self._strip

    def _draw_strip(self) -> None:
        if self._strip is not None:
            inks = [self.band.colour_at(getattr(p, "elongation", math.nan), self._ink(0)) for p in self._points]
            self._strip.draw(self._points, self._curve, inks)

    def _show_below(self, at: int) -> None:
        self.strip.shows = SHOWS[at]
        self._draw_strip()

    def _table(self) -> str:
        """What is drawn, as numbers."""
        shown: list[Shown] = []
        for at, series in enumerate(SERIES):
            shown += drawn(f"{series.words}, measured", self.scatters[at], self._bars[at])
        return as_text((*shown, *self.band.table()), "frequency (Hz)", "amplitude (µm)", self.mark.visible)

    def _ink(self, at: int) -> str:
        return (self._theme.measured, self._theme.second)[at]


def _tip(x: float, y: float, data: str) -> str:
    del x, y
    return data
