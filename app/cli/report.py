"""The command `report`: the PDF and HTML report of a specimen."""

from dataclasses import replace
from pathlib import Path

from app.cli.options import FOLDER, THRESHOLD, argument, command, option
from app.cli.output import print_json, writing_output
from app.cli.runs import check_folder
from app.common import ExitCode, UsageError, print_message, terminal_progress, usage_errors
from app.config import EXAMPLE_LABORATORY, read_laboratory
from app.identification import SheetError, chosen_threshold
from app.report import (
    FULL_SECTIONS,
    LIMITS_FILE_NAME,
    PAGE_TEMPLATE,
    SHORT_SECTIONS,
    Limits,
    LimitsError,
    ReportError,
    build_fleet_report,
    build_report,
    example_limits,
    fit_first_page,
    read_limits,
    read_logo,
    sign_files,
    specimen_names,
    verification_command,
    write_report,
)
from model import ParameterError
from protocols.runfile import RunReadError


@command("example: tactor-bench report T7 --limits limits.toml --out reports")
class ReportCommand:
    """Write the report of a specimen, PDF and HTML, two pages: first the page to sign (people, date, air, instruments with
    their calibration, verdict, key figures, response), then parameters with their source, uncertainty budget, what was left
    out, and the response on skin. --full adds every figure, table, hash and run; --fleet reports every specimen, a page
    each behind a summary. With limits exit code 1 if one is not met or cannot be decided. The same files give the same bytes.
    """

    specimen: str | None = argument(nargs="?")
    folder: Path = FOLDER
    out: Path = option("folder for the report (default: the working directory)", Path(), metavar="FOLDER")
    limits: Path | None = option(
        "file of limits (default: limits.toml in the folder of the runs, if it exists)", metavar="FILE"
    )
    golden: str | None = option("golden specimen, for limits that compare with it", metavar="SPECIMEN")
    new_limits: Path | None = option(
        "write a commented example of limits into this file, and no report", metavar="FILE"
    )
    new_laboratory: Path | None = option(
        "write a commented example of laboratory.toml into this file, and no report: name, logo, threshold and template of reports",
        metavar="FILE",
    )
    new_template: Path | None = option(
        "write the template of the HTML report into this file, and no report; laboratory.toml names it", metavar="FILE"
    )
    threshold: str | None = THRESHOLD
    fleet: bool = option("report every specimen of the folder: a summary, and the first page of each")
    full: bool = option("write the full appendix: every figure, table, hash and run, a page each")
    laboratory: str = option(
        "name of the laboratory, on the first page (default: from laboratory.toml beside the runs)", metavar="NAME"
    )
    logo: Path | None = option(
        "picture of the laboratory (PNG), at the top of the first page (default: from laboratory.toml)", metavar="FILE"
    )
    sign: Path | None = option("SSH key that signs PDF and HTML (FILE.sig beside each); needs --by", metavar="KEY")
    by: str = option("name of the person who signs, on the first page", metavar="NAME")
    json: bool = option("numbers of the report as one JSON object, SI units")

    @usage_errors(ReportError, LimitsError, RunReadError, SheetError, ParameterError)
    def execute(self) -> int:
        if self.new_limits is not None:
            return _write_example(self.new_limits, example_limits())
        if self.new_laboratory is not None:
            names = ", ".join((*SHORT_SECTIONS, *FULL_SECTIONS))
            return _write_example(self.new_laboratory, EXAMPLE_LABORATORY.format(sections=names))
        if self.new_template is not None:
            return _write_example(self.new_template, PAGE_TEMPLATE)
        if self.fleet and (self.specimen is not None or self.full):
            raise UsageError("--fleet reports every specimen in short form: leave the specimen and --full out")
        if self.specimen is None and not self.fleet:
            raise UsageError("a specimen is missing: 'tactor-bench report T7'; 'tactor-bench runs' lists them")
        check_folder(self.folder)
        if self.sign is not None and not self.by.strip():
            raise UsageError("--sign needs the name of the person who signs: --by NAME")
        return self._write()

    def _write(self) -> int:
        out = self.out
        try:
            limits, laboratory = _read_limits(self), read_laboratory(self.folder)
            if self.laboratory:
                laboratory = replace(laboratory, name=self.laboratory)
            threshold = chosen_threshold(self.folder, self.threshold)
            logo = read_logo(self.logo or laboratory.logo)
            out.mkdir(parents=True, exist_ok=True)
            with terminal_progress("report") as progress:
                names = specimen_names(self.folder, progress) if self.specimen is None else (self.specimen,)
                built = [
                    build_report(self.folder, name, limits, progress, threshold, self.full, laboratory)
                    for name in names
                ]
                content, specimen, runs = built[0]
                if self.fleet:
                    content = build_fleet_report([fit_first_page(report) for report, _, _ in built], laboratory)
                content = replace(content, logo=logo, signed_by=self.by.strip())
                files = write_report(content, specimen, runs if self.full else (), out, progress, threshold)
            signatures = sign_files(files, self.sign) if self.sign is not None else []
        except OSError as error:
            raise UsageError(f"the report cannot be written to {out}: {error.strerror or error}") from None
        for path in (*files, *signatures):
            print_message(f"wrote {path}")
        if signatures:
            print_message(f"to verify: {verification_command(files[0], self.by.strip())}")
        if self.json:
            print_json({**content.record, "files": [str(path) for path in files]})
        for outcome in content.limit_outcomes:
            if outcome.verdict != "pass":
                why = f" ({outcome.why})" if outcome.why else ""
                print_message(f"{outcome.verdict}: {outcome.name} is {outcome.found}, asked {outcome.asked}{why}")
        return ExitCode.DONE if content.passed else ExitCode.FAILED


def _read_limits(options: ReportCommand) -> Limits | None:
    """Return the limits of the option, or of the folder of the runs; None without limits.

    Raises:
        LimitsError, UsageError: they are invalid, or compare with an unnamed golden unit.
    """
    beside = options.folder / LIMITS_FILE_NAME
    path = options.limits or (beside if beside.exists() else None)
    if path is None:
        if options.golden:
            raise UsageError("--golden needs limits to compare by: 'tactor-bench report --new-limits limits.toml'")
        return None
    limits = read_limits(path)
    if options.golden:
        limits = replace(limits, golden=options.golden)
    compared = [name for name, limit in limits.limits.items() if limit.within_golden is not None]
    if compared and not limits.golden:
        raise UsageError(
            f'{path} compares {", ".join(compared)} with a golden unit, but names none; write golden = "T0" there, or '
            "give --golden T0"
        )
    return limits


def _write_example(path: Path, text: str) -> int:
    if path.exists():
        raise UsageError(f"{path} is there already and is not overwritten; choose another name")
    with writing_output(path):
        path.write_text(text, "utf-8")
    return ExitCode.DONE
