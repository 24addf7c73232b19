"""Plot of a quantity of many specimens over time, by group, with mean, spread, limits and outliers."""

from functools import partial

import numpy as np

from app.common import typeset
from app.fleet import FleetValue, FleetView
from app.gui.plots import (
    DASHED,
    DOTTED,
    RING,
    SOLID,
    Chart,
    Panel,
    Picture,
    Rule,
    axis_title,
    curve_symbol,
    curve_tone,
    layer,
)
from model import format_quantity, shown_unit

MAX_BARS = 400
"""Largest number of values with error bars: more bars hide the points."""

MAX_GROUPS = 12


class FleetPlot(Chart):
    """A symbol for each value, ringed if the specimen is an outlier or selected."""

    def __init__(self) -> None:
        super().__init__("values of many specimens over time")
        self._view: FleetView | None = None
        self._specimen = ""
        self._draw_view()

    def show_view(self, view: FleetView | None) -> None:
        self._view = view
        self._draw_view()

    def show_specimen(self, specimen: str) -> None:
        """Ring the values of a specimen; empty for none."""
        self._specimen = specimen
        self._draw_view()

    def _draw_view(self) -> None:
        view = self._view
        if view is None:
            self.show_picture(Picture(x_title="Day of the run", dates=True, log=(False, False), empty="No values"))
            return
        factor, unit = shown_unit(view.selection.unit, view.selection.name)
        with_bars = sum(group.x.size for group, _ in view.groups) <= MAX_BARS
        layers = []
        for at, (group, values) in enumerate(view.groups):
            shown = group.scaled(1.0, factor)
            layers.append(
                layer(
                    name=shown.title, x=shown.x, y=shown.y, errors=shown.total_errors if with_bars else None,
                    tone=curve_tone(at), symbol=curve_symbol(at), size=7, texts=[partial(_describe, v) for v in values],
                    group=group.name if 1 < len(view.groups) <= MAX_GROUPS else "",
                )
            )  # fmt: skip
        newest = [v for v in view.selection.newest if v.specimen in view.outliers]
        chosen = [v for v in view.selection.values if v.specimen == self._specimen] if self._specimen else []
        for name, rings, tone, size in (
            ("outliers", newest, "amber_text", 15),
            ("selected", chosen, "accent_text", 19),
        ):
            x = np.array([v.time_s for v in rings], float)
            y = factor * np.array([v.value for v in rings], float)
            layers.append(layer(name=name, x=x, y=y, symbol=RING, size=size, tone=tone, copied=False))
        ends = [rule.at for rule in self._rules(view, factor)]
        self.show_picture(
            Picture(
                note=view.selection.about, x_title="Day of the run", dates=True, log=(False, False), layers=tuple(layers),
                panels=(Panel(title=axis_title(typeset(view.selection.label), unit), low=min(ends), high=max(ends)),),
                rules=self._rules(view, factor), simulated=view.simulated,
            )
        )  # fmt: skip

    @staticmethod
    def _rules(view: FleetView, factor: float) -> tuple[Rule, ...]:
        mean, sd = factor * view.spread.mean, factor * view.spread.sd
        lines = [(mean, "Mean", "text", SOLID)]
        if np.isfinite(sd):
            lines += [(mean + side * sd, f"{'+' if side > 0 else '−'}1 sd", "text2", DOTTED) for side in (1, -1)]
        for value, name in zip(view.bounds or (), ("Lower limit", "Upper limit"), strict=False):
            if value is not None:
                lines.append((factor * value, name, "green_text", DASHED))
        return tuple(Rule(at=at, label=name, tone=tone, style=style, along_y=True) for at, name, tone, style in lines)


def _describe(value: FleetValue) -> str:
    """Return the text of a point, only for the point at the pointer, because there may be ten thousand."""
    figure = format_quantity(value.value, value.total, value.unit, value.name)
    return f"{value.specimen}, {value.start_time[:10]}: {figure}\n{value.batch}, {value.sensor or value.protocol}"
