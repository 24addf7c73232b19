"""The commands `judge`, `verify` and `export`: the verdict on run files from their points, their checksums and repair, and runs as files for other programs."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from app.archive import PARTS, ExportError, Format, Part, export_run, raw_left_out
from app.cli.options import RUN_FILES, argument, command, option
from app.common import ExitCode, UsageError, exit_code_of, print_line, print_message, terminal_progress
from protocols.runfile import (
    FileState,
    NotesError,
    Run,
    RunReadError,
    StorageError,
    Verification,
    notes_path,
    repair_run,
    verify_run,
)


@command("example: tactor-bench judge runs/*_T7_*.h5 --store")
class JudgeCommand:
    """Judge runs by their points with the checks of this version: for runs of earlier versions and imported runs, which
    have no verdict yet. No run file is changed.
    """

    runs: Sequence[Path] = RUN_FILES
    store: bool = option("store the verdicts in the files RUN.notes.json beside the runs, in place of earlier ones")
    json: bool = option("one JSON list on standard output")

    def execute(self) -> int:
        from app.cli.headless import load_all_protocols
        from app.cli.output import print_json
        from app.common import record_audit
        from app.identification import reference_model
        from protocols import judge_file
        from protocols.base import to_jsonable

        load_all_protocols()
        codes, records, problems = [], [], 0
        for path in self.runs:
            try:
                with Run(path) as run:
                    specimen, reason = run.record.specimen, run.record.reason
                verdict = judge_file(path, reference_model(path.parent, specimen), self.store)
                if self.store:
                    record_audit("judge", notes_path(path), subject=specimen, verdict=str(verdict.outcome))
            except (RunReadError, NotesError) as error:
                if len(self.runs) == 1:
                    raise UsageError(str(error)) from None
                print_message(str(error))
                problems += 1
                continue
            codes.append(exit_code_of(verdict.outcome))
            records.append({"file": str(path), "verdict": to_jsonable(verdict), "stored": self.store})
            if not self.json:
                print_line(f"{path.name}: {verdict.describe(reason)}")
                for check in verdict.checks:
                    print_line(
                        f"    {'pass' if check.passed else 'FAIL'}  {check.text if not check.passed else check.figure}"
                    )
        if self.json:
            print_json(records)
        return ExitCode.USAGE if problems else max(codes, key=WORST.index)


WORST = (ExitCode.DONE, ExitCode.NO_RESULT, ExitCode.FAILED, ExitCode.UNSAFE)
"""Exit codes of verdicts, the worst last."""


@command("example: tactor-bench verify runs --repair")
class VerifyCommand:
    """Read every run file completely and compare it with its checksums: 'good'; 'damaged', with kind and place of the
    damage; or 'not checkable', for a file of an older version, of a running measurement or of a killed program whose
    checkable parts are good. Exit code 0 if all are good, 1 if one is damaged, 2 if one is not a run, 4 if one is not
    checkable.
    """

    paths: Sequence[Path] = argument("run files, or folders", nargs="+", metavar="FILE|FOLDER")
    repair: bool = option("repair files of a killed program before they are verified")
    json: bool = option("one JSON list on standard output")

    def execute(self) -> int:
        from app.cli.output import print_json

        verifications: list[Verification] = []
        for path, named in _run_files(self.paths):
            if self.repair:
                _repair(path)
            result = verify_run(path)
            if result.state is FileState.NO_RUN and not named:
                continue  # a folder may hold other files
            verifications.append(result)
            if not self.json:
                print_line(f"{result.state}: {path}")
                for finding in result.findings:
                    print_line(f"  {finding}")
        if self.json:
            print_json([{"path": r.path, "state": r.state, "findings": r.findings} for r in verifications])
        else:
            counts = {state: sum(result.state is state for result in verifications) for state in FileState}
            named_counts = ", ".join(f"{count} {state}" for state, count in counts.items() if count)
            print_line(f"{len(verifications)} files: {named_counts}" if verifications else "there are no run files")
        states = {result.state for result in verifications}
        if FileState.DAMAGED in states:
            return ExitCode.FAILED
        if FileState.NO_RUN in states:
            return ExitCode.USAGE
        return ExitCode.NO_RESULT if FileState.NOT_CHECKABLE in states else ExitCode.DONE


@command("example: tactor-bench export runs/20261121T091502Z_T7_sine-dwell.h5 --format csv --out sheets")
class ExportCommand:
    """Export points, estimates, events and raw samples with their times, SI units in every header. Files from a simulated
    bench have SIMULATED in their names. uff: series as a Universal File (data sets 151, 164, 58) for
    modal analysis; xlsx: a workbook; parquet: for large runs; mat73: MATLAB 7.3.
    """

    runs: Sequence[Path] = RUN_FILES
    format: Format = option("format of the files (default: csv); mat73 is MATLAB 7.3, uff has the series", "csv")
    out: Path | None = option("folder for the files (default: the run's folder)", metavar="FOLDER")
    parts: Sequence[str] = option(
        "part to export: about, points, series, estimates, events or raw; may be repeated (default: all that the format "
        "holds)",
        flag="--part",
        metavar="PART",
    )

    def execute(self) -> int:
        parts: Sequence[Part] | None = tuple(p for p in PARTS if p in self.parts) if self.parts else None
        if unknown := [p for p in self.parts if p not in PARTS]:
            raise UsageError(f"a run has no part '{unknown[0]}'; its parts are: {', '.join(PARTS)}")
        failed = False
        for run_path in self.runs:
            try:
                with Run(run_path) as run, terminal_progress(run_path.name) as progress:
                    written = export_run(run, self.out or run_path.parent, self.format, parts, progress)
                    left_out = "" if parts else raw_left_out(run, self.format)
            except (RunReadError, ExportError) as error:
                failed = True
                print_message(str(error))
            else:
                for file in written:
                    print_line(str(file))
                if left_out:
                    print_message(f"{left_out}: the raw data are left out; csv and parquet hold them")
        return ExitCode.FAILED if failed else ExitCode.DONE


def _repair(path: Path) -> None:
    from protocols import complete_results

    try:
        with suppress(RunReadError):  # reported by the verification
            if message := repair_run(path, complete_results):
                print_message(message)
    except StorageError as error:
        print_message(str(error))


def _run_files(paths: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    """Yield the run files, and whether each was named itself.

    Raises:
        UsageError: there is no such file or folder.
    """
    for path in paths:
        if not path.exists():
            raise UsageError(f"there is no file or folder {path}; give run files, or folders of them")
        if path.is_dir():
            yield from ((file, False) for file in sorted(path.rglob("*.h5")) if file.is_file())
        else:
            yield path, True
