"""The whole path with the window open: paints a second, longest gap between two, and scans lost, at three sample rates.

    python benchmarks/bench_window.py [--runs 3]

A sine dwell on the simulated bench over its real wires at real speed, recorded to a file while the window draws, from the key that
begins it until its outcome is on the screen. Paints are those of the plot that is painted most often, the live trace; lost are the scans
within recordings that the card counted and the file does not have. Works without a screen (then drawing goes to memory).
"""

import argparse
import gc
import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
from bench_throughput import lost_scans
from PySide6.QtCore import QEvent, QObject, QSettings
from PySide6.QtWidgets import QApplication, QGraphicsView

from app.cli.headless import make_protocol
from app.cli.main import GC_THRESHOLD
from app.config.bench_file import load_bench
from app.gui.application import qt_application
from app.gui.main_window import MainWindow
from app.live.session_link import SessionAdapter
from app.session.bench_connection import connect
from protocols.runfile.reader import Run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3)
    runs = parser.parse_args().runs
    qt_application()
    gc.set_threshold(GC_THRESHOLD)  # as the program does
    print(
        f"{'scans/s x channels':>20} {'paints/s':>9} {'longest gap':>12} {'p99':>7} {'scans in file':>14} {'lost':>5}"
    )
    for rate_hz in (5e3, 250e3, 500e3):
        for _ in range(runs):
            case(rate_hz)


class PaintCounter(QObject):
    """Notes when each plot is painted."""

    def __init__(self) -> None:
        super().__init__()
        self.times_s: dict[QObject, list[float]] = defaultdict(list)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint and isinstance(watched.parent(), QGraphicsView):
            self.times_s[watched].append(time.perf_counter())
        return False


def case(rate_hz: float) -> None:
    config = load_bench("ideal")
    card = {**config.simulation["card"], "max_rate_hz": max(500e3, 2 * rate_hz)}
    config = config.model_copy(update={"simulation": {**config.simulation, "card": card}})
    protocol = make_protocol("sine-dwell", ["frequencies_hz=50,100,150,160,170,200", f"sample_rate_hz={rate_hz}"])
    with tempfile.TemporaryDirectory() as folder:
        settings = QSettings(f"{folder}/settings.ini", QSettings.Format.IniFormat)
        window = MainWindow(
            SessionAdapter(lambda: connect(config, 1.0)), config, protocol, Path(folder), "bench", settings
        )
        window.show()
        paints = PaintCounter()
        until(lambda: window.state.can_run)
        gc.freeze()  # as the program does
        QApplication.instance().installEventFilter(paints)
        window.start_run()
        until(lambda: window.state.outcome is not None)
        QApplication.instance().removeEventFilter(paints)
        gc.unfreeze()
        with Run(Path(window.state.outcome.path)) as run:
            samples = run.trace.sample_count
            lost = lost_scans(run)
        window.close_session(force=True)
        until(lambda: not window.isVisible())
    gaps = np.diff(max(paints.times_s.values(), key=len))
    print(
        f"{rate_hz:>16.0f} x 2 {1 / gaps.mean():>9.1f} {1e3 * gaps.max():>9.0f} ms {1e3 * np.percentile(gaps, 99):>4.0f} ms "
        f"{samples:>14} {lost:>5}",
        flush=True,
    )


def until(condition: Callable[[], bool]) -> None:
    while not condition():
        QApplication.processEvents()
        time.sleep(0.0005)


if __name__ == "__main__":
    main()
