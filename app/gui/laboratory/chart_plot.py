"""Plot of a control chart: Shewhart chart with its limits above the EWMA, values that break a rule marked."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from app.common import number_text
from app.fleet import GoldenChart
from app.gui.plots import DASHED, DOTTED, SOLID, Chart, Layer, Panel, Picture, Region, Rule, axis_title, layer
from model import Array, Mask, format_quantity, shown_unit

LINE_NAMES = {-3: "−3 σ", -2: "", -1: "", 0: "Centre", 1: "", 2: "", 3: "+3 σ"}
EWMA = "EWMA"
SIZES = {"o": 9, "d": 12}
"""Of the symbols, in lengths of the design."""


class ControlChartPlot(Chart):
    """Values by their number; values that break a rule are filled diamonds with the rule in their text."""

    def __init__(self) -> None:
        super().__init__("control chart, single values above their weighted average")

    def show_chart(self, chart: GoldenChart, unit: str, title: str, quantity: str, about: str, simulated: bool) -> None:
        """Draw a chart of the values of a quantity in a unit; `about`: which runs they are of."""
        factor, bench_unit = shown_unit(unit)
        one = chart.chart
        x, y, average = np.arange(1, one.values.size + 1, dtype=float), factor * one.values, factor * one.average
        rules = [one.rules.get(at, ()) for at in range(one.values.size)]
        texts = [partial(_describe, chart, at, broken) for at, broken in enumerate(rules)]
        shewhart = np.array([any(rule != EWMA for rule in broken) for broken in rules], bool)
        ewma = np.array([EWMA in broken for broken in rules], bool)

        def marked(name: str, values: Array, mask: Mask, tone: str, symbol: str, panel: int = 0) -> Layer:
            there = [texts[at] for at in np.flatnonzero(mask)]
            look: dict[str, Any] = {
                "tone": tone,
                "symbol": symbol,
                "size": SIZES[symbol],
                "panel": panel,
                "group": name if panel == 0 else "",
            }
            return layer(name=name, x=x[mask], y=values[mask], texts=there, copied=False, **look)

        limit = factor * one.average_limit
        centre, sigma = factor * one.centre, factor * one.sigma
        layers = (
            layer(name="value", x=x, y=y, line=SOLID),
            marked("in control", y, ~shewhart, "ink", "o"),
            marked("signal", y, shewhart, "amber_text", "d"),
            layer(name=EWMA, x=x, y=average, line=SOLID, panel=1),
            layer(name=f"{EWMA}, upper limit", x=x, y=centre + limit, tone="green_text", line=DASHED, panel=1),
            layer(name=f"{EWMA}, lower limit", x=x, y=centre - limit, tone="green_text", line=DASHED, panel=1),
            marked("beyond the limits", average, ewma, "amber_text", "d", panel=1),
        )
        lines = tuple(
            Rule(at=centre + k * sigma, label=f"{name} {number_text(centre + k * sigma)}" if name else "", tone="green_text" if name else "text2", along_y=True,
                 style=SOLID if k == 0 else DASHED if abs(k) == 3 else DOTTED)
            for k, name in LINE_NAMES.items()
        )  # fmt: skip
        ends = ((one.baseline, "End of baseline", "text2"), (one.onset, "Lasting change", "amber_text"))
        lines += tuple(
            Rule(at=at + 0.5, label=text, tone=tone, style=DOTTED, marked=True)
            for at, text, tone in ends
            if 0 < at < one.values.size
        )
        self.show_picture(
            Picture(
                title=title, note=about, x_title="Number of the value, oldest first", log=(False, False), simulated=simulated, layers=layers,
                rules=(*lines, Rule(at=centre, along_y=True, panel=1, style=SOLID)), x=(0.0, one.values.size + 1.0),
                regions=(Region(low=centre - 3 * sigma, high=centre + 3 * sigma, tone="green_tint", along_y=True),),
                panels=(
                    Panel(title=axis_title(quantity, bench_unit), share=3, x_labels=False, low=centre - 3.3 * sigma, high=centre + 3.3 * sigma),
                    Panel(title=axis_title("weighted moving average (EWMA)", bench_unit), share=2),
                ),
            )
        )  # fmt: skip


def _describe(chart: GoldenChart, at: int, rules: Sequence[str]) -> str:
    value = chart.values[at]
    figure = format_quantity(value.value, value.total, value.unit, value.name)
    broken = f"\nbreaks: {', '.join(rules)}" if rules else ""
    return f"no. {at + 1}, {value.start_time[:10]}: {figure}{broken}"
