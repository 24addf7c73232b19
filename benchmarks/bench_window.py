"""The whole path with the window open: paints a second, longest gap, processor time, input latency, and scans lost.

    python benchmarks/bench_window.py [--runs 3] [--campaign 20]

Part 1: a sine dwell on the simulated bench over its real wires at real speed, recorded to a file while the window draws, from the key that
begins it until its outcome is on the screen, at three sample rates and for two spans of the live traces. Paints are those of the plot
that is painted most often, the live traces; lost are the scans within recordings that the card counted and the file does not have.
Processor time is that of the program, in percent of one core; the simulated instruments have a process of their own.

Part 2: the paper's campaign in the window, some seconds of it at real speed and on the virtual clock.

Input latency: a thread presses the mouse on a button (part 1) or a key in the list of measurements (part 2) at random moments;
measured until the paint event of that widget that shows the answer. Works without a screen (then drawing goes to memory).
"""

import argparse
import gc
import os
import random
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program does, before numpy is imported

import numpy as np
from bench_throughput import lost_scans
from PySide6.QtCore import QCoreApplication, QEvent, QEventLoop, QObject, QPointF, QSettings, Qt, QTimer
from PySide6.QtGui import QKeyEvent, QMouseEvent
from PySide6.QtWidgets import QApplication, QGraphicsView, QPushButton, QWidget

from app.cli.headless import make_protocol
from app.cli.main import GC_THRESHOLD
from app.config import BenchConfig
from app.config.bench_file import load_bench
from app.gui.application import SWITCH_INTERVAL_S, qt_application
from app.gui.shell.main_window import InitialForm, MainWindow
from app.gui.shell.page_host import CAMPAIGN
from app.live.session_link import SessionAdapter
from app.session.bench_connection import connect
from protocols.base import Protocol
from protocols.runfile.reader import Run

MIN_PAUSE_S, MAX_PAUSE_S = 0.03, 0.15
"""Between two inputs."""

LONGEST_ANSWER_S = 1.0
"""After which another input is posted: the program itself had meanwhile chosen the item that the key chooses."""

NO_BUTTON = Qt.MouseButton.NoButton
PROTOCOL = "frequencies_hz=50,100,150,160,170,200"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="of each case; 0 for none")
    parser.add_argument("--campaign", type=float, default=20.0, help="seconds of each campaign; 0 for none")
    options = parser.parse_args()
    qt_application()
    gc.set_threshold(GC_THRESHOLD)  # as the program does
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    latency = f"{'input, median':>14} {'p99':>7} {'longest':>8}"
    print(
        f"{'scans/s x channels':>20} {'span':>6} {'paints/s':>9} {'longest gap':>12} {'p99':>7} {'CPU':>5} {latency} "
        f"{'scans in file':>14} {'lost':>5}"
    )
    for rate_hz in (5e3, 250e3, 500e3):
        for span in (0, 1):
            for _ in range(options.runs):
                dwell(rate_hz, span)
    if options.campaign:
        print(f"{'campaign':>20} {'ticks/s':>9} {'longest gap':>12} {'p99':>7} {'CPU':>5} {latency}")
        for name, speed in (("real speed", 1.0), ("virtual clock", None)):
            campaign(name, speed, options.campaign)


class PaintCounter(QObject):
    """Notes when each plot is painted."""

    def __init__(self) -> None:
        super().__init__()
        self.times_s: dict[QObject, list[float]] = defaultdict(list)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint and isinstance(watched.parent(), QGraphicsView):
            self.times_s[watched].append(time.perf_counter())
        return False


