"""The command `judge`: the verdict on run files from their points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.cli.options import CommandSyntax, option, switch
from app.common import ExitCode, UsageError, path_argument, print_line, print_message


@dataclass(frozen=True)
class JudgeCommand:
    """Print the verdict on runs by the checks of this version; the exit code is that of the worst."""

    runs: Sequence[Path] = option(nargs="+", type=path_argument, metavar="RUN", help="run files")
    store: bool = switch("--store", "write the verdict into the files, in place of an earlier one")
    json: bool = switch("--json", "as one JSON list on standard output")

    def execute(self) -> int:
        from app.cli.headless import exit_code_of, load_all_protocols
        from app.cli.output import print_json
        from app.identification import reference_model
        from protocols.base import to_jsonable
        from protocols.judgement import judge_file
        from protocols.runfile.errors import StorageError
        from protocols.runfile.reader import Run, RunReadError

        load_all_protocols()
        codes, records, problems = [], [], 0
        for path in self.runs:
            try:
                with Run(path) as run:
                    specimen, reason = run.specimen, run.reason
                verdict = judge_file(path, reference_model(path.parent, specimen), self.store)
            except (RunReadError, StorageError) as error:
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

COMMANDS: Mapping[str, CommandSyntax] = {
    "judge": CommandSyntax(
        JudgeCommand,
        "What runs are worth, by their points and the checks of this version: for runs of earlier versions and imported "
        "ones, which are not judged until then. Files are changed with --store only.",
        "example: tactor-bench judge runs/*_T7_*.h5 --store",
    )
}
