"""The commands `fleet` and `control-chart`: many specimens in one table, and a golden specimen over time."""

import math
import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.cli.options import JSON_OBJECT, CommandSyntax, FileOptions, group, option, repeated, switch
from app.cli.output import CommandResult, check_output_files, render
from app.common import (
    Column,
    ExitCode,
    Table,
    UsageError,
    path_argument,
    print_message,
    terminal_progress,
    usage_errors,
)

if TYPE_CHECKING:
    from app.fleet.drift import GoldenChart
    from app.fleet.values import Fleet, FleetSelection
    from app.report.limits import Limit
    from model import Array
    from model.studies.paper_figures import PaperFigure

LIMIT_OF = {"resonance frequency": "resonance", "largest max - min": "amplitude_at_resonance"}
"""Names in a file of limits of quantities that have another name there; parameters have the same."""
MAX_QUANTITIES = 5
"""Quantities in the table of the specimens where none is named."""


@dataclass(frozen=True)
class _FleetOptions:
    folder: Path = option(nargs="?", type=path_argument, default=Path("runs"), help="(default: runs)")
    specimens: Sequence[str] = repeated("--specimen", "NAME", "only this specimen; may be repeated")
    batch: str = option("--batch", default="", metavar="NAME", help="only this batch of the specimen sheets")
    bench: str = option("--bench-name", default="", metavar="NAME", help="only runs of this bench")
    protocol: str = option(
        "--protocol", default="", help="only runs of this protocol; 'calibration': accepted parameters"
    )
    since: str = option("--since", default="", metavar="WHEN", help="begun since 2026-11-21, 2026-11, today, 12h or 7d")
    simulated: bool = switch("--simulated", "the simulated runs of a folder that has real ones")
    json: bool = switch("--json", JSON_OBJECT)

    def read(self) -> "Fleet":
        """Return the values that the options select."""
        from app.archive import Catalogue, read_since
        from app.fleet.values import FleetError, read_fleet

        if not self.folder.is_dir():
            raise UsageError(f"there is no folder {self.folder}; name the one your runs are in")
        try:
            since = read_since(self.since) if self.since else ""
        except ValueError:
            raise UsageError(f"--since {self.since}: write a day (2026-11-21), a month (2026-11) or 7d") from None
        catalogue = Catalogue(self.folder)
        try:
            with terminal_progress("reading runs", self.json) as progress:
                scanned = catalogue.scan(progress)
            with usage_errors(FleetError):
                fleet = read_fleet(self.folder, catalogue, True if self.simulated else None)
        except (sqlite3.Error, OSError) as error:
            raise UsageError(f"the index {catalogue.index} cannot be used: {error}; remove the file") from None
        for sentence in scanned.skipped:
            print_message(sentence)
        found = fleet.filtered(self.specimens, self.batch, self.bench, self.protocol, since)
        if not found.values:
            raise UsageError("no value has all of these properties; give fewer options")
        return found


@dataclass(frozen=True)
class FleetCommand(_FleetOptions):
    """Compare many specimens: each quantity's mean, spread, outliers and capability, and the newest values."""

    quantities: Sequence[str] = repeated("--quantity", "NAME", "e.g. 'resonance frequency' or k2; may be repeated")
    group_by: str = option(
        "--group-by", default="batch", help="batch (default), bench, sensor, operator, month or protocol"
    )
    limits: Path | None = option(
        "--limits",
        type=path_argument,
        metavar="FILE",
        help="limits for Cpk (default: limits.toml beside the runs, if any)",
    )
    files: FileOptions = group(FileOptions, "the specimens")

    def execute(self) -> int:
        from app.fleet.values import GROUPS, FleetError

        if self.group_by not in GROUPS:
            raise UsageError(f"--group-by {self.group_by}: there are {', '.join(GROUPS)}")
        check_output_files(self.files)
        fleet, limits = self.read(), _read_limits(self.limits, self.folder)
        names = self.quantities or fleet.names
        with usage_errors(FleetError):
            selections = [fleet.of(name) for name in names]
        shown = selections if self.quantities else selections[:MAX_QUANTITIES]
        specimens = _specimen_table(shown)
        tables = [
            _quantity_table(selections, limits),
            *(_group_table(s, self.group_by) for s in shown if self.quantities),
        ]
        result = CommandResult(
            "fleet",
            {},
            (*tables, specimens),
            tuple(_notes(fleet, selections)),
            write_csv=specimens.to_csv,
            figures=tuple(_fleet_figure(s) for s in shown),
            heading=("SIMULATED",) if fleet.simulated else (),
            extra={"simulated": fleet.simulated},
        )
        return render(result, self.json, self.files)


