"""The command `backup`: copies of a folder of runs on a second disk or share, verified by their hashes."""

from dataclasses import asdict
from pathlib import Path

from app.archive.backup import back_up
from app.cli.options import FOLDER, JSON_OBJECT, argument, command, option
from app.cli.output import print_json
from app.common import ExitCode, print_line, terminal_progress
from protocols.base import visible_text


@command("example: tactor-bench backup /mnt/share/tactors --folder runs")
class BackupCommand:
    """Copy what is new or changed in a folder of runs into a second folder; nothing there is deleted."""

    target: Path = argument("the second folder, best on another disk")
    folder: Path = FOLDER
    compare: bool = option("also compare the hashes of copies of unchanged size and time")
    json: bool = JSON_OBJECT

    def execute(self) -> int:
        with terminal_progress("copying", self.json) as progress:
            result = back_up(self.folder, self.target, compare_all=self.compare, progress=progress)
        if self.json:
            print_json(asdict(result))
        else:
            for problem in result.problems:
                print_line(visible_text(f"✕ {problem}"))
            compared = " and equal" if self.compare else ""
            print_line(
                f"{len(result.copied)} files copied and verified, {len(result.unchanged)} unchanged{compared}, "
                f"{len(result.problems)} problems: {self.folder} in {self.target}"
            )
        return ExitCode.FAILED if result.problems else ExitCode.DONE
