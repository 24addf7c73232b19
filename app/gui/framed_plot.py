"""What the plots of a run's results have in common: one plot under a head line, with what it says in its corners."""

import pyqtgraph as pg
from PySide6.QtWidgets import QLayout, QVBoxLayout, QWidget

from app.gui.copying import Copying
from app.gui.plots import Corner, paint, quiet, simulated_mark
from app.gui.theme import Theme

AXIS_WIDTH = 62


class FramedPlot(QWidget):
    """`_table` gives what it shows as text; `_under` is called with the head line once that is made."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self.canvas = pg.PlotWidget(enableMenu=False)
        self._plot = self.canvas.getPlotItem()
        quiet(self._plot, self.font())
        self._plot.getAxis("left").setWidth(AXIS_WIDTH)
        self._plot.setContentsMargins(0, 0, 8, 0)
        self._plot.showGrid(x=True, y=True, alpha=0.12)  # drawn once a point, not once a frame
        self.mark = simulated_mark(self._plot, self.font())
        self.found = Corner(self._plot, "", self.font(), right=False)
        self.copying = Copying(self.canvas, self._table)
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(2)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        self.canvas.setBackground(theme.panel)
        paint(self._plot, theme)
        self.mark.colour(theme.simulated)
        self.found.colour(theme.text)

    def show_simulated(self, simulated: bool) -> None:
        self.mark.show(simulated)

    def _table(self) -> str:
        raise NotImplementedError

    def _under(self, head: QLayout) -> None:
        self._layout.addLayout(head)
        self._layout.addWidget(self.canvas, 1)
