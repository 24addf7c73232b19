"""Every command where Qt cannot be imported: its help, and a use of the important ones, in one process."""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from app.cli.main import COMMANDS
from app.common.exit_codes import ExitCode

PROGRAM = """
import contextlib, glob, io, json, sys, traceback
sys.modules.update(dict.fromkeys(("PySide6", "shiboken6", "pyqtgraph")))  # an import raises ModuleNotFoundError
from app.cli.main import main

for line in sys.stdin:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main([run for word in json.loads(line) for run in (glob.glob("runs/*.h5") if word == "RUN" else [word])])
        except SystemExit as end:
            code = end.code
        except BaseException:
            code, _ = "traceback", traceback.print_exc()
    print(json.dumps([int(code) if code != "traceback" else code, out.getvalue(), err.getvalue()]))
"""

FEW_POINTS = ["--set", "frequencies_hz=100,160", "--set", "record_s=100 ms", "--set", "min_cycles=10"]
RUN = ["run", "sine-dwell", "--bench", "ideal", "--speed", "max", "--out", "runs", "--specimen", "T7", *FEW_POINTS]
USES = (
    ["protocols"],
    ["protocols", "sine-dwell"],
    RUN,
    ["runs", "runs"],
    ["show", "RUN"],
    ["verify", "RUN"],
    ["specimen", "new", "T7", "--folder", "runs"],
    ["operator", "Anna"],
    ["faults"],
    ["model", "modes"],
    ["bench", "new", "bench.toml"],
)
"""Commands in the order of their execution, in a folder of their own."""

FURTHER_USES = (
    RUN,
    ["specimen", "new", "T7", "--folder", "runs"],
    ["specimen", "show", "T7", "--folder", "runs"],
    ["show", "RUN", "--picture", "run.png"],
    ["export", "RUN", "--format", "csv"],
    ["identify", "RUN"],
    ["campaign", "new", "--bench", "ideal", "--out", "runs", "--specimen", "T7"],
    ["campaign", "status", "--bench", "ideal", "--out", "runs", "--specimen", "T7"],
    ["report", "T7", "--folder", "runs", "--out", "."],
    ["fleet", "runs"],
    ["demo", "--bench", "ideal", "--speed", "max", "--out", "demo"],
)


def answers_without_qt(commands: Sequence[list[str]], folder: Path) -> dict[str, Any]:
    """Return exit code, standard output and standard error by command."""
    lines = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        input="\n".join(map(json.dumps, commands)),
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    return {" ".join(command): json.loads(line) for command, line in zip(commands, lines, strict=True)}


@pytest.mark.deep
def test_commands_need_no_qt(tmp_path: Path) -> None:
    help_texts = [[name, "--help"] for name in COMMANDS]
    answers = answers_without_qt([*help_texts, *USES, ["protocols", "sine-dwell", "--json"], ["window"]], tmp_path)
    code, _, error = answers.pop("window")
    assert code == ExitCode.USAGE
    assert "PySide6" in error
    assert {name: answer for name, answer in answers.items() if answer[0] != ExitCode.DONE} == {}
    rows = {row["parameter"]: row for row in json.loads(answers["protocols sine-dwell --json"][1])}
    assert rows["peak_to_peak_v"]["unit"] == "V"


@pytest.mark.deep
def test_commands_that_draw_and_identify_need_no_qt(tmp_path: Path) -> None:
    answers = answers_without_qt(FURTHER_USES, tmp_path)
    assert {name: answer for name, answer in answers.items() if answer[0] != ExitCode.DONE} == {}
    assert list((tmp_path / "demo").glob("*.png"))
