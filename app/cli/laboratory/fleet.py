"""The commands `fleet` and `control-chart`: many specimens in one table, and a golden specimen over time."""

import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.cli.options import JSON_OBJECT, CommandSyntax, FileOptions, group, option, repeated, switch, threshold_option
from app.cli.output import CommandResult, check_output_files, render
from app.common import (
    ExitCode,
    UsageError,
    path_argument,
    print_message,
    terminal_progress,
    usage_errors,
)

if TYPE_CHECKING:
    from app.fleet.drift import GoldenChart
    from app.fleet.tables import Bounds
    from app.fleet.values import Fleet, FleetSelection
    from model.studies.paper_figures import PaperFigure

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
    threshold: str | None = threshold_option()
    json: bool = switch("--json", JSON_OBJECT)

    def read(self) -> "Fleet":
        """Return the values that the options select."""
        from app.archive import Catalogue, read_since
        from app.fleet.values import FleetError, read_fleet
        from app.identification import chosen_threshold
        from model import ParameterError

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
            with usage_errors(FleetError, ParameterError):
                threshold = chosen_threshold(self.folder, self.threshold)
                fleet = read_fleet(self.folder, catalogue, True if self.simulated else None, threshold)
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
        from app.fleet.tables import fleet_notes, group_table, quantity_table, specimen_table
        from app.fleet.values import GROUPS, FleetError

        if self.group_by not in GROUPS:
            raise UsageError(f"--group-by {self.group_by}: there are {', '.join(GROUPS)}")
        check_output_files(self.files)
        fleet, limits = self.read(), _read_limits(self.limits, self.folder)
        names = self.quantities or fleet.names
        with usage_errors(FleetError):
            selections = [fleet.of(name) for name in names]
        shown = selections if self.quantities else selections[:MAX_QUANTITIES]
        specimens = specimen_table(shown)
        tables = [
            quantity_table(selections, limits),
            *(group_table(s, self.group_by) for s in shown if self.quantities),
        ]
        result = CommandResult(
            "fleet",
            {},
            (*tables, specimens),
            tuple(fleet_notes(fleet, selections)),
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
        from app.fleet.tables import chart_notes, chart_table, verdict_table
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
        points = chart_table(selection, charts)
        result = CommandResult(
            "control-chart",
            {},
            (verdict_table(selection, golden, charts),),
            tuple(chart_notes(charts)),
            write_csv=points.to_csv,
            figures=tuple(_chart_figure(selection, golden, each) for each in charts),
            heading=("SIMULATED",) if fleet.simulated else (),
            extra={"simulated": fleet.simulated, points.name: {c.name: c.cells for c in points.columns}},
        )
        render(result, self.json, self.files)
        return ExitCode.FAILED if any(each.cause.is_drift for each in charts) else ExitCode.DONE


def _read_limits(path: Path | None, folder: Path) -> "Mapping[str, Bounds]":
    from app.report.limits import LIMITS_FILE_NAME, LimitsError, read_limits

    chosen = path or folder / LIMITS_FILE_NAME
    if path is None and not chosen.exists():
        return {}
    with usage_errors(LimitsError):
        return read_limits(chosen).bounds


def _golden_of_limits(folder: Path) -> str:
    from app.report.limits import LIMITS_FILE_NAME, LimitsError, read_limits

    path = folder / LIMITS_FILE_NAME
    with usage_errors(LimitsError):
        return read_limits(path).golden if path.exists() else ""


def _fleet_figure(selection: "FleetSelection") -> "PaperFigure":
    from app.fleet.tables import times_of
    from model.studies.paper_figures import FigureCurve, PaperFigure

    days = (times_of(selection) - times_of(selection).min()) / 86400
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
