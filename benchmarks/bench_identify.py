"""What a user waits for by the command: identification of one campaign and of many runs, report, campaign, start-up.

    python benchmarks/bench_identify.py [--runs 100,500] [--data FOLDER] [--rounds 5] [--only commands,campaign,many]

Each command is a process of its own; printed are the medians of wall and processor time over the rounds and the largest memory.
Start-up is also printed over `import numpy, scipy, h5py`, taken in turn. The data are made on the virtual clock: the paper's campaign
on the ideal bench, and dwells of 18 points on `sim`, whose model is not adequate. With `--data` they are kept and used again. The
programs run with folders of their own for caches and settings, so that nothing is kept from before; *unchanged* is a second time.
"""

import argparse
import contextlib
import io
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FREQUENCIES_HZ = (25, 50, 75, 100, 125, 150, 155, 160, 165, 170, 175, 180, 185, 190, 195, 200, 225, 250)
PROGRAM = (sys.executable, "-c", "from app.cli.main import entry; entry()")
IMPORTS = (sys.executable, "-c", "import numpy, scipy, h5py")
STARTS = {"runs": ("runs", "{campaign}"), "protocols": ("protocols",), "model modes": ("model", "modes")}


def measured(arguments: tuple[str, ...], home: Path) -> tuple[float, float, float]:
    """Return wall time, processor time and largest memory, s, s and MB, of a command."""
    folders = {f"XDG_{name}_HOME": str(home / name.lower()) for name in ("CONFIG", "CACHE", "DATA", "STATE")}
    # Compiled modules are kept as in an installed program.
    settings = {"OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "", "PYTHONPATH": str(ROOT)}
    began = time.perf_counter()
    process = subprocess.Popen(
        arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env={**os.environ, **folders, **settings}
    )
    assert process.stderr is not None
    told = process.stderr.read().decode()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{' '.join(arguments)[-200:]}: {told}")
    return time.perf_counter() - began, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3


def tell(name: str, rounds: int, command: tuple[str, ...], home: Path, before: Callable[[], None]) -> None:
    taken = []
    for _ in range(rounds):
        before()
        taken.append(measured((*PROGRAM, *command), home))
    wall, used, memory = (statistics.median(column) for column in zip(*taken, strict=True))
    print(f"{name:36} {wall:7.2f} s wall {used:7.2f} s of processor {memory:6.0f} MB", flush=True)


def first_and_unchanged(name: str, rounds: int, command: tuple[str, ...], home: Path) -> None:
    tell(f"{name}, first", rounds, command, home, lambda: shutil.rmtree(home / "cache", ignore_errors=True))
    tell(f"{name}, unchanged", rounds, command, home, lambda: None)


def starts(rounds: int, campaign: Path, home: Path) -> None:
    ratios: dict[str, list[float]] = {name: [] for name in STARTS}
    for turn in range(rounds + 1):
        reference = measured(IMPORTS, home)[1]
        for name, command in STARTS.items():
            used = measured((*PROGRAM, *(part.format(campaign=campaign) for part in command)), home)[1]
            if turn:  # the first brings compiled modules and the index
                ratios[name].append(used / reference)
    for name, found in ratios.items():
        print(
            f"{name:36} {statistics.median(found):7.2f} times import numpy, scipy, h5py (processor; goal 2)", flush=True
        )


def dwells(folder: Path, count: int) -> list[str]:
    """Return the files of dwells, after measuring those that are missing."""
    import tactor_bench as tb

    missing = count - len(list(folder.glob("*.h5")))
    with tb.connect("sim", speed="max", folder=folder, progress=False) as bench:
        for _ in range(missing):
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                bench.run("sine-dwell", frequencies_hz=tuple(map(float, FREQUENCIES_HZ)), record_s=0.1)
    return sorted(map(str, folder.glob("*.h5")))[:count]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", default="100,500")
    parser.add_argument("--data", type=Path, help="folder in which the data are kept")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", default="commands,campaign,many")
    asked = parser.parse_args()
    parts = asked.only.split(",")
    with tempfile.TemporaryDirectory() as temporary:
        data, home = asked.data or Path(temporary) / "data", Path(temporary) / "home"
        campaign = data / "campaign"
        ideal = ("--bench", "ideal", "--speed", "max", "--specimen", "T7")
        if "campaign" in parts or not list(campaign.glob("*.h5")):
            shutil.rmtree(campaign, ignore_errors=True)
            measured((*PROGRAM, "--out", str(campaign), "campaign", "new", "--specimen", "T7"), home)
            run = ("--out", str(campaign), *ideal, "campaign", "run", "--all")
            tell("campaign by the command, ideal", 1, run, home, lambda: None)
        if "commands" in parts:
            starts(asked.rounds, campaign, home)
            files = tuple(sorted(map(str, campaign.glob("*.h5"))))
            first_and_unchanged("identify, one campaign", asked.rounds, ("--bench", "ideal", "identify", *files), home)
            report = ("report", "T7", "--folder", str(campaign), "--out", str(home))
            tell("report, two pages, unchanged", asked.rounds, report, home, lambda: None)
        for count in map(int, asked.runs.split(",") if "many" in parts else ()):
            files = tuple(dwells(data / "dwells", count))
            first_and_unchanged(f"identify, {count} dwells", 1, ("identify", *files), home)


if __name__ == "__main__":
    main()
