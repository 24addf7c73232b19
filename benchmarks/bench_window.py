"""The whole path with the window open: frames a second, longest gap between two, and scans lost, at three sample rates.

    python benchmarks/bench_window.py [--runs 3]

A sine dwell on the simulated bench over its real wires at real speed, recorded to a file while the window draws, from the key that
begins it until its outcome is on the screen. Works without a screen (then drawing goes to memory).
"""

import argparse
import gc
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
from PySide6.QtCore import QObject, QSettings
from PySide6.QtWidgets import QApplication

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
        f"{'scans/s x channels':>20} {'frames/s':>9} {'longest gap':>12} {'p99':>7} {'scans in file':>14} {'lost':>5}"
    )
    for rate_hz in (5e3, 250e3, 500e3):
        for _ in range(runs):
            case(rate_hz)


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
        frames: list[float] = []
        until(lambda: window.state.can_run)
        gc.freeze()  # as the program does
        watching = window._timer.timeout.connect(lambda: frames.append(time.perf_counter()))
        window.start_run()
        until(lambda: window.state.outcome is not None)
        QObject.disconnect(watching)
        gc.unfreeze()
        with Run(Path(window.state.outcome.path)) as run:
            samples = run.trace.sample_count
            lost = sum(bool(int(quality) & 8) for quality in run.points()["quality"])
        window.close_session(force=True)
        until(lambda: not window.isVisible())
    gaps = np.diff(frames)
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
