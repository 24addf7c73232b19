"""The parsers of `tactor-bench identify`, `compare` and `calibration`. What they run is imported when it runs.

What `tactor-bench identify` does, and accepting what it found.
"""

import argparse
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from app.cli.identify_tables import identification_command_result, profile_table, proposals_table, rank_proposals
from app.cli.output import CommandResult, progress_bar, render
from app.common.errors import UsageError
from app.common.inputs import path_argument
from app.common.units import UnitError, to_number
from app.common.version import version
from app.config.bench_file import ConfigError
from app.identification import calibrations
from app.identification.calibrations import CalibrationError, Calibrations
from app.identification.identify import IdentificationResult, identify
from app.identification.observations import ObservationError, amplifier_of
from app.identification.recalibration import Correction
from model.identification.calibration import Calibration
from model.identification.fit_options import FitOptions
from model.identification.fit_result import JointFit
from model.identification.parameters import parameter_spec
from model.parameter_spec import ParameterError
from protocols.runfile.reader import Run, RunReadError


def add_identify_commands(subparsers: Any) -> None:
    """Register the commands with the subparsers of the command."""
    identify = subparsers.add_parser(
        "identify",
        help="parameters of a specimen from its runs, with errors",
        description="Parameters of the beam model from any runs of one specimen: all at once, weighted by their errors, or "
        "step by step as the paper did. What the runs do not tell is named instead of guessed.",
        epilog="example: tactor-bench identify runs/*_T7_*.h5 --accept --by 'K. Tanaka'",
    )
    _add_identification(identify)
    identify.add_argument("--accept", action="store_true", help="keep the result as the specimen's calibration")

    compare = subparsers.add_parser(
        "compare",
        help="what differs between two runs of the same kind",
        description="Points of two runs side by side: values, difference, and the difference in standard errors.",
        epilog="example: tactor-bench compare runs/A_sine-dwell.h5 runs/B_sine-dwell.h5",
    )
    compare.add_argument("first", type=path_argument)
    compare.add_argument("second", type=path_argument)
    compare.add_argument("--json", action="store_true", help="as one JSON object, SI units")
    compare.set_defaults(command=_compare)

    calibration = subparsers.add_parser(
        "calibration",
        help="the accepted estimates of a specimen: accept, show, diff, use another version",
        description="What was accepted of a specimen: one version after the other, one of them active.",
        epilog="example: tactor-bench calibration show T7",
    )
    do = calibration.add_subparsers(title="what", metavar="WHAT", required=True)
    accept = do.add_parser(
        "accept",
        help="identify these runs and keep the result: identify --accept",
        epilog="example: calibration accept runs/*_T7_*.h5 --by 'K. Tanaka'",
    )
    _add_identification(accept)
    accept.set_defaults(accept=True)
    show = do.add_parser("show", help="one version, the active one by default", epilog="example: calibration show T7")
    show.add_argument("specimen")
    show.add_argument("--version", type=int)
    diff = do.add_parser("diff", help="what changed between two versions", epilog="example: calibration diff T7 1 2")
    diff.add_argument("specimen")
    diff.add_argument("first", type=int)
    diff.add_argument("second", type=int)
    use = do.add_parser("use", help="make another version the active one", epilog="example: calibration use T7 1")
    use.add_argument("specimen")
    use.add_argument("version", type=int)
    for each, what in ((show, "show"), (diff, "diff"), (use, "use")):
        each.add_argument("--folder", type=path_argument, default=Path("runs"), help="of the runs (default: runs)")
        each.add_argument("--json", action="store_true", help="as one JSON object, SI units")
        each.set_defaults(command=_calibration, what=what)


