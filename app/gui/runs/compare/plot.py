"""Plot of a comparison: the layers of several runs over one axis, each with its letter."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from app.comparison import Comparison, ComparisonLayer
from app.gui.plots import (
    DASHED,
    MODEL_WIDTH,
    SOLID,
    Chart,
    Layer,
    Panel,
    Picture,
    Threshold,
    axis_title,
    curve_symbol,
    curve_tone,
    layer,
)
from model import Relation, Role, Series, shown_unit

FEW_RUNS = 3
"""Largest number of runs that are distinguished by symbols as well; more are distinguished by their letters."""
MAX_SYMBOLS = 120
"""Curves of more points have no symbols."""
FELT_QUANTITY = "peak to peak over frequency"
"""The quantity that has a threshold of perception."""


class ComparisonPlot(Chart):
    """Draws the layers of a comparison that are not hidden."""

    def __init__(self) -> None:
        super().__init__("comparison of the selected runs")
        self.comparison: Comparison | None = None
        self._threshold = Threshold()

    def show_comparison(self, comparison: Comparison | None, note: str = "") -> None:
        """Draw a comparison; None: nothing."""
        self.comparison = comparison
        if comparison is None or not comparison.layers:
            self.show_picture(Picture(empty="These runs have no curve in common"))
            return
        first = comparison.layers[0].series
        (over, x_unit), (factor, y_unit) = self.units(first)
        relation, reference = comparison.view.relation, comparison.reference.letter
        titles = {
            Relation.NORMALISED: "Share of the largest",
            Relation.RATIO: f"Ratio to {reference}",
            Relation.DIFFERENCE: axis_title(f"{_name(comparison.layers[0], 'y')} less {reference}", y_unit),
        }
        title = titles.get(relation, axis_title(_name(comparison.layers[0], "y"), y_unit))
        if comparison.view.over:
            title = f"Curves above each other over {comparison.view.over}: {title}"
        shown = [each for each in comparison.layers if not each.hidden]
        picture = Picture(
            note=note, x_title=axis_title(first.x_axis.name.replace("_", " "), x_unit), simulated=comparison.simulated,
            panels=(Panel(title=title, low=0.0 if relation is Relation.VALUES and _above_zero(shown) else None),),
            layers=tuple(self._layer(each, over, factor, (at + 0.5) / len(shown)) for at, each in enumerate(shown)),
        )  # fmt: skip
        felt = relation is Relation.VALUES and comparison.quantity == FELT_QUANTITY and not comparison.view.over
        self.show_picture(self._threshold.add_to(picture) if felt else picture)

    def set_cursors(self, places: Sequence[float]) -> None:
        """Set both cursors; none removes them."""
        self.tools.clear_cursors()
        for number, x in enumerate(places[:2]):
            self.tools.set_cursor(x, second=number > 0)

    def show_threshold(self, threshold: Any) -> None:
        """Show a perception threshold; None is the abdomen's."""
        self._threshold = Threshold.of(threshold)
        if self.comparison is not None:
            self.show_comparison(self.comparison, self.picture.note)

    @staticmethod
    def units(series: Series) -> tuple[tuple[float, str], tuple[float, str]]:
        """Return factor and unit of x and of y on the screen."""
        (over, x_unit), (factor, y_unit) = shown_unit(series.x_axis.unit), shown_unit(series.y_axis.unit)
        return (over, x_unit.removeprefix("1")), (factor, y_unit.removeprefix("1"))

    def _layer(self, each: ComparisonLayer, over: float, factor: float, share: float) -> Layer:
        assert self.comparison is not None
        series = each.series
        scaled = series.scaled(over, factor)
        if each.run is None:
            return layer(
                name=each.title, x=scaled.x, y=scaled.plotted, tone="model", line=DASHED, width=MODEL_WIDTH, label=each.name,
                band=None if scaled.total_errors is None else (scaled.plotted - 2 * scaled.total_errors, scaled.plotted + 2 * scaled.total_errors),
            )  # fmt: skip
        at = run_index(each)
        has_symbols = series.x.size <= MAX_SYMBOLS and series.role is Role.MEASURED
        few = len(self.comparison.runs) <= FEW_RUNS
        alone = len(self.comparison.runs) == 1
        return layer(
            name=each.title, x=scaled.x, y=scaled.plotted, errors=scaled.total_errors if has_symbols else None, tone=curve_tone(at),
            line=SOLID, symbol=(curve_symbol(at) if few else "o") if has_symbols else "", size=8 if few else 5,
            label="" if alone else each.title if few else each.name, label_at=None if few else share,
        )  # fmt: skip


def run_index(each: ComparisonLayer) -> int:
    """Return the place of the run of a layer, 0 for the first."""
    return 0 if each.run is None else ord(each.run.letter) - ord("A")


def _name(each: ComparisonLayer, axis: str) -> str:
    series = each.series
    return (series.y_axis if axis == "y" else series.x_axis).name.replace("_", " ")


def _above_zero(layers: list[ComparisonLayer]) -> bool:
    return all(np.nanmin(each.series.plotted, initial=0.0) >= 0 for each in layers)