class InputProbe(QObject):
    """Posts an input to a widget at random moments from a thread, and measures until the paint that shows the answer.

    Args:
        target: receives the inputs.
        painted: the widget whose paint event shows the answer.
        make: makes the events of the n-th input, at most one answer.
        shown: state that changes with the answer, when it is painted.
    """

    def __init__(
        self, target: QWidget, painted: QWidget, make: Callable[[int], QEvent], shown: Callable[[], object]
    ) -> None:
        super().__init__()
        self._target, self._make, self._shown = target, make, shown
        self.latencies_s: list[float] = []
        self._posted_s, self._before, self._ended = 0.0, shown(), threading.Event()
        self._thread = threading.Thread(target=self._post, name="inputs")
        painted.installEventFilter(self)
        self._thread.start()

    def eventFilter(self, _watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint and self._posted_s and self._shown() != self._before:
            self.latencies_s.append(time.perf_counter() - self._posted_s)
            self._before, self._posted_s = self._shown(), 0.0
        return False

    def _post(self) -> None:
        dice, count = random.Random(1), 0
        while not self._ended.wait(dice.uniform(MIN_PAUSE_S, MAX_PAUSE_S)):
            if not self._posted_s or time.perf_counter() - self._posted_s > LONGEST_ANSWER_S:
                event = self._make(count)
                self._posted_s = time.perf_counter()
                QCoreApplication.postEvent(self._target, event)
                count += 1

    def close(self) -> str:
        """Stop, and return median, 99th percentile and longest latency as text."""
        self._ended.set()
        self._thread.join()
        middle, high, most = 1e3 * np.percentile(self.latencies_s, (50, 99, 100))
        return f"{middle:>11.1f} ms {high:>4.0f} ms {most:>5.0f} ms"


def press_and_leave(button: QPushButton) -> InputProbe:
    """Press the mouse on a button and release it elsewhere: it is drawn pressed, then released, and not clicked."""

    def make(count: int) -> QEvent:
        if count % 2:
            return QMouseEvent(
                QEvent.Type.MouseMove, QPointF(-99, -99), QPointF(), NO_BUTTON, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
            )  # fmt: skip
        left = Qt.MouseButton.LeftButton
        return QMouseEvent(QEvent.Type.MouseButtonPress, QPointF(5, 5), QPointF(), left, left, Qt.KeyboardModifier.NoModifier)  # fmt: skip

    return InputProbe(button, button, make, button.isDown)


@contextmanager
def opened(config: BenchConfig, speed: float | None, protocol: Protocol, folder: Path) -> Iterator[MainWindow]:
    """A window with a connected bench."""
    settings = QSettings(str(folder / "settings.ini"), QSettings.Format.IniFormat)
    window = MainWindow(
        SessionAdapter(lambda: connect(config, speed)), config, InitialForm(protocol, folder, "bench"), settings
    )
    window.show()
    until(lambda: window.state.can_run)
    gc.freeze()  # as the program does
    yield window
    gc.unfreeze()
    window.close_session(force=True)
    until(lambda: not window.isVisible())


def dwell(rate_hz: float, span: int) -> None:
    config = load_bench("ideal")
    card = {**config.simulation["card"], "max_rate_hz": max(500e3, 2 * rate_hz)}
    config = config.model_copy(update={"simulation": {**config.simulation, "card": card}})
    protocol = make_protocol("sine-dwell", [PROTOCOL, f"sample_rate_hz={rate_hz}"])
    with tempfile.TemporaryDirectory() as folder, opened(config, 1.0, protocol, Path(folder)) as window:
        plot = window.measure_page.live_pane.time_plot
        plot.select_span(span)
        paints = PaintCounter()
        QApplication.instance().installEventFilter(paints)
        probe = press_and_leave(
            next(b for b in plot.findChildren(QPushButton) if b.isCheckable() and not b.isChecked())
        )
        began_s, cpu_s = time.perf_counter(), time.process_time()
        window.start_run()
        until(lambda: window.state.outcome is not None)
        cpu = (time.process_time() - cpu_s) / (time.perf_counter() - began_s)
        QApplication.instance().removeEventFilter(paints)
        latency = probe.close()
        with Run(Path(window.state.outcome.path)) as run:
            samples = run.trace.sample_count
            lost = lost_scans(run)
        shown_s = plot.span.shown_s
    gaps = np.diff(max(paints.times_s.values(), key=len))
    print(f"{rate_hz:>16.0f} x 2 {shown_s:>4g} s {describe(gaps, cpu)} {latency} {samples:>14} {lost:>5}", flush=True)


def campaign(name: str, speed: float | None, seconds: float) -> None:
    ticks: list[float] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        opened(load_bench("ideal"), speed, make_protocol("sine-dwell", []), Path(folder)) as window,
    ):
        window.tabs.setCurrentIndex(CAMPAIGN)
        page = window.tabs.campaign
        page.create_campaign("bench")
        until(lambda: page.controller.summary is not None)
        page.run()
        until(lambda: window.state.busy)
        items = page.board.item_list
        timer = QTimer(interval=1, timerType=Qt.TimerType.PreciseTimer)
        timer.timeout.connect(lambda: ticks.append(time.perf_counter()))
        timer.start()
        probe = InputProbe(
            items,
            items.viewport(),
            lambda _: QKeyEvent(
                QEvent.Type.KeyPress,
                Qt.Key.Key_Up if items.currentRow() > 0 else Qt.Key.Key_Down,
                Qt.KeyboardModifier.NoModifier,
            ),
            items.currentRow,
        )
        began_s, cpu_s = time.perf_counter(), time.process_time()
        starter = QTimer(interval=200)  # the operator starts item after item
        starter.timeout.connect(lambda: None if window.state.busy or page.controller.is_busy else page.run())
        starter.start()
        until(lambda: time.perf_counter() - began_s > seconds)
        starter.stop()
        cpu = (time.process_time() - cpu_s) / (time.perf_counter() - began_s)
        timer.stop()
        latency = probe.close()
        window.controller.stop()
        until(lambda: not window.state.busy)
    print(f"{name:>20} {describe(np.diff(ticks), cpu)} {latency}", flush=True)


def describe(gaps_s: np.ndarray, cpu: float) -> str:
    return f"{1 / gaps_s.mean():>9.1f} {1e3 * gaps_s.max():>9.0f} ms {1e3 * np.percentile(gaps_s, 99):>4.0f} ms {cpu:>5.0%}"


def until(condition: Callable[[], bool]) -> None:
    """Run Qt's event loop until a condition is true, as the program's own loop does."""
    loop, timer = QEventLoop(), QTimer(interval=20)
    timer.timeout.connect(lambda: condition() and loop.quit())
    timer.start()
    loop.exec()


if __name__ == "__main__":
    main()
