"""Picture and export of a comparison: matplotlib, and every format of a run's export."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from app.archive import Format, export_run
from app.comparison.comparison import Comparison, ComparisonLayer
from app.plotting import POINT_COLORS, axis_label, mark_simulated, new_figure
from model import Array, Role, Series, shown_unit
from protocols.runfile import RunRecord

WIDTH_IN, HEIGHT_IN, DPI = 11.0, 6.5, 120
MODEL_COLOR = "#000000"


class ComparisonExport:
    """A comparison as the exporters take a run: its layers are the series, without points and samples."""

    mountings = ()

    def __init__(self, comparison: Comparison, name: str) -> None:
        view, first = comparison.view, comparison.runs[0].summary
        self.path = comparison.runs[0].path.with_name(f"{name}.h5")
        self.trace: Any = SimpleNamespace(rate_hz=0.0, sample_count=0, further_channels={})
        self._layers = [each for each in comparison.layers if not each.hidden]
        about = {
            "quantity": comparison.quantity,
            "relation": str(view.relation),
            "reference": comparison.reference.path.name if view.relation.has_reference else "",
            "waterfall_over": view.over,
            **{run.letter: run.path.name for run in comparison.runs},
        }
        self.record = RunRecord(
            protocol="comparison", title=f"Comparison of {len(comparison.runs)} runs",
            specimen=", ".join(dict.fromkeys(run.summary.specimen for run in comparison.runs)),
            start_time=first.start_time, simulated=comparison.simulated, parameters=about, estimates=comparison.estimates(),
        )  # fmt: skip

    def points(self) -> dict[str, Array]:
        """Return no points."""
        return {}

    def units(self) -> dict[str, str]:
        """Return no units of points."""
        return {}

    def events(self, *_kinds: str) -> Iterator[Any]:
        """Return no events."""
        return iter(())

    def earlier_runs(self) -> list[Path]:
        """Return no earlier runs."""
        return []

    def series(self) -> tuple[Series, ...]:
        """Return the shown layers, named after the relation and labelled with their letters."""
        return tuple(
            replace(layer.series, y=layer.series.plotted, name="comparison", label=layer.title, entry=number)
            for number, layer in enumerate(self._layers)
            if layer.series.x.size
        )


def export_comparison(comparison: Comparison, folder: Path, kind: Format, name: str = "comparison") -> list[Path]:
    """Write the shown values with their uncertainties, and the estimates, in a format; return the files.

    Raises:
        ExportError: a file cannot be written, or the format cannot hold the values.
    """
    return export_run(ComparisonExport(comparison, name), folder, kind, ("about", "series", "estimates"))


def draw_comparison(comparison: Comparison, path: Path) -> None:
    """Draw the shown layers into a PNG, PDF or SVG file, each with its letter; a simulated run marks it SIMULATED.

    Raises:
        OSError: the picture cannot be written.
    """
    figure = new_figure(figsize=(WIDTH_IN, HEIGHT_IN), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    shown = [layer for layer in comparison.layers if not layer.hidden and np.isfinite(layer.series.plotted).any()]
    colors = _colors(len(shown))
    for at, (layer, color) in enumerate(zip(shown, colors, strict=True)):
        _draw_layer(axes, layer, MODEL_COLOR if layer.run is None else color, (at + 0.5) / max(len(shown), 1))
    if shown:
        first = shown[0].series
        (_, x_unit), (_, y_unit) = shown_unit(first.x_axis.unit), shown_unit(first.y_axis.unit)
        offset = ", each curve a step above the one before" if comparison.view.over else ""
        axes.set(
            xlabel=axis_label(first.x_axis, x_unit), ylabel=axis_label(first.y_axis, y_unit.replace("1", "")) + offset
        )
        axes.legend(loc="upper left", bbox_to_anchor=(1, 1), fontsize=8, frameon=False)
    axes.grid(color="#dddddd", lw=0.5)
    relation, reference = comparison.view.relation, comparison.reference
    against = f" to {reference.letter} {reference.title}" if relation.has_reference else ""
    axes.set_title(f"{comparison.quantity}, {relation}{against}", fontsize=10, loc="left", parse_math=False)
    if comparison.simulated:
        mark_simulated(figure)
    figure.savefig(path)


def _draw_layer(axes: Any, layer: ComparisonLayer, color: Any, share: float) -> None:
    series = layer.series
    (over, _), (factor, _) = shown_unit(series.x_axis.unit), shown_unit(series.y_axis.unit)
    x, y = over * series.x, factor * series.plotted
    line = "--" if series.role is Role.MODEL else "-"
    axes.plot(x, y, line, color=color, lw=1.2, marker="" if x.size > 100 else "o", ms=3, label=layer.title)
    if series.total_errors is not None:
        errors = factor * np.nan_to_num(series.total_errors)
        axes.fill_between(x, y - errors, y + errors, color=color, alpha=0.2, lw=0)
    there = np.flatnonzero(np.isfinite(y))
    at = there[min(math.floor(share * there.size), there.size - 1)]
    halo = {"boxstyle": "circle,pad=0.15", "fc": "white", "ec": color, "lw": 0.8}
    axes.annotate(
        layer.name, (x[at], y[at]), color=color, fontsize=8, weight="bold", ha="center", va="center", bbox=halo
    )


def _colors(count: int) -> Sequence[Any]:
    return [POINT_COLORS[at % len(POINT_COLORS)] for at in range(count)]
