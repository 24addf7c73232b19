"""The command line under a stand-in for Windows' rules: open files are locked, no POSIX calls, reserved names, a cp1252 console."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.windows_stand_in import THEN

ROOT = Path(__file__).resolve().parents[2]


def on_windows(folder: Path, *commands: tuple[str, ...]) -> str:
    """Run commands under the stand-in in a folder, one after the other in one process, and return what they printed."""
    environment = {
        **os.environ, "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "cp1252", "QT_QPA_PLATFORM": "offscreen", "LOGNAME": "lab",
    }  # fmt: skip
    arguments = [word for command in commands for word in (THEN, *command)][1:]
    ended = subprocess.run(
        [sys.executable, "-m", "tests.helpers.windows_stand_in", *arguments],
        cwd=folder, env=environment, capture_output=True, timeout=120, check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    said = ended.stdout.decode("cp1252") + ended.stderr.decode("cp1252")
    assert ended.returncode == 0, said
    assert "Traceback" not in said
    return said


@pytest.mark.deep
def test_files_are_written_replaced_moved_and_listed_under_the_rules_of_windows(tmp_path: Path) -> None:
    dwell = (
        "run",
        "sine-dwell",
        "--speed",
        "max",
        "--bench",
        "ideal",
        "--seed",
        "3",
        "--set",
        "frequencies_hz=100,150,160",
    )
    awkward = r"C:\T7: a|b?"
    said = on_windows(tmp_path, (*dwell, "--specimen", awkward), (*dwell, "--specimen", "CON"))
    assert "µm" in said
    reserved, path = sorted((tmp_path / "runs").glob("*.h5"), key=lambda each: "%43ON" not in each.name)
    assert reserved.name.endswith("_%43ON_sine-dwell.h5")
    run, picture = str(path.relative_to(tmp_path)), tmp_path / "run.png"
    said = on_windows(
        tmp_path,
        ("resume", run, "--again", "150", "--speed", "max"),
        ("show", run, "--picture", picture.name),
        ("verify", str(reserved)),
        ("export", run, "--format", "csv", "--out", "sheets"),
        ("backup", "copies"),
        ("backup", "copies"),
        ("checked", run, "--by", "Anna"),
        ("audit", "start"),
        ("campaign", "new", "--specimen", "NUL"),
        ("report", awkward, "--out", "reports"),
        ("fleet", "--csv", "fleet.csv"),
        ("runs",),
    )
    assert "1 good" in said
    assert "CON" in said  # the table has a check mark, which cp1252 lacks
    assert picture.stat().st_size
    assert (tmp_path / "fleet.csv").stat().st_size
    assert list((tmp_path / "reports").glob("*.pdf"))


@pytest.mark.deep
def test_watchdog_and_simulated_bench_are_processes_under_the_rules_of_windows(tmp_path: Path) -> None:
    said = on_windows(tmp_path, ("run", "wiring-check", "--speed", "5", "--bench", "ideal", "--seed", "3"))
    assert "At rest: the card sees 2.500 V" in said
    assert "the watchdog takes it after 2 s" in said


def test_the_stand_in_refuses_what_windows_refuses(tmp_path: Path) -> None:
    script = """
import os, sys
from pathlib import Path
from tests.helpers import windows_stand_in
windows_stand_in.install()
held = Path(sys.argv[1], "held").open("w")
other = Path(sys.argv[1], "other")
other.write_text("x")
for refused in (
    lambda: os.replace(held.name, str(other)), lambda: other.replace(held.name), lambda: Path(held.name).unlink(),
    lambda: Path(sys.argv[1], "con.txt").write_text("x"), lambda: Path(sys.argv[1], "a:b").mkdir(),
):
    try:
        refused()
    except OSError:
        continue
    sys.exit("not refused")
held.close()
Path(held.name).unlink()
exec("import os, sys\\nassert os.name == 'nt' and sys.platform == 'win32' and not hasattr(os, 'fork')", {"__name__": "app.x"})
"""
    ended = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 0, ended.stderr
