"""The command `backup`: copies of a folder of runs on a second disk or share, verified by their hashes."""

from dataclasses import asdict
from pathlib import Path

from app.archive import back_up
from app.cli.options import FOLDER, JSON_OBJECT, argument, command, option
from app.cli.output import print_answer
from app.common import ExitCode, terminal_progress
from protocols.base import visible_text


@command("example: tactor-bench backup /mnt/share/tactors --folder runs")
class BackupCommand:
    """Copy new and changed files of a folder of runs into a second folder; nothing there is deleted."""

    target: Path = argument("the second folder, best on another disk")
    folder: Path = FOLDER
    compare: bool = option("also compare the hashes of copies of unchanged size and time")
    json: bool = JSON_OBJECT

    def execute(self) -> int:
        with terminal_progress("copying", self.json) as progress:
            result = back_up(self.folder, self.target, compare_all=self.compare, progress=progress)
        compared = " and equal" if self.compare else ""
        summary = (
            f"{len(result.copied)} files copied and verified, {len(result.already_present)} unchanged{compared}, "
            f"{len(result.problems)} problems: {self.folder} in {self.target}"
        )
        problems = (visible_text(f"✕ {problem}") for problem in result.problems)
        print_answer(asdict(result), [*problems, summary], self.json)
        return ExitCode.FAILED if result.problems else ExitCode.DONE
