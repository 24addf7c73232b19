"""Imports of each command before its first output: help texts and the model load nothing they do not need."""

import subprocess
import sys

import pytest

HEAVY = ("numpy", "pydantic", "scipy", "h5py", "pint", "rich", "matplotlib", "pyvisa", "nidaqmx", "grpc", "PySide6")
LATER = (
    "app.archive.notes",
    "app.identification.sheet_file",
    "app.gui.plots.curves_plot",
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
