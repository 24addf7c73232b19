"""Nothing is imported from the working directory: neither by the program nor by the processes that it starts."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("drivers", "sim_hardware", "model", "protocols", "scipy", "numpy", "pyvisa", "nidaqmx")
MODULES = ("pickle", "json", "threading", "subprocess")


def plant(folder: Path, *names: str) -> Path:
    """Put packages and modules into the folder that leave a trace when they are imported."""
    for name in names:
        text = f"import os\nopen({str(folder / 'imported')!r}, 'a').write('{name} ')\nos._exit(7)\n"
        if name in MODULES:
            (folder / f"{name}.py").write_text(text)
        else:
            (folder / name).mkdir()
            (folder / name / "__init__.py").write_text(text)
    return folder


def python(folder: Path, *arguments: str, path: str = str(ROOT)) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "PYTHONSAFEPATH": ""},
        capture_output=True,
        text=True,
        timeout=120,
    )


CHILDREN = """
import sys
from pathlib import Path
import numpy as np, scipy.io
from app.archive.importing.mat_table import read_mat_table
from drivers.watchdog.client import WatchdogClient
from drivers.watchdog.config import WatchdogConfig
scipy.io.savemat("a.mat", {"frequency_Hz": np.arange(3.0), "amplitude_um": np.ones(3)})
table = read_mat_table(Path("a.mat"))
source = "tests.helpers.watchdog_sources:RecordingSource"
watchdog = WatchdogClient(WatchdogConfig(source, "", 1.0, options={"record": "calls.txt"}))
watchdog.arm()
watchdog.close()
print("done", len(table.columns))
"""


@pytest.mark.deep
def test_watchdog_and_mat_reader_import_nothing_from_it(tmp_path: Path) -> None:
    plant(tmp_path, *FOLDERS, *MODULES)
    path = os.pathsep.join([".", str(ROOT), ""])  # an empty entry is the working directory, too
    # The parent itself is started so that it is not what is tested here; its children inherit the path.
    code = f"import os; os.environ['PYTHONPATH'] = {path!r}\n{CHILDREN}"
    done = python(tmp_path, "-P", "-c", code)
    assert (done.stdout.strip(), done.returncode) == ("done 2", 0), done.stderr
    assert not (tmp_path / "imported").exists()


@pytest.mark.deep
@pytest.mark.parametrize("how", [["-m", "app.cli.main"], ["-c", "from app.cli.main import entry; entry()"]])
def test_a_run_on_the_served_bench_imports_nothing_from_it(how: list[str], tmp_path: Path) -> None:
    plant(tmp_path, *FOLDERS)
    chosen = ["--set", "frequencies_hz=100", "--set", "record_s=0.2"]
    done = python(tmp_path, *how, "--bench", "sim", "--out", ".", "run", "sine-dwell", "--speed", "10", *chosen)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not (tmp_path / "imported").exists()


def test_a_process_that_the_program_spawns_imports_nothing_from_it(tmp_path: Path) -> None:
    plant(tmp_path, *MODULES)
    code = """
import os
import sys
import app.cli
if __name__ == "__main__":
    sys.path.insert(0, "")
    app.cli.forget_working_directory()
    os.environ['PYTHONSAFEPATH'] = '1'  # as `entry` does
    import multiprocessing
    child = multiprocessing.get_context("spawn").Process(target=print, args=("spawned",), daemon=False)
    child.start()
    child.join(60)
    print(child.exitcode, "" in sys.path)
"""
    done = python(tmp_path, "-P", "-c", code)
    assert done.stdout.split() == ["spawned", "0", "False"], done.stderr
    assert not (tmp_path / "imported").exists()
