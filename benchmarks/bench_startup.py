"""From process start to a painted window, against bare pyqtgraph windows with the same libraries, in one run.

    python benchmarks/bench_startup.py [--runs 7]

Each figure is a whole process: the interpreter starts, the window is shown and painted, the process ends. Wall time and processor
time, which other programs on the computer change less. Two windows to compare
with: one of pyqtgraph alone, and one that also imports what every start of this program needs of other people's (pydantic, which
reads bench files and makes the forms). Ours is the command `tactor-bench` itself; the bench is not waited for: it is connected in
its own thread.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

BARE = """
import os
import pyqtgraph as pg
app = pg.mkQApp()
plot = pg.PlotWidget()
plot.plot([0, 1], [0, 1])
plot.show()
app.processEvents()
plot.grab()
os._exit(0)
"""

LIBRARIES = """
import os
import numpy
import pydantic.types
class Table(pydantic.BaseModel):
    value: float = 0.0
"""

OURS = """
import os, sys
from app.cli.main import main
class Painted:  # notified when the window's module is first imported; requests the first paint only then
    def find_spec(self, name, path, target=None):
        if name == "app.gui.application":
            sys.meta_path.remove(self)
            from PySide6.QtCore import QTimer
            from app.gui.shell import main_window
            shown = main_window.MainWindow.showEvent
            def show_event(self, event):
                shown(self, event)
                QTimer.singleShot(0, lambda: (self.grab(), os._exit(0)))
            main_window.MainWindow.showEvent = show_event
sys.meta_path.insert(0, Painted())
main([])
"""

PLAIN, SAME, PROGRAM = "pyqtgraph alone", "pyqtgraph and the same libraries", "this program"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=7)
    runs = parser.parse_args().runs
    times: dict[str, list[float]] = {PLAIN: [], SAME: [], PROGRAM: []}
    cpu: dict[str, list[float]] = {PLAIN: [], SAME: [], PROGRAM: []}
    with tempfile.TemporaryDirectory() as folder:
        # Compiled once, as an installed program is; the first round does that, and warms the disk's cache. Settings are kept
        # there too: not the page a newcomer sees.
        environment = {
            "QT_QPA_PLATFORM": "offscreen",
            **os.environ,
            "PYTHONPYCACHEPREFIX": folder,
            "XDG_CONFIG_HOME": folder,
            "PYTHONPATH": str(Path.cwd()),
        }
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        for k in range(runs + 1):
            for name, code in ((PLAIN, BARE), (SAME, LIBRARIES + BARE), (PROGRAM, OURS)):
                begin, before_s = time.perf_counter(), children_s()
                subprocess.run([sys.executable, "-c", code], env=environment, check=True, cwd=folder)
                if k:
                    times[name].append(time.perf_counter() - begin)
                    cpu[name].append(children_s() - before_s)
    for name, seconds in times.items():
        print(
            f"{name}: median {statistics.median(seconds):.2f} s ({min(seconds):.2f} to {max(seconds):.2f}), "
            f"processor {statistics.median(cpu[name]):.2f} s"
        )
    for name in (PLAIN, SAME):
        wall, processor = (
            statistics.median(o / b for o, b in zip(each[PROGRAM], each[name], strict=True)) for each in (times, cpu)
        )
        print(f"{PROGRAM} / {name}: {wall:.2f}, processor {processor:.2f}")


def children_s() -> float:
    """Processor time of the processes that have ended."""
    spent = os.times()
    return spent.children_user + spent.children_system


if __name__ == "__main__":
    main()
