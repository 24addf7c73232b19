"""The command `mounting`: when mass, plate, membrane and laser of a specimen were mounted anew."""

from pathlib import Path

from app.archive import mount_part
from app.cli.options import FOLDER, JSON_OBJECT, argument, command, option, specimen_argument
from app.cli.output import CommandResult, render
from app.common import Column, Table, UsageError, check_operator, print_message, usage_errors
from model import format_time
from protocols.base import MOUNTED_PARTS
from protocols.runfile import NotesError, read_mountings


@command("example: tactor-bench mounting T7 plate --by 'K. Tanaka'")
class MountingCommand:
    """Record that a part of a specimen's set-up was mounted anew: mass (glued), plate (clamped), membrane (put on) or laser
    (moved). The runs after it belong to a new mounting, and a fit allows for its difference from the others. Without a
    part all mountings are listed; campaigns record those that they ask for.
    """

    specimen: str = argument(type=specimen_argument)
    part: str = argument("mass, plate, membrane or laser", "", nargs="?")
    by: str = option("name of the person (default: the operator of the day)", metavar="NAME")
    folder: Path = FOLDER
    json: bool = JSON_OBJECT

    @usage_errors(NotesError)
    def execute(self) -> int:
        if self.part and self.part not in MOUNTED_PARTS:
            raise UsageError(f"there is no part '{self.part}'; the parts are {', '.join(MOUNTED_PARTS)}")
        if self.part:
            print_message(f"wrote {mount_part(self.folder, self.specimen, self.part, check_operator(self.by))}")
        every = read_mountings(self.folder, self.specimen)
        table = Table(
            "mountings",
            f"Mountings of specimen {self.specimen}, the oldest first",
            (
                Column("part", "", [each.part for each in every]),
                Column("event", "", [MOUNTED_PARTS[each.part] for each in every]),
                Column("shown_time", "", [format_time(each.time, seconds=True) for each in every], "time (UTC)"),
                Column("who", "", [each.who for each in every], "by"),
                Column("time", "", [each.time for each in every], displayed=False),
            ),
        )
        return render(CommandResult("mounting", {}, (table,)), self.json)
