"""Imports of each command before its first output: help texts and the model load nothing they do not need."""

import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = ("numpy", "pydantic", "scipy", "h5py", "pint", "rich", "matplotlib", "pyvisa", "nidaqmx", "grpc", "PySide6")
LATER = (
    "app.archive.notes",
    "app.identification.sheet_file",
    "app.gui.plots.results",
    "protocols.commissioning.verdict",
    "protocols.measurements.wiring_check",
    "protocols.runfile.reader",
)
"""Modules of this program that came to be imported before the first paint, an eighth of its time, and are used after it."""

PROGRAM = """
import contextlib, io, sys
with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
    {}
print(*(m for m in {!r} if m in sys.modules))
"""

HELP = """import app.cli.main
    for name in ('run', 'window', 'show'):
        with contextlib.suppress(SystemExit):
            app.cli.main.main([name, '--help'])
            raise AssertionError(name)
"""


PACKAGES = ("app", "drivers", "model", "protocols")
MOST_MODULES = 120
"""Modules of these packages that run between the command and the first drive; the simulated instruments are not counted."""

TRIP = """
import sys, threading
entered, driven = set(), []

def enter(frame, event, _):
    code = frame.f_code
    if event == 'call' and not driven:
        if code.co_name != '<module>':
            entered.add(code.co_filename)
        if code.co_qualname == 'HvAmplifier.start_drive':
            driven.append(frame)

threading.setprofile(enter)
sys.setprofile(enter)
from app.cli.main import main
main(['run', 'sine-dwell', '--speed', 'max', '--out', sys.argv[1], '--set', 'frequencies_hz=100'])
sys.setprofile(None)
print('first drive' if driven else 'no drive', *entered, sep='\\n')
"""


def loaded(code: str) -> set[str]:
    program = PROGRAM.format(code, HEAVY + LATER)
    printed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(printed.stdout.split())


@pytest.mark.parametrize(
    ("code", "needs"),
    [
        ("import app.cli.main; app.cli.main._parser()", set()),
        (HELP, set()),
        (
            "import app.cli.model, app.cli.study, app.common.units; app.common.units.to_number('4 V', 'V')",
            {"pydantic", "pint"},
        ),
        pytest.param(
            "import app.cli.run, app.cli.headless, app.session.bench_connection, app.gui.application",
            {"h5py", "scipy", "pint", "rich", "pyvisa", "nidaqmx", *LATER},
            marks=pytest.mark.deep,
        ),
    ],
)
def test_nothing_heavy_is_imported_before_it_is_needed(code: str, needs: set[str]) -> None:
    assert not loaded(code) & (needs or set(HEAVY))


@pytest.mark.deep
def test_few_modules_lie_between_the_command_and_the_first_drive(tmp_path: Path) -> None:
    command = [sys.executable, "-c", TRIP, str(tmp_path)]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    entered = lines[lines.index("first drive") + 1 :]
    root = Path(__file__).parents[3]
    ours = {each for name in entered for each in [Path(name)] if each.is_relative_to(root)}
    counted = sorted(str(each) for each in ours if each.relative_to(root).parts[0] in PACKAGES)
    assert len(counted) <= MOST_MODULES, counted
