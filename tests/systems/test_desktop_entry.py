"""Entry point of the desktop build: it runs modules and code as Python does, for the processes that the program starts."""

import subprocess
import sys
from pathlib import Path

import pytest

from app.gui.results.report_job import PROGRAM
from drivers.watchdog.subprocesses import python_command

ENTRY = Path(__file__).resolve().parents[2] / "desktop" / "entry.py"


def frozen(*arguments: str, stdin: str = "") -> str:
    """Run the entry point as the frozen program would be run."""
    ended = subprocess.run(
        [sys.executable, str(ENTRY), *arguments], input=stdin, capture_output=True, text=True, timeout=60, check=False
    )
    return ended.stdout + ended.stderr


def test_code_and_modules_see_their_own_arguments() -> None:
    assert frozen("-c", "import sys; print(sys.argv, __name__)", "a", "-b") == "['-c', 'a', '-b'] __main__\n"
    _, *arguments = python_command("-m", "base64", "-e")
    assert arguments[0] == "-P"
    assert frozen(*arguments, stdin="tactor").strip() == "dGFjdG9y"


@pytest.mark.deep
def test_without_such_an_option_it_is_the_command_line() -> None:
    assert frozen("--version").startswith("tactor-bench ")
    assert frozen(*PROGRAM, "--help").startswith("usage: tactor-bench report")
