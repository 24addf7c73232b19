"""The doors of the house: what may import what is enforced, and the enforcement works."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("app", "drivers", "model", "protocols", "sim_hardware")


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("house")
    shutil.copy(ROOT / "pyproject.toml", folder)
    for room in ROOMS:
        shutil.copytree(ROOT / room, folder / room, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    code = (
        "import sys; sys.path.insert(0, '.'); from importlinter.cli import lint_imports_command; lint_imports_command()"
    )
    return subprocess.run(
        [sys.executable, "-c", code, "--no-cache"], cwd=folder, capture_output=True, text=True, check=False
    )


def test_the_house_as_it_stands_keeps_its_doors(copy: Path) -> None:
    done = lint(copy)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("where", "planted", "broken"),
    [
        ("drivers/clock.py", "from protocols import events", "The one way"),
        ("model/skin.py", "import drivers", "The one way"),
        ("protocols/base/steps.py", "import sim_hardware.plant.plant", "The one way"),
        ("drivers/sensors/laser_sensor.py", "from model import parameters", "Drivers know nothing"),
        ("model/skin.py", "import pydantic", "The model needs numpy"),
        ("app/session/session.py", "import PySide6.QtCore", "Qt stays"),
        ("app/session/session.py", "import h5py", "HDF5 stays"),
        ("app/session/connect.py", "import pyvisa", "Instrument libraries stay"),
        ("drivers/transport/scpi.py", "import nidaqmx", "Instrument libraries stay"),
    ],
)
def test_a_planted_wrong_import_breaks_the_build(where: str, planted: str, broken: str, copy: Path) -> None:
    file = copy / where
    before = file.read_text()
    file.write_text(f"{before}\n{planted}  # noqa\n")
    try:
        done = lint(copy)
    finally:
        file.write_text(before)
    assert done.returncode != 0
    verdict = re.search(rf"{broken}.*?(KEPT|BROKEN)", " ".join(done.stdout.split()))
    assert verdict is not None
    assert verdict[1] == "BROKEN", done.stdout
