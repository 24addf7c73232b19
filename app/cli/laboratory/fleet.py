"""The commands `fleet` and `control-chart`: many specimens in one table, and a golden specimen over time."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.cli.options import JSON_OBJECT, THRESHOLD, FileOptions, argument, command, group, option, options
from app.cli.output import CommandResult, check_output_files, render
from app.common import ExitCode, UsageError, usage_errors
from model import Series

if TYPE_CHECKING:
    from app.fleet import Fleet, FleetSelection, GoldenChart
    from app.report import Limits
    from model.studies import PaperFigure

MAX_QUANTITIES = 5
"""Quantities in the table of the specimens where none is named."""


@options
class _FleetOptions:
    folder: Path = argument("(default: runs)", Path("runs"), nargs="?")
    specimens: Sequence[str] = option("include only this specimen; may be repeated", flag="--specimen", metavar="NAME")
    batch: str = option("include only this batch of the specimen sheets", metavar="NAME")
    bench: str = option("include only runs of this bench", flag="--bench-name", metavar="NAME")
    protocol: str = option("include only runs of this protocol; 'calibration': accepted parameters")
    since: str = option("begun since 2026-11-21, 2026-11, today, 12h or 7d", metavar="WHEN")
    simulated: bool = option("use the simulated runs of a folder that has real ones")
    threshold: str | None = THRESHOLD
    json: bool = JSON_OBJECT

    def read(self) -> "Fleet":
        """Return the values that the options select."""
        from app.archive import read_since
        from app.cli.runs import check_folder, scanned_catalogue
        from app.fleet import FleetError, read_fleet
        from app.identification import chosen_threshold
        from model import ParameterError

        check_folder(self.folder)
        try:
            since = read_since(self.since) if self.since else ""
        except ValueError:
            raise UsageError(f"--since {self.since}: write a day (2026-11-21), a month (2026-11) or 7d") from None
        with scanned_catalogue(self.folder, self.json) as catalogue, usage_errors(FleetError, ParameterError):
            threshold = chosen_threshold(self.folder, self.threshold)
            fleet = read_fleet(self.folder, catalogue, True if self.simulated else None, threshold)
        selection = fleet.filtered(self.specimens, self.batch, self.bench, self.protocol, since)
        if not selection.values:
            raise UsageError("no value matches all options; give fewer options")
        return selection


@command("example: tactor-bench fleet runs --quantity natural_frequency --group-by month --picture fleet.png")
class FleetCommand(_FleetOptions):
    """Compare many specimens: for each quantity of runs and accepted calibrations the newest value of every specimen
    with its total standard uncertainty, mean, spread, possible outliers, and Cpk against the limits of limits.toml;
    trends, and groups by batch, bench, sensor, operator or month. Real and simulated runs are never mixed.
    """

    quantities: Sequence[str] = option(
        "quantity, e.g. natural_frequency or k2; may be repeated", flag="--quantity", metavar="NAME"
    )
    group_by: str = option(
        "property that defines the groups: batch (default), bench, sensor, operator, month or protocol", "batch"
    )
    limits: Path | None = option("limits for Cpk (default: limits.toml beside the runs, if any)", metavar="FILE")
    files: FileOptions = group(FileOptions, "the specimens")

    def execute(self) -> int:
        from app.fleet import (
            GROUPS,
            FleetError,
            fleet_notes,
            group_table,
            quantity_table,
            sensor_drifts,
            specimen_table,
        )

        if self.group_by not in GROUPS:
            raise UsageError(f"--group-by {self.group_by}: there are {', '.join(GROUPS)}")
        check_output_files(self.files)
        fleet, limits = self.read(), _read_limits(self.folder, self.limits)
        names = self.quantities or fleet.names
        with usage_errors(FleetError):
            selections = [fleet.of(name) for name in names]
        shown = selections if self.quantities else selections[:MAX_QUANTITIES]
        drifts = sensor_drifts(fleet, limits.golden if limits else "")
        specimens = specimen_table(shown, drifts)
        tables = [
            quantity_table(selections, limits.bounds if limits else {}),
            *(group_table(s, self.group_by) for s in shown if self.quantities),
        ]
        result = CommandResult(
            "fleet",
            {},
            (*tables, specimens),
            (*filter(None, (specimens.note,)), *fleet_notes(fleet, selections)),
            write_csv=specimens.to_csv,
            figures=tuple(_fleet_figure(s) for s in shown),
            heading=("SIMULATED",) if fleet.simulated else (),
            extra={"simulated": fleet.simulated},
        )
        return render(result, self.json, self.files)


@command("example: tactor-bench control-chart runs --golden T0 --quantity amplitude_at_resonance --picture chart.png")
class ControlChartCommand(_FleetOptions):
    """Chart a golden specimen that is measured repeatedly: Shewhart chart with the rules of Western Electric and Nelson,
    and EWMA, for each displacement sensor. A drift is attributed to the bench if other specimens changed alike on it,
    or if the golden specimen did not change on other sensors. The exit code is 1 after a lasting change.
    """

    golden: str = option("golden specimen (default: from limits.toml)", metavar="NAME")
    quantity: str = option("(default: amplitude_at_resonance)", "amplitude_at_resonance")
    baseline: int = option("number of first values that define centre and limits (default: 20)", 20, metavar="N")
    files: FileOptions = group(FileOptions, "the chart")

    def execute(self) -> int:
        from app.fleet import (
            MIN_BASELINE,
            FleetError,
            TooFewValuesError,
            chart_notes,
            chart_table,
            golden_charts,
            verdict_table,
        )

        if self.baseline < MIN_BASELINE:
            raise UsageError(f"--baseline {self.baseline}: at least {MIN_BASELINE} values")
        check_output_files(self.files)
        golden = self.golden
        if not golden and (limits := _read_limits(self.folder)) is not None:
            golden = limits.golden
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


@command("example: tactor-bench repeatability runs --quantity natural_frequency --picture repeatability.png")
class RepeatabilityCommand(_FleetOptions):
    """Split the scatter of a quantity between specimens, operators, mountings and repeats (gauge R&R), from runs that
    exist: restricted maximum likelihood, which needs no balanced plan. Sources that these runs cannot tell apart are named.
    """

    quantity: str = option(
        "quantity of runs, e.g. natural_frequency (default: the quantity of most values)", metavar="NAME"
    )
    files: FileOptions = group(FileOptions, "the sources")

    def execute(self) -> int:
        from app.fleet import FleetError, gauge_figures, gauge_notes, gauge_table, study_of_runs
        from protocols.runfile import RunReadError

        check_output_files(self.files)
        fleet = self.read()
        with usage_errors(FleetError, RunReadError):
            selections = map(fleet.of, [self.quantity] if self.quantity else fleet.names)
            selection = max(selections, key=lambda each: len(each.values))
            study, factors = study_of_runs(self.folder, selection)
        result = CommandResult(
            "repeatability",
            {},
            (gauge_table(selection, study),),
            tuple(gauge_notes(selection, study)),
            figures=gauge_figures(selection, factors),
            heading=("SIMULATED",) if fleet.simulated else (),
            extra={
                "simulated": fleet.simulated,
                "quantity": selection.name,
                "mean": study.mean,
                "categories": study.categories,
                "inseparable": list(study.inseparable),
            },
        )
        return render(result, self.json, self.files)


def _read_limits(folder: Path, path: Path | None = None) -> "Limits | None":
    """Return the limits of a file, or of the file in the folder of the runs; None without one."""
    from app.report import LIMITS_FILE_NAME, LimitsError, read_limits

    chosen = path or folder / LIMITS_FILE_NAME
    if path is None and not chosen.exists():
        return None
    with usage_errors(LimitsError):
        return read_limits(chosen)


def _fleet_figure(selection: "FleetSelection") -> "PaperFigure":
    from app.fleet import times_of
    from model.studies import PaperFigure

    days = (times_of(selection) - times_of(selection).min()) / 86400
    curves = []
    for batch in sorted({v.batch for v in selection.values}):
        at = [i for i, v in enumerate(selection.values) if v.batch == batch]
        curves.append(Series(days[at], np.array([selection.values[i].value for i in at]), label=batch))
    days_since = f"days since {min(v.start_time for v in selection.values)[:10]}"
    caption = f"{selection.name} over time."
    return PaperFigure("fleet", days_since, "", selection.name, selection.unit, tuple(curves), caption)


def _chart_figure(selection: "FleetSelection", golden: str, each: "GoldenChart") -> "PaperFigure":
    from model.studies import PaperFigure

    times = np.array([v.time_s for v in each.values])
    days, chart = (times - times[0]) / 86400, each.chart
    lines = {
        "value": chart.values,
        "EWMA": chart.average,
        "centre": np.full(times.size, chart.centre),
        "centre + 3 sigma": np.full(times.size, chart.centre + 3 * chart.sigma),
        "centre - 3 sigma": np.full(times.size, chart.centre - 3 * chart.sigma),
        "EWMA limit": chart.centre + chart.average_limit,
        "EWMA limit, lower": chart.centre - chart.average_limit,
    }
    curves = tuple(Series(days, y, label=label) for label, y in lines.items())
    days_since = f"days since {each.values[0].start_time[:10]}"
    caption = f"{golden} on {each.sensor or 'an unknown sensor'}: {each.cause}."
    return PaperFigure(f"chart {each.sensor}", days_since, "", selection.name, selection.unit, curves, caption)