def _add_identification(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("runs", nargs="+", type=path_argument, metavar="RUN", help="run files of one specimen")
    parser.add_argument("--method", choices=("joint", "chain"), default="joint", help="(default: joint)")
    parser.add_argument(
        "--free", metavar="NAMES", help="free parameters, e.g. k2,mu,m_add,c0 (default: what the runs are there for)"
    )
    parser.add_argument(
        "--fix",
        dest="fixed",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a value to hold; SI or with unit",
    )
    parser.add_argument(
        "--profile",
        action="append",
        default=[],
        metavar="NAME",
        help="an interval by profile for this parameter, where a standard error is too simple; may be given often",
    )
    parser.add_argument("--coverage", type=float, default=0.95, help="of profile intervals (default: 0.95)")
    parser.add_argument(
        "--next",
        nargs="?",
        const="",
        metavar="NAME",
        help="what to measure next for this parameter, by default the one known worst: every candidate with its minutes",
    )
    parser.add_argument(
        "--bench",
        metavar="FILE",
        help="a bench file with the corrected calibration of sensor or amplifier: raw samples are reduced anew with it",
    )
    parser.add_argument(
        "--shapes",
        type=int,
        metavar="N",
        help="shape functions of the model (default: 20; of a simulated tactor as many as it has)",
    )
    parser.add_argument("--robust", action="store_true", help="let go of outliers (a Cauchy loss) instead of squares")
    parser.add_argument("--by", default="", metavar="NAME", help="who accepts it")
    parser.add_argument("--note", default="", help="a remark kept with it")
    parser.add_argument("--json", action="store_true", help="as one JSON object, SI units")
    parser.set_defaults(command=_identify)


def add_report_command(subparsers: Any) -> None:
    """Register `report` with the subparsers of the command."""
    report = subparsers.add_parser(
        "report",
        help="the report of a specimen: PDF and HTML",
        description="One page to sign, and an appendix: the paper's figures from this specimen with bands and residuals, parameters "
        "with errors beside the paper's, margin over the skin's threshold, latency, quality of the points, instruments, hashes of the "
        "run files, every run. With limits also pass or fail: exit code 1 where a limit is not met, or cannot be told to be. The same "
        "files give the same bytes.",
        epilog="example: tactor-bench report T7 --limits limits.toml --out reports",
    )
    report.add_argument("specimen", nargs="?")
    report.add_argument("--folder", type=path_argument, default=Path("runs"), help="of the runs (default: runs)")
    report.add_argument(
        "--out", type=path_argument, default=Path(), metavar="FOLDER", help="where it goes (default: here)"
    )
    report.add_argument(
        "--limits",
        type=path_argument,
        metavar="FILE",
        help="limits to be met (default: limits.toml beside the runs, if it is there)",
    )
    report.add_argument("--golden", metavar="SPECIMEN", help="the specimen that the limits compare with")
    report.add_argument(
        "--new-limits",
        type=path_argument,
        metavar="FILE",
        help="write a commented example of limits into this file, and nothing else",
    )
    report.add_argument("--json", action="store_true", help="its numbers as one JSON object, SI units")
    report.set_defaults(command=_report)


def _report(options: argparse.Namespace) -> int:
    from app.cli.report import report_command

    return report_command(options)


def _identify(options: argparse.Namespace) -> int:

    return identify_runs(options)


def _compare(options: argparse.Namespace) -> int:
    from app.cli.compare import compare_runs

    return compare_runs(options)


def _calibration(options: argparse.Namespace) -> int:
    from app.cli.calibration import calibration

    return calibration(options)


INADEQUATE_MODEL_HINT = (
    "next best: find out why the runs do not follow the model; another run would only be surer of a wrong one"
)
SIMULATED_SHAPES_NOTE = ", as many as the simulated tactor has"


def identify_runs(options: argparse.Namespace) -> int:
    """`tactor-bench identify RUN...`."""
    if options.method == "chain" and (options.free or options.fixed or options.robust):
        raise UsageError("--free, --fix and --robust are for the joint fit; the chain's steps are the paper's")
    if options.method == "chain" and (options.profile or options.next is not None):
        raise UsageError("--profile and --next are for the joint fit: the chain has no common covariance to ask")
    if not 0 < options.coverage < 1:
        raise UsageError(f"--coverage {options.coverage:g}: it must lie between 0 and 1, e.g. 0.95")
    free = tuple(name.strip() for name in (options.free or "").split(",") if name.strip())
    fixed = dict(_parse_fixed(text) for text in options.fixed)
    corrected = _correction(options)
    try:
        notes = [words for path in options.runs if corrected and (words := corrected.describe_changes(path))]
        setting = FitOptions(
            free=free or None,
            fixed=fixed,
            loss="cauchy" if options.robust else "linear",
            amplifier=corrected.amplifier.amplifier_map
            if corrected and corrected.amplifier
            else amplifier_of(options.runs),
        )
        found = identify(
            options.runs,
            options.method,
            setting,
            options.shapes,
            open_run=corrected.open if corrected else Run,
            track=lambda paths: progress_bar(paths, "reducing anew" if corrected else "reading runs"),
        )
        answer = identification_command_result(found)
        if found.joint_fit is not None:
            answer = _add_proposals(answer, found, found.joint_fit, options)
    except (ObservationError, RunReadError, ParameterError, ValueError) as error:
        raise UsageError(str(error)) from None
    notes.append(
        f"fitted with {found.shapes} shape functions" + (SIMULATED_SHAPES_NOTE if found.observations.simulated else "")
    )
    if options.accept:
        notes.append(_accept(found, options, corrected))
    return render(replace(answer, notes=(*answer.notes, *notes)), options)


def _correction(options: argparse.Namespace) -> Correction | None:
    if not options.bench:
        return None
    if options.bench == "sim":
        raise UsageError("--bench sim: give the corrected bench file itself")
    try:
        return Correction.from_bench_file(Path(options.bench))
    except ConfigError as error:
        raise UsageError(str(error)) from None


def _add_proposals(
    result: CommandResult, identification: IdentificationResult, fit: JointFit, options: argparse.Namespace
) -> CommandResult:
    """The answer with what else was asked of a joint fit, and the one line of what to measure next."""
    tables, notes = list(result.tables), list(result.notes)
    if options.profile:
        tables.append(profile_table(fit, options.profile, options.coverage))
    if fit.free_parameters:
        proposals = rank_proposals(fit, options.next or None)
        if options.next is not None:
            tables.append(proposals_table(proposals))
        wrong = identification.adequacy is not None and identification.adequacy.adequate is False
        notes.append(INADEQUATE_MODEL_HINT if wrong else f"next best: {proposals[0].summary}")
    return replace(result, tables=tuple(tables), notes=tuple(notes))


def _parse_fixed(text: str) -> tuple[str, float]:
    name, equals, value = text.partition("=")
    if not equals:
        raise UsageError(f"--fix {text}: write NAME=VALUE, for example --fix k2=8.7e-3")
    try:
        return name.strip(), to_number(value.strip(), parameter_spec(name.strip()).unit)
    except (UnitError, ParameterError) as error:
        raise UsageError(f"--fix {text}: {error}") from None


def _accept(identification: IdentificationResult, options: argparse.Namespace, correction: Correction | None) -> str:
    folder = options.runs[0].parent
    try:
        known = calibrations.read_calibrations(folder, identification.specimen)
        number = max((each.version for each in known.versions), default=0) + 1
        accepted = Calibration(
            specimen=identification.specimen,
            version=number,
            estimates=identification.estimates,
            covariance=tuple(tuple(row) for row in np.asarray(identification.covariance).tolist()),
            method=identification.method,
            runs=tuple(path.name for path in options.runs),
            code=version(),
            accepted_at=datetime.now(UTC).isoformat(timespec="seconds"),
            accepted_by=options.by,
            simulated=identification.observations.simulated,
            fixed=dict(identification.fixed),
            note=options.note,
            reduced=correction.as_record() if correction else {},
        )
        path = calibrations.write_calibrations(
            folder, identification.specimen, Calibrations((*known.versions, accepted), number)
        )
    except (CalibrationError, ParameterError) as error:
        raise UsageError(str(error)) from None
    return f"accepted as version {number} of {identification.specimen}, now active, in {path}"
