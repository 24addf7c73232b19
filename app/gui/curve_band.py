"""The ground around the model's curve, where it lies within the errors of the calibration; and whose curve it is."""

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QSize
from PySide6.QtGui import QIcon, QPixmap
from PySide6.QtWidgets import QCheckBox, QLabel, QSizePolicy

from app.gui.form import mark
from app.gui.plots import Fill
from app.gui.series import SERIES
from app.gui.theme import Theme
from app.overlay import COVERAGE, Curve

NO_ERRORS = "The paper's values have no errors: identify this specimen and accept the estimates"


class CurveBand:
    """A legend's entry that can be ticked off, a line that says whose curve it is, and a ground for each series."""

    def __init__(self, plot: Any) -> None:
        self.fills = [Fill(plot) for _ in SERIES]
        self.box = QCheckBox(f"{100 * COVERAGE:g} % band")
        self.box.setChecked(True)
        self.box.setEnabled(False)
        self.box.setIconSize(QSize(24, 14))
        self.box.toggled.connect(lambda _: self._show())
        self.source = QLabel()
        self.source.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        mark(self.source, "note")
        self._series: Sequence[bool] = [True for _ in SERIES]

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        for fill in self.fills:
            fill.colour(theme.model)
        swatch = QPixmap(self.box.iconSize())
        swatch.fill(self.fills[0].brush().color())
        self.box.setIcon(QIcon(swatch))

    def show_curve(self, curve: Curve) -> None:
        """Fill the band of a curve, where it has one, and say whose it is."""
        of, band = curve.believed, curve.band
        for series, fill in zip(SERIES, self.fills, strict=True):
            if band is None:
                fill.empty()
            else:
                low, high = (series.factor * end for end in getattr(band, series.column))
                fill.show_between(curve.frequency_hz, low, high)
        why = f"Where the model's curve lies with {100 * COVERAGE:g} %, by the errors of the calibration"
        self.box.setEnabled(band is not None)
        self.box.setToolTip(why if band is not None else of.trouble or NO_ERRORS)
        self.source.setText(f"curve: {of.words}")
        self.source.setToolTip(of.trouble or f"The free tactor with {of.words}")
        mark(self.source, "fault" if of.trouble else "note")

    def choose(self, series: Sequence[bool]) -> None:
        """Which series are drawn."""
        self._series = series
        self._show()

    def _show(self) -> None:
        for fill, shown in zip(self.fills, self._series, strict=True):
            fill.setVisible(shown and self.box.isChecked())