@dataclass(frozen=True)
class ControlChartCommand(_FleetOptions):
    """Chart a golden specimen over time and say whether a drift is the bench's or its own."""

    golden: str = option(
        "--golden", default="", metavar="NAME", help="the golden specimen (default: that of limits.toml)"
    )
    quantity: str = option("--quantity", default="largest max - min", help="(default: largest max - min)")
    baseline: int = option(
        "--baseline", type=int, default=20, metavar="N", help="first values that set centre and limits (default: 20)"
    )
    files: FileOptions = group(FileOptions, "the chart")

    def execute(self) -> int:
        from app.fleet.control_chart import MIN_BASELINE, TooFewValuesError
        from app.fleet.drift import golden_charts
        from app.fleet.values import FleetError

        if self.baseline < MIN_BASELINE:
            raise UsageError(f"--baseline {self.baseline}: at least {MIN_BASELINE} values")
        check_output_files(self.files)
        golden = self.golden or _golden_of_limits(self.folder)
        if not golden:
            raise UsageError('name the golden specimen: --golden NAME, or golden = "NAME" in limits.toml')
        fleet = self.read()
        with usage_errors(FleetError, TooFewValuesError):
            selection = fleet.of(self.quantity)
            charts = golden_charts(selection, golden, self.baseline)
        points = _chart_table(selection, charts)
        result = CommandResult(
            "control-chart",
            {},
            (_verdict_table(selection, golden, charts),),
            tuple(_chart_notes(charts)),
            write_csv=points.to_csv,
            figures=tuple(_chart_figure(selection, golden, each) for each in charts),
            heading=("SIMULATED",) if fleet.simulated else (),
            extra={"simulated": fleet.simulated, points.name: {c.name: c.cells for c in points.columns}},
        )
        render(result, self.json, self.files)
        return ExitCode.FAILED if any(each.cause.is_drift for each in charts) else ExitCode.DONE


def _read_limits(path: Path | None, folder: Path) -> "Mapping[str, Limit]":
    from app.report.limits import LIMITS_FILE_NAME, LimitsError, read_limits

    chosen = path or folder / LIMITS_FILE_NAME
    if path is None and not chosen.exists():
        return {}
    with usage_errors(LimitsError):
        return read_limits(chosen).limits


def _golden_of_limits(folder: Path) -> str:
    from app.report.limits import LIMITS_FILE_NAME, LimitsError, read_limits

    path = folder / LIMITS_FILE_NAME
    with usage_errors(LimitsError):
        return read_limits(path).golden if path.exists() else ""


