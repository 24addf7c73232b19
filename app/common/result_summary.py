"""Summary of a run's result for the result card: verdict, quantities, points where nothing is identified, hints."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from app.common.formatting import axis_name, typeset
from model import LENGTH_UNITS, format_quantity, format_uncertainty, format_value, quantity_label, shown_unit
from protocols.base import INTERFERENCE_AT_REST, EstimatedQuantity, Protocol, Quality, Verdict
from protocols.runfile import point_columns

MAX_POINT_ROWS = 12
"""Points that are listed; the file has all."""


@dataclass(frozen=True, slots=True)
class ResultSummary:
    """Contents of the result card of a run.

    Attributes:
        reason: end of the run, for the reasons of the verdict.
        quantities: the protocol's own results: name and value with its standard error, in display units.
        totals: standard uncertainty of each quantity, with the uncertainty of the sensor's gain, as text; empty if the gain has
            no effect.
        others: further estimates of every run, likewise.
        point_names: names of the two axes; of the columns of `points`.
        points: the usable points of a run without identified quantities: values on both axes, with errors.
        hints: the protocol's warnings about the points, for the next run.
        planned: number of planned points; 0 if unknown.
    """

    verdict: Verdict
    reason: str
    quantities: tuple[tuple[str, str], ...]
    point_names: tuple[str, str] = ("", "")
    points: tuple[tuple[str, str], ...] = ()
    hints: tuple[str, ...] = ()
    path: str = ""
    simulated: bool = False
    measured: int = 0
    planned: int = 0
    others: tuple[tuple[str, str], ...] = ()
    totals: tuple[str, ...] = ()


def summarize_result(
    verdict: Verdict,
    reason: str,
    estimates: Sequence[EstimatedQuantity],
    kind: type[Protocol] | None,
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
    own = [each for each in estimates if each.name != INTERFERENCE_AT_REST]
    others = [each for each in estimates if each.name == INTERFERENCE_AT_REST]
    listed = kind is not None and not own
    x_name, y_name = kind.axes if listed and kind is not None else ("", "")
    return ResultSummary(
        verdict=verdict,
        reason=reason,
        quantities=_name_and_value(own),
        point_names=(axis_name(x_name), axis_name(y_name)),
        points=_point_rows(kind, points) if listed and kind is not None else (),
        hints=tuple(hints),
        path=path,
        simulated=simulated,
        measured=len(points),
        planned=planned,
        others=_name_and_value(others),
        totals=tuple(_total_text(e, gain_uncertainty) for e in own),
    )


def _total_text(estimate: EstimatedQuantity, gain_uncertainty: float) -> str:
    if estimate.unit not in LENGTH_UNITS or not gain_uncertainty > 0:
        return ""
    factor, unit = shown_unit(estimate.unit, estimate.name)
    total = factor * math.hypot(estimate.standard_error, gain_uncertainty * estimate.value)
    return f"{format_uncertainty(total, typeset(unit))} with gain"


def _name_and_value(estimates: Sequence[EstimatedQuantity]) -> tuple[tuple[str, str], ...]:
    return tuple((typeset(quantity_label(e.name)), typeset(format_value(e))) for e in estimates)


def _point_rows(kind: type[Protocol], points: Sequence[Any]) -> tuple[tuple[str, str], ...]:
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
