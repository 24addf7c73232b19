"""Endurance: growth of memory, threads, descriptors and files over many runs in one notebook session, and in one window.

    python benchmarks/bench_endurance.py [--runs 1000] [--only notebook,window,connections]

Each part runs in a process of its own: a sine dwell of one point on the simulated bench's virtual clock, again and again; and the
notebook's connection to a served simulated bench, opened and closed again. The first half brings what is imported late and fills
caches; the growth over the second half is printed for 100 runs. Files are those in the user's folders and in the folder of the
locks; the run files themselves are not counted.
"""

import argparse
import contextlib
import gc
import io
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import psutil

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

RELEASE_S = 1.0
"""Time that a session needs to return the memory of a run after it has reported the end of the run, s."""

SETTINGS = {"frequencies_hz": (150.0,), "record_s": 0.05}


class Held:
    """What the process holds, noted twice: in the middle and at the end."""

    def __init__(self, home: Path) -> None:
        self._home, self._me = home, psutil.Process()
        self._noted: list[dict[str, float]] = []

    def note(self, pause: Callable[[], object] = lambda: time.sleep(0.1)) -> None:
        """Record the resources in use. At the end, wait for at most a minute until they are no more than in the middle: threads end after their run."""
        begin_s = time.monotonic()
        while time.monotonic() < begin_s + RELEASE_S:
            pause()
        found, end_s = self._look(), time.monotonic() + 60.0
        while self._noted and any(found[name] > self._noted[0][name] for name in found if name != "MB"):
            if time.monotonic() > end_s:
                break
            pause()
            found = self._look()
        self._noted.append(found)

    def _look(self) -> dict[str, float]:
        gc.collect()
        return {
            "MB": self._me.memory_info().rss / 1e6,
            "threads": threading.active_count(),
            "descriptors": self._me.num_fds(),
            "processes": len(self._me.children(recursive=True)),
            "files": sum(path.is_file() for path in self._home.rglob("*")),
        }

    def growth(self, runs: int) -> dict[str, float]:
        """Return the growth from the middle to the end, for 100 runs."""
        first, last = self._noted
        return {name: 100 * (last[name] - first[name]) / runs for name in first}


def notebook(runs: int, folder: Path, held: Held) -> None:
    """Runs of one session of the Python API."""
    import tactor_bench as tb

    with tb.connect("sim", speed="max", folder=folder, progress=False) as bench:
        for half in (runs // 2, runs - runs // 2):
            for _ in range(half):
                with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                    bench.run("sine-dwell", **SETTINGS)
            held.note()


def connections(runs: int, folder: Path, held: Held) -> None:
    """Connections to a served simulated bench, one after the other."""
    import tactor_bench as tb

    for half in (runs // 2, runs - runs // 2):
        for _ in range(half):
            tb.connect("sim", speed=20, folder=folder, progress=False).close()
        held.note()


def window(runs: int, folder: Path, held: Held) -> None:
    """Runs of one main window, without a screen."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from bench_window import until
    from PySide6.QtCore import QSettings

    from app.cli.main import GC_THRESHOLD
    from app.config.bench_file import load_bench
    from app.gui.application import qt_application
    from app.gui.shell.main_window import InitialForm, MainWindow
    from app.live.session_link import SessionAdapter
    from app.session.bench_connection import connect
    from protocols.registry import PROTOCOLS

    qt_application()
    gc.set_threshold(GC_THRESHOLD)  # as the program does
    config, protocol = load_bench("ideal"), PROTOCOLS["sine-dwell"](**SETTINGS)
    kept = QSettings(f"{folder}/settings.ini", QSettings.Format.IniFormat)
    shown = MainWindow(
        SessionAdapter(lambda: connect(config, None)), config, InitialForm(protocol, folder, "bench"), kept
    )
    shown.show()
    for half in (runs // 2, runs - runs // 2):
        for _ in range(half):
            until(lambda: shown.state.can_run)
            shown.start_run()
            until(lambda: shown.state.outcome is not None)
            assert shown.state.outcome is not None
            assert shown.state.outcome.status == "completed"
        held.note(lambda: until(lambda: True))
    shown.close_session(force=True)
    until(lambda: not shown.isVisible())


PARTS: dict[str, Callable[[int, Path, Held], None]] = {
    "notebook": notebook,
    "window": window,
    "connections": connections,
}


def measure(part: str, runs: int) -> dict[str, float]:
    """Return the growth for 100 runs of a part, over the second half of the runs."""
    with tempfile.TemporaryDirectory() as place:
        home = Path(place) / "home"
        environment = {f"XDG_{name}_HOME": str(home / name.lower()) for name in ("CONFIG", "CACHE", "DATA", "STATE")}
        command = [sys.executable, __file__, "--part", part, "--runs", str(runs), "--place", place]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **environment})
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def measure_here(part: str, runs: int, place: Path) -> dict[str, float]:
    from drivers.transport import lock

    setattr(lock, "lock_folder", lambda: place / "home" / "locks")  # noqa: B010 - apart from the computer's
    held = Held(place / "home")
    PARTS[part](runs, place / "runs", held)
    return held.growth(runs - runs // 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--only", default=",".join(PARTS))
    parser.add_argument("--part", choices=list(PARTS), help=argparse.SUPPRESS)
    parser.add_argument("--place", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        print(json.dumps(measure_here(options.part, options.runs, options.place)))
        return
    for part in options.only.split(","):
        runs = options.runs if part != "connections" else max(options.runs // 20, 4)
        shown = ", ".join(f"{value:+.3g} {name}" for name, value in measure(part, runs).items())
        print(f"{part}, {runs} runs: {shown} for 100 runs of the second half", flush=True)


if __name__ == "__main__":
    main()