def _quantity_table(selections: "Sequence[FleetSelection]", limits: "Mapping[str, Limit]") -> Table:
    """Return a row for each quantity: mean, spread, outliers and capability of the newest values."""
    from app.common import display_unit
    from app.fleet.statistics import capability, outlier_mask, spread_of
    from app.fleet.values import arrays

    rows = []
    for selection in selections:
        newest = selection.newest
        values, errors = arrays(newest)
        spread, factor = spread_of(values, errors), display_unit(selection.unit)[0]
        outliers = [v.specimen for v, out in zip(newest, outlier_mask(values), strict=True) if out]
        limit = limits.get(LIMIT_OF.get(selection.name, selection.name))
        indices: tuple[object, ...] = (None, None, None)
        if limit is not None and (limit.low is not None or limit.high is not None):
            found = capability(values, [v.batch for v in newest], limit.low, limit.high)
            indices = (_index(found.cpk, found.cpk_error), _index(found.ppk, found.ppk_error), found.outside)
        shown = tuple(
            f"{factor * x:.5g}" if math.isfinite(x) else "" for x in (spread.mean, spread.sd, spread.mean_uncertainty)
        )
        rows.append((selection, spread, outliers, indices, shown))
    units = [display_unit(s.unit)[1].removesuffix("1") for s, *_ in rows]
    with_limits = any(indices[2] is not None for *_, indices, _ in rows)
    capable = (
        Column("cpk", None, [r[3][0] or "" for r in rows], "Cpk, 95 %"),
        Column("ppk", None, [r[3][1] or "" for r in rows], "Ppk, 95 %"),
        Column("outside", None, ["" if r[3][2] is None else str(r[3][2]) for r in rows], "outside"),
    )
    return Table(
        "quantities",
        "Newest value of each specimen",
        (
            Column("quantity", None, [s.name for s, *_ in rows]),
            Column("source", None, [s.about for s, *_ in rows], "from"),
            Column("shown_unit", None, units, "unit"),
            Column("specimens", None, [r[1].count for r in rows], format_spec="d"),
            Column("shown_mean", None, [r[4][0] for r in rows], "mean"),
            Column("shown_sd", None, [r[4][1] for r in rows], "spread (1 sd)"),
            Column("shown_error", None, [r[4][2] for r in rows], "of it measurement"),
            Column("outliers", None, [", ".join(r[2]) for r in rows]),
            *(capable if with_limits else ()),
            Column("mean", None, [r[1].mean for r in rows], displayed=False),
            Column("sd", None, [r[1].sd for r in rows], displayed=False),
            Column("true_sd", None, [r[1].true_sd for r in rows], displayed=False),
            Column("mean_total_uncertainty", None, [r[1].mean_uncertainty for r in rows], displayed=False),
            Column("median", None, [r[1].median for r in rows], displayed=False),
            Column("unit", None, [s.unit for s, *_ in rows], displayed=False),
        ),
    )


def _index(value: float, error: float) -> str:
    return f"{value:.2f} ± {error:.2f}" if math.isfinite(value) else "no spread"


def _specimen_table(selections: "Sequence[FleetSelection]") -> Table:
    """Return a row for each specimen: its newest values with total uncertainty."""
    from app.common import format_quantity

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
        found = [values.get(name) for name in specimens]
        texts = ["" if v is None else format_quantity(v.value, v.total, v.unit) for v in found]
        columns += [
            Column(f"{selection.name} as text", None, texts, selection.name),
            Column(
                selection.name, selection.unit, [math.nan if v is None else v.value for v in found], displayed=False
            ),
            Column(
                f"{selection.name} total uncertainty",
                selection.unit,
                [math.nan if v is None else v.total for v in found],
                displayed=False,
            ),
        ]
    return Table("specimens", "Specimens, with total standard uncertainties", tuple(columns))


def _group_table(selection: "FleetSelection", by: str) -> Table:
    """Return mean and spread of a quantity by batch, bench, month and so on, of all values."""
    from app.common import display_unit
    from app.fleet.statistics import by_group
    from app.fleet.values import arrays

    values, errors = arrays(selection.values)
    groups = by_group(values, errors, [str(getattr(v, by)) or "unknown" for v in selection.values])
    spreads, unit = list(groups.values()), display_unit(selection.unit)[1]
    shown = unit if unit != selection.unit else ""
    return Table(
        f"{selection.name} by {by}",
        f"{selection.name} by {by}, all values",
        (
            Column(by, None, list(groups)),
            Column("values", None, [s.count for s in spreads], format_spec="d"),
            Column("mean", selection.unit, [s.mean for s in spreads], display_unit=shown),
            Column("sd", selection.unit, [s.sd for s in spreads], "spread (1 sd)", display_unit=shown),
            Column("lowest", selection.unit, [s.lowest for s in spreads], display_unit=shown),
            Column("highest", selection.unit, [s.highest for s in spreads], display_unit=shown),
        ),
    )


def _notes(fleet: "Fleet", selections: "Sequence[FleetSelection]") -> list[str]:
    from app.fleet.statistics import trend_of
    from app.fleet.values import arrays

    notes = []
    for selection in selections:
        values, _ = arrays(selection.values)
        trend = trend_of(_times(selection), values)
        if trend is not None and trend.is_significant:
            share = 100 / abs(float(values.mean()))
            notes.append(
                f"{selection.name}: trend {trend.per_month * share:+.2g} ± {trend.error * share:.1g} % in 30 days over all values"
            )
        if selection.left_out:
            notes.append(f"{selection.name}: {selection.left_out} values of other protocols or drives are not compared")
    if fleet.left_out:
        notes.append(f"{fleet.left_out} values of {'real' if fleet.simulated else 'simulated'} runs are left out")
    notes.append("Cpk: spread within batches; Ppk: overall spread. An outlier has a modified z-score above 3.5")
    return notes


