"""From process start to a painted window, against a bare pyqtgraph window with the same libraries, in one run.

    python benchmarks/bench_startup.py [--runs 5]

Each figure is a whole process: the interpreter starts, the window is shown and painted once, the process ends. The bench is
not waited for: it is connected in its own thread.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time

BARE = """
import pyqtgraph as pg
app = pg.mkQApp()
plot = pg.PlotWidget()
plot.plot([0, 1], [0, 1])
plot.show()
app.processEvents()
plot.grab()
import os; os._exit(0)
"""

OURS = """
import os
from app.commands import make_protocol  # in the order of the program: PySide6 looks through every module imported after it
from app.config import load_bench
from app.build import connect
from PySide6.QtCore import QSettings, QTimer
from app.gui import application, window

shown = window.MainWindow.showEvent
def show_event(self, event):
    shown(self, event)
    QTimer.singleShot(0, lambda: (self.grab(), os._exit(0)))
window.MainWindow.showEvent = show_event
config = load_bench("sim")
application.open_window(lambda: connect(config, 1.0), config, make_protocol("sine-dwell", []), settings=QSettings(os.environ["PYTHONPYCACHEPREFIX"] + "/bench.ini", QSettings.Format.IniFormat))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    folder = tempfile.TemporaryDirectory()
    # Compiled once, as an installed program is; the first round does that, and warms the disk's cache.
    environment = {"QT_QPA_PLATFORM": "offscreen", **os.environ, "PYTHONPYCACHEPREFIX": folder.name}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    times: dict[str, list[float]] = {"bare": [], "ours": []}
    for k in range(runs + 1):
        for name, code in (("bare", BARE), ("ours", OURS)):
            begin = time.perf_counter()
            subprocess.run([sys.executable, "-c", code], env=environment, check=True)
            if k:
                times[name].append(time.perf_counter() - begin)
    ratio = statistics.median(o / b for o, b in zip(times["ours"], times["bare"], strict=True))
    folder.cleanup()
    for name, seconds in times.items():
        print(f"{name}: median {statistics.median(seconds):.2f} s ({min(seconds):.2f} to {max(seconds):.2f})")
    print(f"ours / bare: {ratio:.2f}")


if __name__ == "__main__":
    main()
