"""The commands `identify` and `calibration`: parameters of a specimen from its runs, and their accepted versions."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from app.cli.identify_tables import (
    estimate_table,
    identification_command_result,
    profile_table,
    proposals_table,
    rank_proposals,
)
from app.cli.options import FOLDER, JSON_OBJECT, CommandGroup, FileOptions, argument, command, option, split_setting
from app.cli.output import PICTURE_SUFFIXES, CommandResult, check_output_file, render
from app.common import (
    Column,
    Progress,
    Table,
    UnitError,
    UsageError,
    read_stated,
    terminal_progress,
    to_number,
    track,
    usage_errors,
)
from app.identification import (
    CalibrationError,
    Calibrations,
    IdentificationResult,
    Method,
    ObservationError,
    SheetError,
    accept_identification,
    amplifier_of,
    describe_correction,
    identify,
    prior_tables,
    read_calibrations,
    write_calibrations,
)
from model import ParameterError, ParameterSpec
from model.identification import Calibration, FitOptions, JointFit, compare_calibrations, parameter_spec
from protocols.runfile import Run, RunReadError

if TYPE_CHECKING:
    from app.identification import Correction

T = TypeVar("T")

INADEQUATE_MODEL_HINT = (
    "next best: find the cause of the discrepancies; further runs would only make a wrong model more certain"
)
USUAL_EVALUATIONS = 30
"""Number of evaluations at which the bar of a fit is half full; the total is unknown in advance."""
SIMULATED_SHAPES_NOTE = ", as many as the simulated tactor has"


@command("runs/*_T7_*.h5 --by 'K. Tanaka'")
class AcceptCommand:
    """Identify these runs and store the result: identify --accept."""

    runs: Sequence[Path] = argument("run files of one specimen", nargs="+", metavar="RUN")
    method: Method = option("(default: joint)", "joint")
    free: str = option("free parameters, e.g. k2,mu,m_add,c0 (default: those that the runs determine)", metavar="NAMES")
    also: str = option(
        "parameters that are free in addition, e.g. mass_fraction, the share of the added masses that acts",
        metavar="NAMES",
    )
    plain: bool = option(
        "the beam model alone: creep, hysteresis and the other usual nonidealities are held at none, and no cause is added where the "
        "model is not adequate"
    )
    fixed: Sequence[str] = option("a fixed value, in SI units or with a unit", flag="--fix", metavar="NAME=VALUE")
    priors: Sequence[str] = option(
        "value and standard uncertainty of a parameter by ruler, caliper or scale, e.g. "
        "'h_Al=0.20 mm +- 0.01 mm' or 'L=22 mm +- 1 %%'; frees the parameter within its uncertainty, which enters all errors",
        flag="--prior",
        metavar="NAME=VALUE+-ERROR",
    )
    sheet: str = option(
        "specimen sheet with dimensions and masses (default: the sheet beside the runs, else Table I with the uncertainties of "
        "ruler and caliper); 'none' holds them at Table I as exact values, as --plain does with nonidealities",
        metavar="FILE|none",
    )
    profile: Sequence[str] = option(
        "add an interval by profile likelihood for this parameter, where a standard error does not suffice; may be repeated",
        metavar="NAME",
    )
    coverage: float = option("coverage of profile intervals (default: 0.95)", 0.95)
    posterior: bool = option(
        "check totals and correlations by Monte Carlo on the same likelihood: 1500 draws, a minute or some; names the totals that "
        "do not hold, with their intervals"
    )
    picture: Path | None = option("with --posterior: draw the density of each parameter", metavar="PNG")
    next: str | None = option(
        "rank the next measurements for this parameter, by default the least certain one: every candidate with its duration",
        nargs="?",
        const="",
        metavar="NAME",
    )
    bench: str | None = option(
        "bench file with the corrected calibration of sensor or amplifier; raw samples are reduced again with it",
        metavar="FILE",
    )
    shapes: int | None = option(
        "shape functions of the model (default: 20; for a simulated tactor its own number)", metavar="N"
    )
    robust: bool = option("a Cauchy loss, which is robust against outliers, instead of least squares")
    protocols: Sequence[str] = option(
        "file of a lab's own protocol, for its runs; may be repeated", flag="--protocol", metavar="FILE.py"
    )
    by: str = option("name of the person who accepts the result", metavar="NAME")
    note: str = option("note stored with the result")
    reason: str = option(
        "reason for accepting an inadequate or untested result; stored and printed with it", metavar="TEXT"
    )
    json: bool = JSON_OBJECT
    accept: bool = True

    @usage_errors(ObservationError, RunReadError, CalibrationError, SheetError, ValueError)
    def execute(self) -> int:
        self._check()
        for file in self.protocols:
            from app.session import load_protocol_class  # loads all that a bench file needs

            load_protocol_class(file)
        setting, corrected = self._fit_options(), _correction(self)
        notes = [text for path in self.runs if corrected and (text := corrected.describe_changes(path))]
        amplifier = corrected.amplifier if corrected else None
        with ExitStack() as bars:
            identification = identify(
                self.runs,
                self.method,
                replace(setting, amplifier=amplifier.amplifier_map if amplifier else amplifier_of(self.runs)),
                self.shapes,
                open_run=corrected.open if corrected else Run,
                track=lambda paths: track(paths, "reducing raw samples again" if corrected else "reading runs"),
                sheet="none" if self.sheet == "none" else Path(self.sheet) if self.sheet else None,
                plain=self.plain,
                progress=_show_progress(bars, self.json),
            )
        result = identification_command_result(identification)
        if identification.joint_fit is not None:
            result = _add_proposals(result, identification, identification.joint_fit, self)
        simulated = SIMULATED_SHAPES_NOTE if identification.observations.simulated else ""
        notes.append(f"fitted with {identification.shapes} shape functions{simulated}")
        if self.accept:
            notes.append(_accept(identification, self, corrected))
        return render(replace(result, notes=(*result.notes, *notes)), self.json, FileOptions(picture=self.picture))

    def _check(self) -> None:
        """Raise UsageError for options that do not fit the method."""
        if self.picture:
            check_output_file(self.picture, PICTURE_SUFFIXES)
        if self.picture and not self.posterior:
            raise UsageError("--picture draws the posterior: give --posterior, too")
        if not 0 < self.coverage < 1:
            raise UsageError(f"--coverage {self.coverage:g}: it must lie between 0 and 1, e.g. 0.95")
        if self.method == "joint":
            return
        if self.free or self.also or self.fixed or self.priors or self.robust:
            raise UsageError(
                "--free, --also, --fix, --prior and --robust are for the joint fit; the chain has fixed steps"
            )
        if self.profile or self.next is not None or self.posterior:
            raise UsageError(
                "--profile, --next and --posterior are for the joint fit: the chain has no common covariance to ask"
            )
        if self.plain:
            raise UsageError("--plain is for the joint fit: the chain has no nonidealities")

    def _fit_options(self) -> FitOptions:
        free, also = (
            tuple(name.strip() for name in names.split(",") if name.strip()) for names in (self.free, self.also)
        )
        priors = dict(
            _parse_parameter(text, "--prior", "'h_Al=0.20 mm +- 0.01 mm'", read_stated) for text in self.priors
        )
        return FitOptions(
            free=(*free, *(name for name in priors if name not in free)) if free else None,
            also=also,
            fixed=dict(
                _parse_parameter(text, "--fix", "k2=8.7e-3", lambda v, of: to_number(v, of.unit)) for text in self.fixed
            ),
            priors=priors,
            loss="cauchy" if self.robust else "linear",
        )


@command("example: tactor-bench identify runs/*_T7_*.h5 --accept --by 'K. Tanaka'")
class IdentifyCommand(AcceptCommand):
    """Identify the parameters of the beam model from any runs of one specimen: all at once, weighted by their errors, or
    step by step as in the paper. Creep, hysteresis and other usual nonidealities are fitted with them; where runs and
    model still differ, the likeliest causes are added in turn and listed. Parameters that the runs do not determine
    are named instead of guessed.
    """

    accept: bool = option("store the result as the specimen's calibration")


def _show_progress(bars: ExitStack, quiet: bool) -> Callable[[int, float], None]:
    """Return the function that shows the progress of a fit on a terminal, from its first evaluation until `bars` is closed."""
    bar: Progress | None = None

    def show(evaluations: int, chi_square: float) -> None:
        nonlocal bar
        bar = bar or bars.enter_context(terminal_progress("fitting", quiet))
        done = evaluations / (evaluations + USUAL_EVALUATIONS)
        bar.update(done, f"fitting, {evaluations} evaluations, chi-square {chi_square:.5g}")

    return show


def _correction(options: AcceptCommand) -> "Correction | None":
    if not options.bench:
        return None
    from app.config import SIMULATED_BENCHES, ConfigError  # slow to import, and needed with this option alone
    from app.identification import Correction

    if options.bench in SIMULATED_BENCHES:
        raise UsageError(f"--bench {options.bench}: give the corrected bench file itself")
    with usage_errors(ConfigError):
        return Correction.from_bench_file(Path(options.bench))


def _add_proposals(
    result: CommandResult, identification: IdentificationResult, fit: JointFit, options: AcceptCommand
) -> CommandResult:
    """Return the result with profiles and proposals of a joint fit, and a note on the next measurement."""
    tables, notes = list(result.tables), list(result.notes)
    if options.profile:
        tables.append(profile_table(fit, options.profile, options.coverage))
    if options.posterior:
        from app.cli.identify_posterior import posterior_figures, posterior_note, posterior_of, posterior_table

        with usage_errors(ParameterError, about="--posterior"):
            posterior = posterior_of(fit, options.json)
        tables.append(posterior_table(posterior, identification))
        notes.append(posterior_note(posterior, identification))
        result = replace(result, figures=posterior_figures(posterior, identification))
    if fit.free_parameters:
        proposals = rank_proposals(fit, options.next or None)
        if options.next is not None:
            tables.append(proposals_table(proposals))
        wrong = identification.adequacy is not None and identification.adequacy.adequate is False
        notes.append(INADEQUATE_MODEL_HINT if wrong else f"next best: {proposals[0].summary}")
    return replace(result, tables=tuple(tables), notes=tuple(notes))


def _parse_parameter(text: str, flag: str, example: str, read: Callable[[str, ParameterSpec], T]) -> tuple[str, T]:
    """Return name and value of `NAME=VALUE`, the value of a parameter of the model."""
    name, value = split_setting(text, flag, example)
    with usage_errors(UnitError, ParameterError, about=f"{flag} {text}"):
        return name, read(value, parameter_spec(name))


def _accept(identification: IdentificationResult, options: AcceptCommand, correction: "Correction | None") -> str:
    accepted, path = accept_identification(
        identification, options.runs[0].parent, options.runs, options.by, options.note, options.reason, correction
    )
    decision = f"; {accepted.decision}" if accepted.decision else ""
    return f"accepted as version {accepted.version} of {identification.specimen}, now active, in {path}{decision}"


@command("T7")
class ShowCalibrationCommand:
    """Show one version, the active one by default."""

    specimen: str = argument()
    version: int | None = option()
    folder: Path = FOLDER
    json: bool = JSON_OBJECT

    def execute(self) -> int:
        with usage_errors(CalibrationError, about=f"specimen {self.specimen} in {self.folder}"):
            return render(self.result(read_calibrations(self.folder, self.specimen)), self.json)

    def result(self, calibrations: Calibrations) -> CommandResult:
        return _version_result(calibrations.get(self.version), calibrations)


@command("T7 1")
class UseCalibrationCommand(ShowCalibrationCommand):
    """Make another version the active one."""

    version: int = argument()

    def result(self, calibrations: Calibrations) -> CommandResult:
        calibrations = replace(calibrations, active=calibrations.get(self.version).version)
        write_calibrations(self.folder, self.specimen, calibrations)
        return super().result(calibrations)


@command("T7 1 2")
class DiffCalibrationCommand(ShowCalibrationCommand):
    """Show the changes between two versions."""

    version: None = None
    first: int = argument()
    second: int = argument()

    def result(self, calibrations: Calibrations) -> CommandResult:
        return _difference_result(calibrations.get(self.first), calibrations.get(self.second))


def _version_result(version: Calibration, calibrations: Calibrations) -> CommandResult:
    identified = [e for e in version.estimates if e.name not in version.known]
    active = "active" if version.version == calibrations.active else f"version {calibrations.active} is active"
    title = f"Specimen {version.specimen}, version {version.version} ({active}){', SIMULATED' * version.simulated}"
    return CommandResult(
        "calibration show",
        {name: value for name, value in version.fixed.items() if value is not None},
        (estimate_table(title, identified, version.statistical), *prior_tables(version.known, version.estimates)),
        (
            *filter(None, (version.decision, version.dimensions)),
            f"{version.method}, accepted {version.accepted_at} by {version.accepted_by or '(name not given)'}, program {version.code}",
            f"from {', '.join(version.runs)}",
            *filter(None, (describe_correction(version.reduced) if version.reduced else "", version.note)),
            *_version_lines(calibrations),
        ),
        extra={"version": version.version, "active": calibrations.active, "record": version.as_record()},
    )


def _version_lines(calibrations: Calibrations) -> list[str]:
    """Return one line that lists all versions, if there are several."""
    if len(calibrations.versions) < 2:
        return []
    each = (
        f"{c.version} ({c.accepted_at[:10]}{', ' + c.accepted_by if c.accepted_by else ''}"
        f"{', active' if c.version == calibrations.active else ''})"
        for c in calibrations.versions
    )
    return [f"versions: {'; '.join(each)}"]


def _difference_result(old: Calibration, new: Calibration) -> CommandResult:
    every = compare_calibrations(old, new)
    table = Table(
        "changes",
        f"Specimen {new.specimen}: version {old.version} to {new.version}",
        (
            Column("name", "", [c.name for c in every], "parameter"),
            Column("before", "", [c.before for c in every]),
            Column("after", "", [c.after for c in every]),
            Column("unit", "", [c.unit for c in every]),
            Column("standard_errors", "", [c.sigmas for c in every], "in standard errors", format_spec="+.1f"),
        ),
    )
    return CommandResult("calibration diff", {}, (table,))


VERBS = CommandGroup(
    "Manage the accepted estimates of a specimen: consecutive versions, one of them active.",
    "example: tactor-bench calibration show T7",
    {
        "accept": AcceptCommand,
        "show": ShowCalibrationCommand,
        "diff": DiffCalibrationCommand,
        "use": UseCalibrationCommand,
    },
)
