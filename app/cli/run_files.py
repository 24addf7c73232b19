"""The commands `judge` and `verify`: the verdict on run files from their points, and their checksums and repair."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from app.cli.options import RUN_FILES, argument, command, option
from app.common import ExitCode, UsageError, exit_code_of, print_line, print_message
from protocols.runfile import (
    FileState,
    NotesError,
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
        from protocols.runfile import Run

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
