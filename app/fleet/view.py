"""Views of many specimens for the window: selection by a filter, with its tables, its groups for a plot, and control charts."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.archive import read_since
from app.common import Column, Table, sentence_case
from app.fleet.catalogue_values import CALIBRATION, Fleet, FleetError, FleetSelection, FleetValue, arrays
from app.fleet.control_chart import BASELINE
from app.fleet.drift import GoldenChart, golden_charts, sensor_drifts
from app.fleet.statistics import Spread, outlier_mask, spread_of, trend_of
from app.fleet.summary_tables import (
    Bounds,
    chart_notes,
    chart_table,
    format_trend,
    group_table,
    quantity_table,
    specimen_table,
    times_of,
)
from model import Series

MAX_SPECIMEN_QUANTITIES = 4
"""Quantities in the table of the specimens: more do not fit beside each other at 900 points."""


@dataclass(frozen=True)
class FleetQuery:
    """Filter of the page; empty texts select all.

    Attributes:
        quantity: by its name; empty for the quantity of most specimens.
        search: words; each must be in the name of a specimen, sensor or bench.
        since: as `read_since` reads it.
        group_by: one of `app.fleet.catalogue_values.GROUPS`.
    """

    quantity: str = ""
    batch: str = ""
    search: str = ""
    since: str = ""
    group_by: str = "batch"


@dataclass(frozen=True)
class FleetView:
    """Selection of a query.

    Attributes:
        groups: every value of the quantity in SI over seconds since 1970, by group, and the values themselves.
        outliers: specimens whose newest value is a possible outlier.
        summary: a row for each statistic of the quantity.
        by_group: mean and spread of each group.
        specimens: a row for each specimen; the rows of outliers are highlighted.
    """

    selection: FleetSelection
    spread: Spread
    groups: tuple[tuple[Series, tuple[FleetValue, ...]], ...]
    outliers: frozenset[str]
    bounds: Bounds | None
    summary: Table
    by_group: Table
    specimens: Table
    simulated: bool


def view_fleet(fleet: Fleet, query: FleetQuery, limits: Mapping[str, Bounds], golden: str = "") -> FleetView:
    """Return the selection of a query; `golden` is the specimen whose charts find drifting sensors.

    Raises:
        FleetError: the selection is empty.
    """
    search_words = query.search.casefold().split()
    chosen = fleet.filtered(batch=query.batch, since=read_since(query.since) if query.since else "")
    if search_words:
        kept = tuple(v for v in chosen.values if _has_words(v, search_words))
        chosen = replace(chosen, values=kept)
    if not chosen.values:
        raise FleetError("no value matches the whole selection; select less")
    present = chosen.names
    name = query.quantity or present[0]
    if name not in present:
        raise FleetError(f"no run that is selected has '{name}'; select another quantity, or less")
    selection = chosen.of(name)
    others = [other for other in present if other != name]
    shown = [selection, *(chosen.of(other) for other in others[: MAX_SPECIMEN_QUANTITIES - 1])]
    values, errors = arrays(selection.newest)
    mask = outlier_mask(values)
    outliers = frozenset(v.specimen for v, out in zip(selection.newest, mask, strict=True) if out)
    specimens = specimen_table(shown, sensor_drifts(fleet, golden))
    marked = frozenset(at for at, each in enumerate(specimens.columns[0].values) if each in outliers)
    return FleetView(
        selection,
        spread_of(values, errors),
        tuple(_plot_groups(selection, query.group_by)),
        outliers,
        limits.get(selection.name),
        _summary_table(selection, limits),
        _without_extremes(group_table(selection, query.group_by)),
        replace(specimens, highlighted_rows=marked),
        fleet.simulated,
    )


def _has_words(value: FleetValue, search_words: Sequence[str]) -> bool:
    text = f"{value.specimen} {value.sensor} {value.bench}".casefold()
    return all(word in text for word in search_words)


def _plot_groups(selection: FleetSelection, group_by: str) -> list[tuple[Series, tuple[FleetValue, ...]]]:
    members: dict[str, list[FleetValue]] = {}
    for value in selection.values:
        members.setdefault(str(getattr(value, group_by)) or "unknown", []).append(value)
    groups = []
    for name, own in sorted(members.items()):
        values, errors = arrays(own)
        times_s = np.array([v.time_s for v in own])
        groups.append((Series(times_s, values, total_errors=errors, name=name), tuple(own)))
    return groups


def _without_extremes(table: Table) -> Table:
    """Return a table of groups without lowest and highest value, which the plot shows."""
    return replace(table, columns=tuple(c for c in table.columns if c.name not in ("lowest", "highest")))


def _summary_table(selection: FleetSelection, limits: Mapping[str, Bounds]) -> Table:
    """Return the statistics of one quantity, a row each."""
    table = quantity_table([selection], limits)
    cells = zip(table.headings, table.text_rows[0], table.columns, strict=True)
    shown = [(heading, text) for heading, text, column in cells if column.displayed and column.name != "name"]
    values, _ = arrays(selection.values)
    if (trend := trend_of(times_of(selection), values)) is not None:
        shown.append(("trend in 30 days", format_trend(selection, trend)))
    if selection.left_out:
        shown.append(("not compared", f"{selection.left_out} of another protocol or drive"))
    rows = [(sentence_case(name), text) for name, text in shown if text]
    return Table.of_rows(f"{selection.label}, newest values", ("statistic", "value"), rows)


@dataclass(frozen=True)
class ChartView:
    """Control charts of a golden specimen, one for each sensor.

    Attributes:
        broken: for each chart the values that break a rule, with date, value, rules and run.
        notes: causes of drifts, and the rate of chance signals of the rules.
        points: of all charts, for export.
    """

    selection: FleetSelection
    golden: str
    charts: tuple[GoldenChart, ...]
    broken: tuple[Table, ...]
    notes: tuple[str, ...]
    points: Table
    simulated: bool


def golden_candidates(fleet: Fleet) -> tuple[str, ...]:
    """Return the specimens by the number of runs with a result, most first."""
    counts = Counter(name for name, _ in {(v.specimen, v.path) for v in fleet.values if v.protocol != CALIBRATION})
    return tuple(sorted(counts, key=lambda name: (-counts[name], name)))


def view_charts(fleet: Fleet, golden: str, quantity: str, baseline: int = BASELINE) -> ChartView:
    """Return the control charts of a quantity of the golden specimen.

    Raises:
        FleetError: no run has the quantity.
        TooFewValuesError: no sensor measured it often enough.
    """
    selection = fleet.of(quantity)
    charts = golden_charts(selection, golden, baseline)
    return ChartView(
        selection,
        golden,
        charts,
        tuple(_broken_table(selection, each) for each in charts),
        tuple(chart_notes(charts)),
        chart_table(selection, charts),
        fleet.simulated,
    )


def _broken_table(selection: FleetSelection, chart: GoldenChart) -> Table:
    rules = chart.chart.rules
    broken = [(at, chart.values[at]) for at in sorted(rules)]
    return Table(
        "broken rules",
        f"{len(broken)} of {len(chart.values)} values break a rule",
        (
            Column("number", None, [at + 1 for at, _ in broken], "no.", format_spec="d"),
            Column("begun", None, [v.start_time[:10] for _, v in broken]),
            Column("value", selection.unit, [v.value for _, v in broken], display_unit=selection.display_unit),
            Column("rules", None, [", ".join(rules[at]) for at, _ in broken], "broken rules"),
            Column("run", None, [Path(v.path).name for _, v in broken], displayed=False),
        ),
    )
