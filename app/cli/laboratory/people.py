"""The commands `operator` and `checked`: who measures today, and the second person who checked a run."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from app.archive import check_run
from app.cli.options import JSON_OBJECT, RUN_FILES, argument, command, option
from app.cli.output import print_answer
from app.common import (
    ExitCode,
    UsageError,
    check_operator,
    current_conditions,
    print_line,
    print_message,
    remember_typed_conditions,
    usage_errors,
)
from protocols.runfile import NotesError, RunReadError


@command("example: tactor-bench operator 'Anna Muster' --temperature '23.4 °C' --humidity '45 %'")
class OperatorCommand:
    """Set operator, air temperature and air humidity: stored in every run, and remembered until midnight. Without a name
    a run stores the login of the computer; on a real bench the terminal asks once a day. A sensor of the bench file
    ([environment]) takes precedence over typed values.
    """

    name: str | None = argument("name of the operator, until midnight; '' deletes it", nargs="?")
    temperature: str | None = option("air temperature, e.g. '23.4 °C'", metavar="T")
    humidity: str | None = option("air humidity, e.g. '45 %%'", metavar="RH")
    json: bool = JSON_OBJECT

    def execute(self) -> int:
        remember_typed_conditions(self.name, self.temperature, self.humidity)
        conditions = current_conditions()
        air = conditions.air_text or "temperature and humidity not stated"
        text = f"{conditions.operator or 'nobody'} ({conditions.operator_origin}); {air}"
        return print_answer(asdict(conditions), [text], self.json)


@command("example: tactor-bench checked runs/20261121T091502Z_T7_sine-dwell.h5 --by 'Ben Beispiel'")
class CheckedCommand:
    """Record that a second person checked runs. Name, time and the hash of the file are stored in the notes beside it;
    'runs --checked-by' lists such runs. The operator of a run cannot check it.
    """

    runs: Sequence[Path] = RUN_FILES
    by: str = option("name of the person who checked; not the operator", metavar="NAME")
    remark: str = option("remark of the person who checked", metavar="TEXT")

    @usage_errors(NotesError)
    def execute(self) -> int:
        name = check_operator(self.by)
        if not name:
            raise UsageError("--by is missing: name the second person who checked the runs")
        failed = False
        for path in self.runs:
            try:
                check = check_run(path, name, self.remark)
            except RunReadError as error:
                failed = True
                print_message(str(error))
            else:
                print_line(f"{path}: checked by {check.name}, SHA-256 {check.sha256[:16]}...")
        return ExitCode.FAILED if failed else ExitCode.DONE
