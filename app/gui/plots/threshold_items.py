"""Perception threshold in a plot over frequency: a line or a curve with its label, and the shade where vibration is uncomfortable."""

from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QColor, QFont

from app.gui.face import Tokens
from app.gui.plots.items import CurveItem, place
from model import THRESHOLD_M, UNCOMFORTABLE_HZ, Array

ABDOMEN_UM = 1e6 * THRESHOLD_M
ABDOMEN_LABEL = f"felt: {ABDOMEN_UM:g} µm on the abdomen"
UNCOMFORTABLE_LABEL = "tends to be uncomfortable"
ENDLESS_HZ = 1e6

LABEL_ON_LINE = {"position": 0.01, "anchors": [(0, 1), (0, 1)]}
"""The label of a horizontal line: at its left end and above it, because a response comes down to it at the right."""
LABEL_OF_SHADE = {"position": 0.98, "anchors": [(1, 0), (1, 0)], "rotateAxis": (1, 0)}
"""The label along the left end of the shade, within it, at its top."""
SHADE_ALPHA = 22


class ThresholdItems:
    """Items of the threshold in one plot; the abdomen's until another one is shown.

    Args:
        plot: over frequency in Hz, displacement in µm.
        labelled: whether threshold and shade are named in the plot.
        width: of the line.
    """

    def __init__(self, plot: Any, font: QFont, labelled: bool, width: float) -> None:
        self._width, self._log, self._level_um = width, (False, False), ABDOMEN_UM
        self.top_um = ABDOMEN_UM
        """Its largest value."""
        options = {"label": ABDOMEN_LABEL, "labelOpts": LABEL_ON_LINE} if labelled else {}
        self.line = pg.InfiniteLine(ABDOMEN_UM, angle=0, **options)
        self.curve = CurveItem(antialias=True)
        self.curve.hide()
        self.curve_label = pg.TextItem(anchor=(0, 1))
        self.curve_label.hide()
        self.shades = [
            pg.LinearRegionItem((begin, ENDLESS_HZ), movable=False, pen=pg.mkPen(None)) for begin in UNCOMFORTABLE_HZ
        ]
        self._shade_label = pg.InfLineLabel(self.shades[0].lines[0], UNCOMFORTABLE_LABEL, **LABEL_OF_SHADE)
        self._shade_label.setVisible(labelled)
        self._labelled = labelled
        for label in (self._shade_label, self.curve_label, *([self.line.label] if labelled else [])):
            label.setFont(font)
        for item in (*self.shades, self.line, self.curve, self.curve_label):
            plot.addItem(item, ignoreBounds=True)
        for shade in self.shades:
            shade.setZValue(-20)

    def apply_theme(self, theme: Tokens) -> None:
        """Apply a theme."""
        pen = pg.mkPen(theme.text2, width=self._width)
        self.line.setPen(pen)
        self.curve.setPen(pen)
        self.curve_label.setColor(theme.text2)
        if self._labelled:
            self.line.label.setColor(QColor(theme.text2))
        color = QColor(theme.amber_text)
        self._shade_label.setColor(color)
        color.setAlpha(SHADE_ALPHA)
        for shade in self.shades:
            shade.setBrush(color)
            shade.setHoverBrush(color)

    def set_log(self, x: bool, y: bool) -> None:
        """Place the items on logarithmic axes, or on linear ones; the curve is placed with the plot's other curves."""
        self._log = (x, y)
        self.line.setValue(float(place(self._level_um, y)))
        for begin, shade in zip(UNCOMFORTABLE_HZ, self.shades, strict=True):
            shade.setRegion([float(place(f, x)) for f in (begin, ENDLESS_HZ)])
        self._place_label()

    def show_level(self, level_um: float = ABDOMEN_UM, label: str = ABDOMEN_LABEL) -> None:
        """Show a threshold that is the same at all frequencies."""
        self._level_um = self.top_um = level_um
        self.line.setValue(float(place(level_um, self._log[1])))
        if self._labelled:
            self.line.label.setFormat(label)
        self._show(flat=True)

    def show_curve(self, frequency_hz: Array, threshold_um: Array, label: str) -> None:
        """Show a threshold over rising frequencies."""
        self.curve.setData(frequency_hz, threshold_um)
        self.top_um = float(threshold_um.max())
        self.curve_label.setText(label)
        self._show(flat=False)
        self._place_label()

    def _show(self, flat: bool) -> None:
        self.line.setVisible(flat)
        self.curve.setVisible(not flat)
        self.curve_label.setVisible(not flat and self._labelled)

    def _place_label(self) -> None:
        if self.curve.linear is not None and np.size(self.curve.linear[0]):
            x, y = (float(place(values[0], log)) for values, log in zip(self.curve.linear, self._log, strict=True))
            self.curve_label.setPos(x, y)
