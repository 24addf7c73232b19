"""Card of the runs in the plot: shape, name, natural frequency and largest response of each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QLabel

from app.common import number_text
from app.gui.face import follow_tokens, px
from app.gui.plots import RunInPlot, layer_icon
from app.gui.widgets import ElidedLabel, clear_layout, column, configure, grid, make_button, make_label, row

HEADS = ("", "Run", "Natural, Hz", "Largest, µm")
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter


class RunsInPlot(QFrame):
    """One row for each run, the present one first.

    Args:
        add: lets the user choose runs to add.
    """

    def __init__(self, add: Callable[[], object]) -> None:
        super().__init__()
        configure(self, "measure.runs", kind="panel")
        self._rows = grid(spacing=(8, 4), stretch={1: 1})
        title = make_label("Runs in the plot", "heading", wrap=False)
        more = make_button("Add runs …", add, "link", "Lay recorded runs over this one", "measure.add-runs")
        column(row(title, None, more), self._rows, parent=self, margins=(12, 8, 12, 10), spacing=4)
        self._runs: list[RunInPlot] = []
        follow_tokens(self, lambda _: self.show_runs(self._runs))
        self.hide()

    def show_runs(self, runs: Iterable[RunInPlot]) -> None:
        """Show the runs of a plot."""
        clear_layout(self._rows)
        shown = self._runs = list(runs)
        for at, head in enumerate(HEADS):
            self._rows.addWidget(
                make_label(head, "note", wrap=False), 0, at, RIGHT if at > 1 else Qt.AlignmentFlag.AlignLeft
            )
        for place, run in enumerate(shown, 1):
            icon, name = QLabel(), ElidedLabel()
            icon.setPixmap(layer_icon(run.layer).pixmap(px(18), px(14)))
            name.setText(run.name)
            natural = "–" if math.isnan(run.natural_hz) else f"{run.natural_hz:.1f}"
            figures = [make_label(text, wrap=False) for text in (natural, number_text(run.largest, 4))]
            for at, widget in enumerate((icon, name, *figures)):
                self._rows.addWidget(widget, place, at, *((RIGHT,) if at > 1 else ()))
