"""The Explore page: from a moved slider to the new curve on the screen, and the quick curve against the thorough one.

    python benchmarks/bench_explore.py

Times are told as shares of a frame (16 ms) and ratios; run it on a quiet computer.
"""

import os
import statistics
import time
from typing import Any

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEventLoop, QTimer
from timing import seconds

from app.explore.fit import fit_runs
from app.gui.application import qt_application
from app.gui.explore.model import PAINT_PAUSE_S
from app.gui.explore.page import ExplorePage
from app.gui.explore.plot import ExplorePlot
from app.gui.widgets import end_all
from model.response.fast_response import response_curve
from model.response.harmonic_response import amplifier_response
from model.specimen import Specimen

FRAME_MS = 16.0


def main() -> None:
    qt_application()
    page = ExplorePage(fit_runs)
    page.resize(1280, 560)
    page.show()
    page.tick()
    pause(1000)
    for name, start, step, rest_s in (
        ("k2", 7e-3, 1e-5, PAINT_PAUSE_S),
        ("L1", 8e-3, 1e-5, PAINT_PAUSE_S),
        ("delta", 0.0, 2e-4, PAINT_PAUSE_S),
        ("k2", 8e-3, 1e-5, 0.0),
    ):
        page.model.worker._pause_s = rest_s
        if not rest_s:
            print("without a rest between the curve and the motion:")
        both = [slide(page, name, start + i * step) for i in range(1, 60)]
        spent, busy = [wall for wall, _ in both], statistics.median(cpu for _, cpu in both)
        print(
            f"{name:>6} to curve painted: median {statistics.median(spent):.1f} ms, 9 in 10 below "
            f"{np.percentile(spent, 90):.1f} ms; {100 * np.mean(np.array(spent) < FRAME_MS):.0f} % within a frame; "
            f"processor time of all threads {busy:.1f} ms"
        )
    end_all(page)
    f = np.linspace(1, 250, 300)
    quick = min(seconds(lambda: response_curve(Specimen(), f), 15))
    thorough = min(seconds(lambda: amplifier_response(Specimen().tactor, f), 15))
    print(f"quick curve {1e3 * quick:.1f} ms, {thorough / quick:.0f} times as fast as the thorough one")


class Paints:
    """When the plot was painted last: what a person waits for."""

    def __init__(self) -> None:
        self.waiting: QEventLoop | None = None
        self.drawn = False
        paint, show = pg.GraphicsView.paintEvent, ExplorePlot.show_result

        def painted(view: Any, event: Any) -> None:
            paint(view, event)
            if self.drawn and self.waiting is not None and isinstance(view.parent(), ExplorePlot):
                self.waiting.quit()

        def shown(plot: Any, *answer: Any) -> None:
            show(plot, *answer)
            self.drawn = True

        pg.GraphicsView.paintEvent, ExplorePlot.show_result = painted, shown

    def wait(self) -> None:
        self.waiting = QEventLoop()
        self.waiting.exec()
        self.waiting = None


PAINTS = Paints()


def slide(page: ExplorePage, name: str, value: float) -> tuple[float, float]:
    pause(60)
    PAINTS.drawn = False
    begin, busy = time.perf_counter(), time.process_time()
    page.model.set_value(name, value)
    PAINTS.wait()
    spent, busy = time.perf_counter() - begin, time.process_time() - busy
    pause(30)
    page.tick()
    return 1e3 * spent, 1e3 * busy


def pause(ms: int) -> None:
    loop = QEventLoop()
    QTimer.singleShot(ms, loop.quit)
    loop.exec()


if __name__ == "__main__":
    main()
