"""Summary of a run's result for the result card: verdict, quantities, points where nothing is identified, hints."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from app.common.formatting import axis_name, typeset
from model import LENGTH_UNITS, format_quantity, format_uncertainty, format_value, quantity_label, shown_unit
from protocols.base import INTERFERENCE_AT_REST, EstimatedQuantity, Quality, RunFigure, Verdict
from protocols.runfile import is_response, point_columns

if TYPE_CHECKING:
    from protocols.base import Protocol

MAX_POINT_ROWS = 12
"""Points that are listed; the file has all."""

MIN_POINTS_OF_LARGEST = 3
"""Fewer usable points are no response with a largest value."""


class ResultLine(NamedTuple):
    """A quantity of a run as text in display units.

    Attributes:
        figure: value, rounded to the first digit of its largest known uncertainty.
        text: value with its statistical standard error.
        statistical: this error alone; empty without one.
        total: standard uncertainty, with the uncertainty of the sensor's gain; empty if the gain has no effect.
        statistical_share: statistical over total, 0 to 1; 1 without a total.
    """

    name: str
    figure: str
    unit: str
    text: str
    statistical: str = ""
    total: str = ""
    statistical_share: float = 1.0


@dataclass(frozen=True, slots=True)
class ResultSummary:
    """Contents of the result card of a run.

    Attributes:
        reason: end of the run, for the reasons of the verdict.
        lines: the protocol's own results, the key figure first, and the largest response of points over frequency.
        others: further estimates of every run, likewise.
        point_names: names of the two axes; of the columns of `points`.
        points: the usable points of a run without identified quantities: values on both axes, with errors.
        hints: the protocol's warnings about the points, for the next run.
        usable: number of usable points.
        planned: number of planned points; 0 if unknown.
    """

    verdict: Verdict
    reason: str
    lines: tuple[ResultLine, ...]
    point_names: tuple[str, str] = ("", "")
    points: tuple[tuple[str, str], ...] = ()
    hints: tuple[str, ...] = ()
    path: str = ""
    simulated: bool = False
    measured: int = 0
    planned: int = 0
    usable: int = 0
    others: tuple[ResultLine, ...] = ()


def summarize_result(
    verdict: Verdict,
    reason: str,
    estimates: Sequence[EstimatedQuantity],
    kind: "type[Protocol] | None",
    points: Sequence[Any],
    hints: Sequence[str] = (),
    path: str = "",
    simulated: bool = False,
    planned: int = 0,
    gain_uncertainty: float = 0.0,
) -> ResultSummary:
    """Return the summary of a run; without estimates it lists the points on the axes of the protocol.

    `gain_uncertainty` is the relative standard uncertainty of the displacement sensor's gain.
    """
    own, others = (
        [_result_line(each, gain_uncertainty) for each in estimates if (each.name == INTERFERENCE_AT_REST) is other]
        for other in (False, True)
    )
    listed = kind is not None and not own
    x_name, y_name = kind.axes if listed and kind is not None else ("", "")
    return ResultSummary(
        verdict=verdict,
        reason=reason,
        lines=(*own[:1], *_largest_response(points, gain_uncertainty), *own[1:]),
        point_names=(axis_name(x_name), axis_name(y_name)),
        points=_point_rows(kind, points) if listed and kind is not None else (),
        hints=tuple(hints),
        path=path,
        simulated=simulated,
        measured=len(points),
        planned=planned,
        usable=sum(Quality(point.quality).usable for point in points),
        others=tuple(others),
    )


def run_figure(estimate: EstimatedQuantity, gain: float) -> RunFigure:
    """Return the figure of an estimate; a relative uncertainty of the sensor's gain acts on lengths only."""
    gain = gain if estimate.unit in LENGTH_UNITS else 0.0
    return RunFigure.with_gain(estimate.name, estimate.value, estimate.standard_error, estimate.unit, gain)


def natural_frequency_of(estimates: Iterable[EstimatedQuantity]) -> float:
    """Return the identified natural frequency, Hz; NaN without one."""
    return next((float(each.value) for each in estimates if each.name == "natural_frequency"), math.nan)


def round_figure(value: float, uncertainty: float) -> str:
    """Return a value as text, rounded to the first digit of its uncertainty; to five digits without one."""
    if not (uncertainty > 0 and math.isfinite(uncertainty)):
        return f"{value:.5g}"
    return f"{value:z.{max(-math.floor(math.log10(uncertainty)), 0)}f}"


def _result_line(estimate: EstimatedQuantity, gain_uncertainty: float, label: str = "") -> ResultLine:
    factor, unit = shown_unit(estimate.unit, estimate.name)
    value, statistical = factor * estimate.value, factor * estimate.standard_error
    has_error = statistical > 0 and math.isfinite(statistical)
    with_gain = has_error and estimate.unit in LENGTH_UNITS and gain_uncertainty > 0
    total = factor * run_figure(estimate, gain_uncertainty).total if with_gain else statistical
    unit = typeset(unit)
    return ResultLine(
        label or typeset(quantity_label(estimate.name)),
        round_figure(value, total),
        unit,
        typeset(format_value(estimate)),
        format_uncertainty(statistical, unit) if has_error else "",
        format_uncertainty(total, unit) if with_gain else "",
        statistical / total if with_gain else 1.0,
    )


def _largest_response(points: Sequence[Any], gain_uncertainty: float) -> Iterator[ResultLine]:
    """Yield the largest peak-to-peak displacement of usable points over frequency."""
    usable = [p for p in points if is_response(p) and Quality(p.quality).usable and math.isfinite(p.peak_to_peak)]
    if len(usable) >= MIN_POINTS_OF_LARGEST:
        top = max(usable, key=lambda point: float(point.peak_to_peak))
        error = float(getattr(top, "peak_to_peak_errors", math.nan))
        largest = EstimatedQuantity("largest response", float(top.peak_to_peak), error, "m", "")
        yield _result_line(largest, gain_uncertainty, f"largest response, at {top.frequency:.4g} Hz")


def _point_rows(kind: "type[Protocol]", points: Sequence[Any]) -> tuple[tuple[str, str], ...]:
    units = {name: column[0] for name, column in point_columns(kind.point_type).items()}
    rows = []
    for point in points:
        values = [getattr(point, name, math.nan) for name in kind.axes]
        if not Quality(point.quality).usable or not all(
            isinstance(v, int | float) and math.isfinite(v) for v in values
        ):
            continue
        error = float(getattr(point, f"{kind.axes[1]}_errors", math.nan))
        factor, unit = shown_unit(units[kind.axes[0]])
        y_factor, y_unit = shown_unit(units[kind.axes[1]])
        height = (
            format_quantity(values[1], error, units[kind.axes[1]])
            if math.isfinite(error)
            else f"{y_factor * values[1]:.5g} {y_unit}"
        )
        rows.append((f"{factor * values[0]:.5g} {unit}".strip(), height.strip()))
    return tuple(rows)
