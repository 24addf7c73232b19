"""Tables of many specimens and of control charts, for command line and window."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from app.common import Column, Table, pluralize
from app.fleet.catalogue_values import Fleet, FleetSelection, FleetValue, arrays
from app.fleet.control_chart import VALUES_PER_FALSE_ALARM
from app.fleet.drift import DriftCause, GoldenChart, SensorDrift
from app.fleet.statistics import Capability, Spread, Trend, by_group, capability, outlier_mask, spread_of, trend_of
from model import Array, format_quantity, format_with_uncertainty, shown_unit

DRIFT_MARK = "†"
"""Of values measured on a drifting sensor."""

Bounds = tuple[float | None, float | None]
"""Lower and upper limit, SI; None for no limit."""


class _QuantityRow(NamedTuple):
    """Figures of one quantity over the newest values of all specimens."""

    selection: FleetSelection
    spread: Spread
    outliers: Sequence[str]
    capability: Capability | None

    def shown(self, value: float) -> str:
        """Return a value of the quantity in its display unit; empty for none."""
        factor = shown_unit(self.selection.unit, self.selection.name)[0]
        return f"{factor * value:.5g}" if math.isfinite(value) else ""


def _quantity_row(selection: FleetSelection, limit: Bounds | None) -> _QuantityRow:
    newest = selection.newest
    values, errors = arrays(newest)
    outliers = [v.specimen for v, out in zip(newest, outlier_mask(values), strict=True) if out]
    index = None if limit is None else capability(values, [v.batch for v in newest], *limit)
    return _QuantityRow(selection, spread_of(values, errors), outliers, index)


def quantity_table(selections: Sequence[FleetSelection], limits: Mapping[str, Bounds]) -> Table:
    """Return a row for each quantity: mean, spread, outliers and capability of the newest values."""
    rows = [_quantity_row(selection, limits.get(selection.name)) for selection in selections]
    return Table(
        "quantities",
        "Newest value of each specimen",
        (
            Column("quantity", None, [s.name for s in selections], displayed=False),
            Column("name", None, [s.label for s in selections], "quantity"),
            Column("source", None, [s.about for s in selections], "from"),
            Column("shown_unit", None, [shown_unit(s.unit, s.name)[1] for s in selections], "unit"),
            Column("specimens", None, [r.spread.count for r in rows], format_spec="d"),
            Column("shown_mean", None, [r.shown(r.spread.mean) for r in rows], "mean"),
            Column("shown_sd", None, [r.shown(r.spread.sd) for r in rows], "spread (1 sd)"),
            Column("shown_error", None, [r.shown(r.spread.mean_uncertainty) for r in rows], "of it by measurement"),
            Column("outliers", None, [", ".join(r.outliers) for r in rows]),
            *_capability_columns([r.capability for r in rows]),
            Column("mean", None, [r.spread.mean for r in rows], displayed=False),
            Column("sd", None, [r.spread.sd for r in rows], displayed=False),
            Column("true_sd", None, [r.spread.true_sd for r in rows], displayed=False),
            Column("mean_total_uncertainty", None, [r.spread.mean_uncertainty for r in rows], displayed=False),
            Column("median", None, [r.spread.median for r in rows], displayed=False),
            Column("unit", None, [s.unit for s in selections], displayed=False),
        ),
    )


def _capability_columns(capabilities: Sequence[Capability | None]) -> Iterator[Column]:
    """Yield the columns of capability, if a quantity has limits."""
    if any(capabilities):
        yield Column("cpk", None, [(c and _index(c.cpk, c.cpk_error)) or "" for c in capabilities], "Cpk, 95 %")
        yield Column("ppk", None, [(c and _index(c.ppk, c.ppk_error)) or "" for c in capabilities], "Ppk, 95 %")
        yield Column("outside", None, ["" if c is None else str(c.outside) for c in capabilities], "outside")


def _index(value: float, error: float) -> str:
    return format_with_uncertainty(value, error) if math.isfinite(value) else "no spread"


def specimen_table(selections: Sequence[FleetSelection], drifts: Mapping[str, SensorDrift] | None = None) -> Table:
    """Return a row for each specimen: its newest values with total uncertainty; values on a drifting sensor are marked."""
    drifts = drifts or {}
    newest = [{v.specimen: v for v in selection.newest} for selection in selections]
    specimens = sorted({name for each in newest for name in each})
    last = {
        name: max((each[name] for each in newest if name in each), key=lambda v: v.start_time) for name in specimens
    }
    counts = [len({v.path for s in selections for v in s.values if v.specimen == name}) for name in specimens]
    columns = [
        Column("specimen", None, specimens),
        Column("batch", None, [last[name].batch for name in specimens]),
        Column("last", None, [last[name].start_time[:10] for name in specimens], "last run"),
        Column("runs", None, counts, format_spec="d"),
    ]
    for selection, values in zip(selections, newest, strict=True):
        columns += _value_columns(selection, [values.get(name) for name in specimens], drifts)
    note = "; ".join(f"{DRIFT_MARK} {sensor} {drift.text}" for sensor, drift in drifts.items())
    return Table("specimens", "Specimens, with total standard uncertainties", tuple(columns), note=note)


def _marked(value: FleetValue, drifts: Mapping[str, SensorDrift]) -> str:
    drift = drifts.get(value.sensor)
    mark = f" {DRIFT_MARK}" if drift is not None and value.start_time >= drift.since else ""
    return format_quantity(value.value, value.total, value.unit, value.name) + mark


def _value_columns(
    selection: FleetSelection, values: Sequence[FleetValue | None], drifts: Mapping[str, SensorDrift]
) -> Iterator[Column]:
    """Yield the newest value of each specimen as text, as a number, and its uncertainty."""
    texts = ["" if v is None else _marked(v, drifts) for v in values]
    yield Column(f"{selection.name} as text", None, texts, selection.label)
    for name, attribute in ((selection.name, "value"), (f"{selection.name} total uncertainty", "total")):
        yield Column(name, selection.unit, [getattr(v, attribute, math.nan) for v in values], displayed=False)


def group_table(selection: FleetSelection, by: str) -> Table:
    """Return mean and spread of a quantity by batch, bench, month and so on, of all values."""
    values, errors = arrays(selection.values)
    groups = by_group(values, errors, [str(getattr(v, by)) or "unknown" for v in selection.values])
    spreads, shown = list(groups.values()), selection.display_unit
    return Table(
        f"{selection.name} by {by}",
        f"{selection.label} by {by}, all values",
        (
            Column(by, None, list(groups)),
            Column("values", None, [s.count for s in spreads], format_spec="d"),
            Column("mean", selection.unit, [s.mean for s in spreads], display_unit=shown),
            Column("sd", selection.unit, [s.sd for s in spreads], "spread (1 sd)", display_unit=shown, missing=""),
            Column("lowest", selection.unit, [s.lowest for s in spreads], display_unit=shown),
            Column("highest", selection.unit, [s.highest for s in spreads], display_unit=shown),
        ),
    )


def fleet_notes(fleet: Fleet, selections: Sequence[FleetSelection]) -> list[str]:
    """Return significant trends, omissions, and explanations of the tables, as sentences."""
    notes = []
    for selection in selections:
        values, _ = arrays(selection.values)
        trend = trend_of(times_of(selection), values)
        if trend is not None and trend.is_significant:
            notes.append(f"{selection.label}: trend {format_trend(selection, trend)} in 30 days over all values")
        if selection.left_out:
            notes.append(
                f"{selection.label}: {pluralize(selection.left_out, 'value')} of other protocols or drives left out"
            )
    if fleet.left_out:
        notes.append(f"{fleet.left_out} values of {'real' if fleet.simulated else 'simulated'} runs are left out")
    notes.append("Cpk: spread within batches; Ppk: overall spread. An outlier has a modified z-score above 3.5")
    return notes


def format_trend(selection: FleetSelection, trend: Trend) -> str:
    """Format a trend in 30 days relative to the mean of all values: `+1.20 ± 0.31 %`."""
    share = 100 / abs(float(arrays(selection.values)[0].mean()))
    return format_with_uncertainty(trend.per_month * share, trend.error * share, "%", signed=True)


def times_of(selection: FleetSelection) -> Array:
    """Return the times of the values in seconds since 1970, (N,)."""
    return np.array([v.time_s for v in selection.values])


def verdict_table(selection: FleetSelection, golden: str, charts: Sequence[GoldenChart]) -> Table:
    """Return a row for each sensor: centre, sigma, first signal with its rules, and cause of the drift."""
    first, shown = [each.first_signal for each in charts], selection.display_unit
    return Table(
        "charts",
        f"{selection.label} of {golden}, {selection.about}",
        (
            Column("sensor", None, [each.sensor or "unknown" for each in charts]),
            Column("values", None, [len(each.values) for each in charts], format_spec="d"),
            Column("baseline", None, [each.chart.baseline for each in charts], format_spec="d"),
            Column("centre", selection.unit, [each.chart.centre for each in charts], display_unit=shown),
            Column(
                "sigma", selection.unit, [each.chart.sigma for each in charts], display_unit=shown, format_spec=".3g"
            ),
            Column(
                "first_signal",
                None,
                ["" if at is None else each.values[at].start_time[:10] for each, at in zip(charts, first, strict=True)],
                "first signal",
            ),
            Column("rules", None, [_rules_text(each, at) for each, at in zip(charts, first, strict=True)]),
            Column("cause", None, [str(each.cause) for each in charts], "drift of"),
        ),
    )


def _rules_text(chart: GoldenChart, at: int | None) -> str:
    return "" if at is None else ", ".join(chart.chart.rules.get(at, ()))


def chart_table(selection: FleetSelection, charts: Sequence[GoldenChart]) -> Table:
    """Return a row for each value of the charts, with the rules that it breaks."""
    rows = [(each, i, value) for each in charts for i, value in enumerate(each.values)]
    unit = selection.unit
    return Table(
        "points",
        "Values of the control charts",
        (
            Column("sensor", None, [v.sensor for *_, v in rows]),
            Column("start_time", None, [v.start_time for *_, v in rows]),
            Column("value", unit, [v.value for *_, v in rows]),
            Column("total_uncertainty", unit, [v.total for *_, v in rows]),
            Column("centre", unit, [each.chart.centre for each, *_ in rows]),
            Column("sigma", unit, [each.chart.sigma for each, *_ in rows]),
            Column("ewma", unit, [each.chart.average[i] for each, i, _ in rows]),
            Column("ewma_limit", unit, [each.chart.average_limit[i] for each, i, _ in rows]),
            Column("rules", None, [_rules_text(each, i) for each, i, _ in rows]),
            Column("run", None, [v.path for *_, v in rows]),
        ),
    )


def chart_notes(charts: Sequence[GoldenChart]) -> list[str]:
    """Return the cause of each drift with its evidence, and how often the rules signal by chance, as sentences."""
    notes = []
    for each in charts:
        if each.cause is DriftCause.NO_LASTING_CHANGE:
            notes.append(f"{each.sensor}: {each.cause}; a rule is broken, and the mean before and after is the same")
        elif each.evidence:
            where = f"drift of the {each.cause}" if each.cause in ("bench", "specimen") else f"cause {each.cause}"
            notes.append(f"{each.sensor}: {where}: {'; '.join(each.evidence)}")
    count = sum(len(each.values) for each in charts)
    notes.append(
        f"By chance alone the rules of Western Electric signal once in {VALUES_PER_FALSE_ALARM} values; there are {count}"
    )
    return notes
