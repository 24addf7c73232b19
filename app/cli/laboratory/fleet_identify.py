"""The command `fleet identify`: parameters of every specimen of a folder, on this computer or on several."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app.cli.options import CLUSTER, JSON_OBJECT, FileOptions, argument, command, group, option
from app.cli.output import CommandResult, check_output_files, render
from app.common import Column, ExitCode, Table, UsageError, pluralize, print_message, terminal_progress, usage_errors
from app.identification import ADEQUACY_TEXT, SheetError, load_sheet
from app.report import ReportError, fit_specimen, read_report_runs, specimen_names
from app.services import ClusterError, CountingExecutor, cluster_executor


@dataclass(frozen=True, slots=True)
class SpecimenFit:
    """What the joint fit of all runs of a specimen found."""

    specimen: str
    runs: int = 0
    """Number of runs in the fit."""
    adequate: bool | None = None
    problem: str = ""
    """Reason for no result."""
    simulated: bool = False
    estimates: Sequence[tuple[str, str, float, float]] = ()
    """Name, unit, value and total standard uncertainty of each identified parameter."""


def identify_specimen(folder: Path, specimen: str) -> SpecimenFit:
    """Identify a specimen from all of its runs that count, as its report does. A module function: a worker imports it."""
    here = f"on the computer {platform.node()}; each needs the runs under the same path"
    if not folder.is_dir():
        return SpecimenFit(specimen, problem=f"there is no folder {folder} {here}")
    try:
        runs = read_report_runs(folder, specimen)
        model, _ = fit_specimen(specimen, runs, sheet=load_sheet(folder, specimen))
    except SheetError as error:
        return SpecimenFit(specimen, problem=str(error))
    except OSError as error:
        return SpecimenFit(specimen, problem=f"{folder} cannot be read {here}: {error.strerror or error}")
    counting = [run for run in runs if run.identifiable]
    simulated = any(run.summary.simulated for run in counting)
    found = model.identification
    if found is None:
        problem = model.problem if runs else f"there is no run of it {here}"
        return SpecimenFit(specimen, len(counting), problem=problem, simulated=simulated)
    estimates = tuple((e.name, e.unit, float(e.value), float(e.standard_error)) for e in found.identified)
    adequate = found.adequacy.adequate if found.adequacy is not None else None
    return SpecimenFit(specimen, len(counting), adequate, simulated=simulated, estimates=estimates)


@command("example: tactor-bench fleet identify runs --cluster local --csv parameters.csv")
class FleetIdentifyCommand:
    """Identify every specimen of a folder from all its runs that count, as its report does; several at a time on all
    cores of this computer, or on the computers of a Dask cluster, which need the folder under the same path. The exit
    code is 1 if a specimen has no result.
    """

    folder: Path = argument("(default: runs)", Path("runs"), nargs="?")
    specimens: Sequence[str] = option("only this specimen; may be repeated", flag="--specimen", metavar="NAME")
    cluster: str | None = CLUSTER
    json: bool = JSON_OBJECT
    files: FileOptions = group(FileOptions, "the parameters")

    def execute(self) -> int:
        from app.cli.runs import check_folder

        check_folder(self.folder)
        check_output_files(self.files)
        if self.files.picture is not None:
            raise UsageError("fleet identify draws no picture: 'tactor-bench fleet --picture' does, of accepted values")
        with usage_errors(ReportError):
            names = specimen_names(self.folder)
        if unknown := [name for name in self.specimens if name not in names]:
            raise UsageError(f"there is no run of specimen '{unknown[0]}' in {self.folder}")
        try:
            fits = self._identify(self.specimens or names)
        except ClusterError as error:
            print_message(f"tactor-bench: {error}")
            return ExitCode.FAILED
        except KeyboardInterrupt:
            print_message("tactor-bench: stopped; nothing was written")
            return ExitCode.FAILED
        render(_result(fits), self.json, self.files)
        return ExitCode.FAILED if any(fit.problem for fit in fits) else ExitCode.DONE

    def _identify(self, names: Sequence[str]) -> list[SpecimenFit]:
        fits: list[SpecimenFit] = []
        folder = self.folder.resolve()
        with cluster_executor(self.cluster) as pool, terminal_progress("specimens", self.json) as progress:

            def advance(fit: SpecimenFit) -> None:
                fits.append(fit)
                progress.update(len(fits) / len(names), f"specimens {len(fits)}/{len(names)}")

            for _ in CountingExecutor(pool, advance).map(identify_specimen, [folder] * len(names), names):
                pass
        return fits


def _result(fits: Sequence[SpecimenFit]) -> CommandResult:
    rows = [(fit.specimen, *estimate) for fit in fits for estimate in fit.estimates]
    parameters = Table(
        "parameters",
        "Parameters of every specimen, with total standard uncertainties (SI)",
        (
            Column("specimen", "", [row[0] for row in rows]),
            Column("parameter", "", [row[1] for row in rows]),
            Column("value", "", [row[3] for row in rows], format_spec=".6g"),
            Column("error", "", [row[4] for row in rows], "±", format_spec=".2g"),
            Column("unit", "", [row[2] for row in rows]),
        ),
    )
    specimens = Table(
        "specimens",
        f"{pluralize(len(fits), 'specimen')}",
        (
            Column("specimen", "", [fit.specimen for fit in fits]),
            Column("runs", "", [fit.runs for fit in fits], "runs in the fit"),
            Column("result", "", [fit.problem or ADEQUACY_TEXT[fit.adequate] for fit in fits]),
        ),
    )
    simulated = ("SIMULATED",) if any(fit.simulated for fit in fits) else ()
    return CommandResult("fleet identify", {}, (parameters, specimens), heading=simulated)