def _times(selection: "FleetSelection") -> "Array":
    return np.array([v.time_s for v in selection.values])


def _verdict_table(selection: "FleetSelection", golden: str, charts: "Sequence[GoldenChart]") -> Table:
    from app.common import display_unit

    first, unit = [each.first_signal for each in charts], display_unit(selection.unit)[1]
    shown = unit if unit != selection.unit else ""
    return Table(
        "charts",
        f"{selection.name} of {golden}, {selection.about}",
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
            Column("rules", None, [_rules_text(each) for each in charts]),
            Column("cause", None, [str(each.cause) for each in charts], "drift of"),
        ),
    )


def _rules_text(chart: "GoldenChart") -> str:
    return ", ".join(signal.rule for signal in chart.chart.signals if signal.index == chart.first_signal)


def _chart_table(selection: "FleetSelection", charts: "Sequence[GoldenChart]") -> Table:
    rows = [(each, i, value) for each in charts for i, value in enumerate(each.values)]
    rules = [", ".join(s.rule for s in each.chart.signals if s.index == i) for each, i, _ in rows]
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
            Column("rules", None, rules),
            Column("run", None, [v.path for *_, v in rows]),
        ),
    )


def _chart_notes(charts: "Sequence[GoldenChart]") -> list[str]:
    from app.fleet.control_chart import VALUES_PER_FALSE_ALARM
    from app.fleet.drift import DriftCause

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


def _fleet_figure(selection: "FleetSelection") -> "PaperFigure":
    from model.studies.paper_figures import FigureCurve, PaperFigure

    days = (_times(selection) - _times(selection).min()) / 86400
    curves = []
    for batch in sorted({v.batch for v in selection.values}):
        at = [i for i, v in enumerate(selection.values) if v.batch == batch]
        curves.append(FigureCurve(batch, days[at], np.array([selection.values[i].value for i in at])))
    begin = min(v.start_time for v in selection.values)[:10]
    return PaperFigure(
        "fleet",
        f"days since {begin}",
        "",
        selection.name,
        selection.unit,
        tuple(curves),
        f"{selection.name} over time.",
    )


def _chart_figure(selection: "FleetSelection", golden: str, each: "GoldenChart") -> "PaperFigure":
    from model.studies.paper_figures import FigureCurve, PaperFigure

    times = np.array([v.time_s for v in each.values])
    days, chart = (times - times[0]) / 86400, each.chart
    lines = [
        ("value", chart.values),
        ("EWMA", chart.average),
        ("centre", np.full(times.size, chart.centre)),
        ("centre + 3 sigma", np.full(times.size, chart.centre + 3 * chart.sigma)),
        ("centre - 3 sigma", np.full(times.size, chart.centre - 3 * chart.sigma)),
        ("EWMA limit", chart.centre + chart.average_limit),
        ("EWMA limit, lower", chart.centre - chart.average_limit),
    ]
    return PaperFigure(
        f"chart {each.sensor}",
        f"days since {each.values[0].start_time[:10]}",
        "",
        selection.name,
        selection.unit,
        tuple(FigureCurve(label, days, y) for label, y in lines),
        f"{golden} on {each.sensor or 'an unknown sensor'}: {each.cause}.",
    )


COMMANDS: Mapping[str, CommandSyntax] = {
    "fleet": CommandSyntax(
        FleetCommand,
        "Many specimens in one table: for each quantity of runs and accepted calibrations the newest value of every specimen with its total "
        "standard uncertainty, their mean, spread, possible outliers, and Cpk against the limits of limits.toml; trends, and groups by batch, "
        "bench, sensor, operator or month. Real and simulated runs are never mixed.",
        "example: tactor-bench fleet runs --quantity 'resonance frequency' --group-by month --picture fleet.png",
    ),
    "control-chart": CommandSyntax(
        ControlChartCommand,
        "A golden specimen that is measured again and again: Shewhart chart with the rules of Western Electric and Nelson, and EWMA, for each "
        "displacement sensor. A drift is the bench's if other specimens changed alike there, or the golden one did not on other "
        "sensors. The exit code is 1 if something changed to stay.",
        "example: tactor-bench control-chart runs --golden T0 --quantity 'largest max - min' --picture chart.png",
    ),
}
