"""Memory of the program while its window shows an hour of simulated running, every twelfth of it.

    python benchmarks/bench_memory.py [--minutes 60]

A sine dwell on the simulated bench's virtual clock, recorded to a file while the window draws; points of half a minute. The first
half brings what is imported late and fills HDF5's caches and the allocator's arenas; in the second nothing should grow.
"""

import argparse
import gc
import os
import tempfile
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import psutil
from bench_window import until
from PySide6.QtCore import QSettings

from app.cli.headless import make_protocol
from app.cli.main import GC_THRESHOLD
from app.config.bench_file import load_bench
from app.gui.application import qt_application
from app.gui.shell.main_window import InitialForm, MainWindow
from app.live.session_link import SessionAdapter
from app.session.bench_connection import connect

RECORD_S = 28.0
RATE_HZ = 5000.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    minutes = parser.parse_args().minutes
    qt_application()
    gc.set_threshold(GC_THRESHOLD)  # as the program does
    config = load_bench("ideal")
    points = int(60 * minutes / (RECORD_S + 1))
    frequencies = ",".join(f"{50 + 150 * k / points:.2f}" for k in range(points))
    settings = [f"frequencies_hz={frequencies}", f"record_s={RECORD_S}", f"sample_rate_hz={RATE_HZ}"]
    protocol = make_protocol("sine-dwell", settings)
    me = psutil.Process()
    held: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        kept = QSettings(f"{folder}/settings.ini", QSettings.Format.IniFormat)
        window = MainWindow(
            SessionAdapter(lambda: connect(config, None)), config, InitialForm(protocol, Path(folder), "bench"), kept
        )
        window.show()
        until(lambda: window.state.can_run)
        gc.freeze()  # as the program does
        window.start_run()
        for k in range(1, 13):
            due_s = k * 5 * minutes
            until(lambda due_s=due_s: window.adapter.feed.streamed_s >= due_s or window.state.outcome is not None)  # type: ignore[misc]
            held.append((window.adapter.feed.streamed_s / 60.0, me.memory_info().rss / 1e6))
            print(f"{held[-1][0]:6.1f} min {held[-1][1]:7.1f} MB", flush=True)
        until(lambda: window.state.outcome is not None)
        print(f"{window.state.outcome.status if window.state.outcome else ''}: {len(window.state.points)} points")
        window.close_session(force=True)
        until(lambda: not window.isVisible())
    second = [megabytes for _, megabytes in held[6:]]
    print(
        f"in the second half {min(second):.0f} to {max(second):.0f} MB; the end is {second[-1] / held[5][1]:.2f} times the middle"
    )


if __name__ == "__main__":
    main()
