"""Table of the layers of a comparison: eye, letter, run, and the values at the cursors with their difference."""

import math
from collections.abc import Sequence
from functools import partial

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from app.common import number_text, typeset
from app.comparison import Comparison, ComparisonLayer
from app.gui.face import follow_tokens
from app.gui.plots import color_of, curve_tone
from app.gui.runs.compare.plot import ComparisonPlot, run_index
from app.gui.widgets import add_actions, configure_table
from model import format_with_uncertainty

EYE, LETTER, RUN, FIRST, SECOND, CHANGE, RATIO = range(7)
NARROW_CHARACTERS = 60
"""Width of the table below which the ratio is left out, so that the runs keep their names."""
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter


LAYER_ACTIONS = {"hide": "Hide", "up": "Up", "down": "Down", "reference": "Reference"}
"""Texts of the buttons of the actions on the run of the current row (`compare.…` in the registry of actions)."""


class LayerTable(QTableWidget):
    """A row for each layer; its actions concern the run of the current row."""

    requested = Signal(str, str)
    """What to do with a run, one of `LAYER_ACTIONS`, and its file name."""

    def __init__(self) -> None:
        super().__init__(0, 7)
        one = QAbstractItemView.SelectionMode.SingleSelection
        configure_table(self, "compare.layers", "layers of the comparison", selectionMode=one)
        header = self.horizontalHeader()
        wide = self.fontMetrics().averageCharWidth()
        # Columns as wide as their contents would be measured again at every move of the cursor.
        for at, characters in ((EYE, 4), (LETTER, 4), (FIRST, 15), (SECOND, 9), (CHANGE, 10), (RATIO, 8)):
            self.setColumnWidth(at, characters * wide)
        header.setSectionResizeMode(RUN, QHeaderView.ResizeMode.Stretch)
        header.setMinimumSectionSize(3 * wide)
        self._layers: Sequence[ComparisonLayer] = ()
        self._reference, self._places, self._x_unit = "", [0.0][:0], ""
        self._factors: list[tuple[tuple[float, str], tuple[float, str]]] = []
        self.itemChanged.connect(self._on_changed)
        add_actions(self, {f"compare.{what}": partial(self.perform, what) for what in LAYER_ACTIONS})
        follow_tokens(self, lambda _: self._paint_letters())

    def show_layers(self, comparison: Comparison) -> None:
        """Show the layers of a comparison; the current row stays at its run."""
        current = self.current_run
        self.blockSignals(True)
        self._layers = comparison.layers
        relation = comparison.view.relation
        self._reference = comparison.reference.path.name if relation.has_reference else ""
        self._x_unit = ComparisonPlot.units(self._layers[0].series)[0][1] if self._layers else ""
        self._factors = [ComparisonPlot.units(each.series) for each in self._layers]
        self.setRowCount(len(self._layers))
        for row, each in enumerate(self._layers):
            eye = QTableWidgetItem()
            eye.setFlags(Qt.ItemFlag.ItemIsUserCheckable | Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable)
            eye.setCheckState(Qt.CheckState.Unchecked if each.hidden else Qt.CheckState.Checked)
            is_reference = each.run is not None and each.run.path.name == self._reference
            title = each.title.removeprefix(each.name).strip() + (", reference" if is_reference else "")
            setting = (
                f", {comparison.view.over} {each.setting:.4g}"
                if math.isfinite(each.setting) and comparison.view.over not in ("", "time")
                else ""
            )
            for at, text in (
                (LETTER, "" if each.run is None else each.name),
                (RUN, title + setting),
                (FIRST, ""),
                (SECOND, ""),
                (CHANGE, ""),
                (RATIO, ""),
            ):
                item = QTableWidgetItem(text)
                if at == RUN and each.run is not None:
                    item.setToolTip(str(each.run.path))
                if at >= FIRST:
                    item.setTextAlignment(RIGHT)
                self.setItem(row, at, item)
            self.setItem(row, EYE, eye)
        self.blockSignals(False)
        self._paint_letters()
        rows = [row for row, each in enumerate(self._layers) if each.run is not None and each.run.path.name == current]
        self.setCurrentCell(rows[0] if rows else 0, RUN)
        self.show_values(self._places)

    def show_values(self, places: Sequence[float]) -> None:
        """Show the values at the cursors, which are places in the unit of the plot: none, one or two."""
        self._places = list(places)
        both, unit = len(self._places) > 1, f" {self._x_unit}".rstrip()
        unit_of_y = f", {typeset(self._factors[0][1][1])}".removesuffix(", ") if self._factors else ""
        first, second = (*(f"{number_text(x)}{unit}" for x in self._places), "", "")[:2]
        self.setHorizontalHeaderLabels(["", "", "Run", first if both else f"At {first}{unit_of_y}" if first else "At the cursor", second, f"Δ{unit_of_y}", "Ratio"])  # fmt: skip
        self.setColumnWidth(FIRST, (9 if both else 16) * self.fontMetrics().averageCharWidth())
        is_narrow = self.viewport().width() < NARROW_CHARACTERS * self.fontMetrics().averageCharWidth()
        for at in (SECOND, CHANGE, RATIO):
            self.setColumnHidden(at, not both or (at == RATIO and is_narrow))
        for row, each in enumerate(self._layers):
            (over, _), (factor, _) = self._factors[row]
            found = [[factor * part for part in each.value_at(x / over)] for x in self._places]
            texts = [_value_text(value, 0.0 if both else error) for value, error in found]
            if both:
                (a, _), (b, _) = found
                texts += [_value_text(a - b, 0.0), _value_text(a / b if b else math.nan, 0.0)]
            for at, text in zip((FIRST, SECOND, CHANGE, RATIO), [*texts, "", "", "", ""], strict=False):
                self._cell(row, at).setText(text)

    @property
    def current_run(self) -> str:
        """File name of the run of the current row; empty without one."""
        row = self.currentRow()
        run = self._layers[row].run if 0 <= row < len(self._layers) else None
        return "" if run is None else run.path.name

    def perform(self, what: str) -> None:
        """Do one of `LAYER_ACTIONS` with the run of the current row."""
        if name := self.current_run:
            self.requested.emit(what, name)

    def _on_changed(self, item: QTableWidgetItem) -> None:
        run = self._layers[item.row()].run
        if item.column() == EYE and run is not None:
            self.requested.emit("hide", run.path.name)

    def _cell(self, row: int, column: int) -> QTableWidgetItem:
        item = self.item(row, column)
        assert item is not None
        return item

    def _paint_letters(self) -> None:
        for row, each in enumerate(self._layers):
            tone = "model" if each.run is None else curve_tone(run_index(each))
            self._cell(row, LETTER).setForeground(QColor(color_of(tone)))


def _value_text(value: float, error: float) -> str:
    return (
        typeset(format_with_uncertainty(value, error)) if error > 0 and math.isfinite(value) else number_text(value, 4)
    )
