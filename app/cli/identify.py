"""The command `identify`: parameters of a specimen from its runs, and their acceptance as a calibration."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from app.cli.identify_tables import identification_command_result, profile_table, proposals_table, rank_proposals
from app.cli.options import JSON_OBJECT, define_command, option, repeated, switch
from app.cli.output import CommandResult, render
from app.common.errors import UsageError
from app.common.inputs import path_argument
from app.common.progress import track
from app.common.units import UnitError, to_number
from app.common.version import version
from app.config.bench_file import ConfigError
from app.identification import calibrations
from app.identification.calibrations import CalibrationError, Calibrations
from app.identification.identify import IdentificationResult, Method, identify
from app.identification.observations import ObservationError, amplifier_of
from app.identification.recalibration import Correction
from model import ParameterError
from model.identification import Calibration, FitOptions, JointFit, parameter_spec
from protocols.runfile.reader import Run, RunReadError

INADEQUATE_MODEL_HINT = (
    "next best: find out why the runs do not follow the model; another run would only be surer of a wrong one"
)
SIMULATED_SHAPES_NOTE = ", as many as the simulated tactor has"


@dataclass(frozen=True)
class IdentifyOptions:
    """Options of `calibration accept`, and of `identify` but for --accept."""

    runs: Sequence[Path] = option(nargs="+", type=path_argument, metavar="RUN", help="run files of one specimen")
    method: Method = option("--method", choices=("joint", "chain"), default="joint", help="(default: joint)")
    free: str = option(
        "--free",
        default="",
        metavar="NAMES",
        help="free parameters, e.g. k2,mu,m_add,c0 (default: what the runs are there for)",
    )
    fixed: Sequence[str] = repeated("--fix", "NAME=VALUE", "a value to hold; SI or with unit")
    profile: Sequence[str] = repeated(
        "--profile",
        "NAME",
        "an interval by profile for this parameter, where a standard error is too simple; may be given often",
    )
    coverage: float = option("--coverage", type=float, default=0.95, help="of profile intervals (default: 0.95)")
    next: str | None = option(
        "--next",
        nargs="?",
        const="",
        metavar="NAME",
        help="what to measure next for this parameter, by default the one known worst: every candidate with its minutes",
    )
    bench: str | None = option(
        "--bench",
        metavar="FILE",
        help="a bench file with the corrected calibration of sensor or amplifier: raw samples are reduced anew with it",
    )
    shapes: int | None = option(
        "--shapes",
        type=int,
        metavar="N",
        help="shape functions of the model (default: 20; of a simulated tactor as many as it has)",
    )
    robust: bool = switch("--robust", "let go of outliers (a Cauchy loss) instead of squares")
    by: str = option("--by", default="", metavar="NAME", help="who accepts it")
    note: str = option("--note", default="", help="a remark kept with it")
    json: bool = switch("--json", JSON_OBJECT)


@dataclass(frozen=True)
class IdentifyAndAcceptOptions(IdentifyOptions):
    """Options of `identify`."""

    accept: bool = switch("--accept", "keep the result as the specimen's calibration")


def identify_runs(options: IdentifyOptions, accept: bool) -> int:
    """Identify the parameters of a specimen from its runs, and accept them if asked."""
    if options.method == "chain" and (options.free or options.fixed or options.robust):
        raise UsageError("--free, --fix and --robust are for the joint fit; the chain's steps are the paper's")
    if options.method == "chain" and (options.profile or options.next is not None):
        raise UsageError("--profile and --next are for the joint fit: the chain has no common covariance to ask")
    if not 0 < options.coverage < 1:
        raise UsageError(f"--coverage {options.coverage:g}: it must lie between 0 and 1, e.g. 0.95")
    free = tuple(name.strip() for name in options.free.split(",") if name.strip())
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
            track=lambda paths: track(paths, "reducing anew" if corrected else "reading runs"),
        )
        answer = identification_command_result(found)
        if found.joint_fit is not None:
            answer = _add_proposals(answer, found, found.joint_fit, options)
    except (ObservationError, RunReadError, ParameterError, ValueError) as error:
        raise UsageError(str(error)) from None
    notes.append(
        f"fitted with {found.shapes} shape functions" + (SIMULATED_SHAPES_NOTE if found.observations.simulated else "")
    )
    if accept:
        notes.append(_accept(found, options, corrected))
    return render(replace(answer, notes=(*answer.notes, *notes)), options.json)


def _correction(options: IdentifyOptions) -> Correction | None:
    if not options.bench:
        return None
    if options.bench == "sim":
        raise UsageError("--bench sim: give the corrected bench file itself")
    try:
        return Correction.from_bench_file(Path(options.bench))
    except ConfigError as error:
        raise UsageError(str(error)) from None


def _add_proposals(
    result: CommandResult, identification: IdentificationResult, fit: JointFit, options: IdentifyOptions
) -> CommandResult:
    """Return the result with profiles and proposals of a joint fit, and a note on what to measure next."""
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


def _accept(identification: IdentificationResult, options: IdentifyOptions, correction: Correction | None) -> str:
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


COMMANDS: Mapping[str, Callable[[argparse.ArgumentParser], None]] = {
    "identify": lambda parser: define_command(
        parser,
        IdentifyAndAcceptOptions,
        lambda options: identify_runs(options, options.accept),
        "Parameters of the beam model from any runs of one specimen: all at once, weighted by their errors, or "
        "step by step as the paper did. What the runs do not tell is named instead of guessed.",
        "example: tactor-bench identify runs/*_T7_*.h5 --accept --by 'K. Tanaka'",
    )
}
