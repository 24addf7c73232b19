"""The commands `archive` and `restore`: a specimen as one file for a lab notebook or another computer, and back."""

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from app.archive import SUFFIX, ArchiveError, Catalogue, RunSummary, restore_archive, write_archive
from app.campaign import campaign_path
from app.cli.options import FOLDER, argument, command, option
from app.cli.runs import check_folder
from app.common import (
    LOG_NAME,
    ExitCode,
    OperationCancelled,
    Progress,
    UsageError,
    pluralize,
    print_line,
    print_message,
    terminal_progress,
    usage_errors,
)
from app.identification import calibrations_path
from protocols.runfile import FileState, mountings_path, safe_name, sheet_path, verify_run

RUNS_SHARE = 0.7
"""Of the work; the rest is the report."""


@command("example: tactor-bench archive T7 --out T7.eln")
class ArchiveCommand:
    """Archive every run of a specimen with notes, specimen sheet, calibrations, campaign, certificates, audit trail and report
    in one .eln file (a zipped RO-Crate), with people, instruments and the SHA-256 of each file. Electronic lab notebooks such as eLabFTW, Kadi4Mat, NOMAD, PASTA,
    RSpace and SampleDB import such files; 'restore' brings the files back.
    """

    specimen: str = argument()
    folder: Path = FOLDER
    out: Path | None = option(f"the archive (default: SPECIMEN{SUFFIX} in the working directory)", metavar="FILE")
    licence: str = option("web address of the licence of the data, e.g. CC BY 4.0", metavar="URL")
    no_report: bool = option("leave the report out")

    @usage_errors(ArchiveError)
    def execute(self) -> int:
        check_folder(self.folder)
        archive = self.out or Path(f"{safe_name(self.specimen)}{SUFFIX}")
        if archive.suffix != SUFFIX:
            raise UsageError(
                f"--out {archive}: write a name that ends in {SUFFIX}, the suffix by which lab notebooks recognise the format"
            )
        catalogue = Catalogue(self.folder)
        with terminal_progress("archive") as progress, TemporaryDirectory() as scratch:
            catalogue.scan()
            runs = [run for run in catalogue.entries() if run.specimen == self.specimen]
            paths = sheet_path, mountings_path, calibrations_path, campaign_path
            beside = (path(self.folder, self.specimen) for path in paths)
            documents = [path for path in beside if path.is_file()]
            if (
                trail := self.folder / LOG_NAME
            ).is_file():  # under a name of its own: the folder that it is restored to may have one
                documents.append(Path(shutil.copy(trail, Path(scratch) / f"{safe_name(self.specimen)}.{LOG_NAME}")))
            if runs and not self.no_report:
                documents += _write_report(self.folder, self.specimen, Path(scratch), progress.part(RUNS_SHARE, 1.0))
            write_archive(
                self.folder, self.specimen, runs, documents, archive, self.licence, progress.part(0.0, RUNS_SHARE)
            )
        _report_damaged(self.folder, runs)
        print_line(str(archive))
        return ExitCode.DONE


def _write_report(folder: Path, specimen: str, scratch: Path, progress: Progress) -> tuple[Path, ...]:
    """Write the report into a folder; a specimen that has none is archived without it."""
    from app.report import ReportError, build_report, write_report

    try:
        content, model, runs = build_report(folder, specimen, None, progress)
        return write_report(content, model, runs, scratch, progress)
    except ReportError as error:
        print_message(f"without a report: {error}")
        return ()


def _report_damaged(folder: Path, runs: list[RunSummary]) -> None:
    """Name the archived runs that are damaged: they are kept as they are."""
    for run in runs:
        if (result := verify_run(folder / run.path)).state is FileState.DAMAGED:
            print_message(f"{run.name} is damaged, and archived as it is: {'; '.join(result.findings)}")


@command("example: tactor-bench restore T7.eln --folder runs")
class RestoreCommand:
    """Restore the files of an archive into a folder of runs, each after its hash was verified; no file is replaced."""

    archive: Path = argument(f"an {SUFFIX} file that `archive` wrote", metavar="ARCHIVE")
    folder: Path = FOLDER

    @usage_errors(ArchiveError)
    def execute(self) -> int:
        try:
            with terminal_progress("restore") as progress:
                restored = restore_archive(self.archive, self.folder, progress)
        except OperationCancelled:
            print_message("cancelled; the files that were complete are kept")
            return ExitCode.FAILED
        if restored.already_present:
            print_message(
                f"{pluralize(len(restored.already_present), 'file')} were in {self.folder} already, with the same content"
            )
        print_line(f"{pluralize(len(restored.copied), 'file')} restored to {self.folder}; every hash is right")
        return ExitCode.DONE
