"""Comparison of 20 runs, and the list of 5,000: change of layers, cursor under the mouse, first rows, stalls while scrolling and searching.

    python benchmarks/bench_compare.py [--json]

Changes are measured from the call until the plot was painted; paints are those of the plot while the pointer moves across it. The list
has 5,000 rows in the index, of 20 files. All times are of the processor in the window's thread: other programs may run beside. Works without a screen (then drawing goes to memory).
"""

import gc
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
from bench_window import PaintCounter
from PySide6.QtCore import QCoreApplication, QEvent, QObject, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication, QWidget
from timing import seconds, tell

from app.archive import Catalogue
from app.cli.main import GC_THRESHOLD
from app.comparison import open_comparison
from app.config.bench_file import load_bench
from app.gui.application import qt_application
from app.gui.runs.compare import ComparisonWorkspace
from app.gui.runs.page import RunsPage
from app.gui.widgets import end_all
from app.live import Overlay
from model import Relation
from tests.helpers.run_files import finished_run

RUNS, LISTED = 20, 5000
MOVES = 300
SIZE = (1280, 800)
FREQUENCIES = tuple(np.linspace(25.0, 250.0, 18))


class Stalls(QObject):
    """Notes how long each turn of the event loop took."""

    def __init__(self) -> None:
        super().__init__()
        self.longest_s = 0.0

    def during(self, act: Callable[[], object]) -> float:
        """Do something, let Qt work until nothing is left, and return the longest turn in seconds."""
        self.longest_s, begun_s = 0.0, time.thread_time()
        act()
        self.longest_s = time.thread_time() - begun_s
        for _ in range(20):
            begun_s = time.thread_time()
            QCoreApplication.processEvents()
            self.longest_s = max(self.longest_s, time.thread_time() - begun_s)
            time.sleep(0.002)
        return self.longest_s


def measure() -> dict[str, float]:
    qt_application()
    gc.set_threshold(GC_THRESHOLD)  # as the program does
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        paths = [finished_run(here / "runs", f"T{at}", FREQUENCIES, size_m=(at + 10) * 1e-4) for at in range(RUNS)]
        gc.freeze()
        return {**workspace(paths), **listing(here)}


def workspace(paths: list[Path]) -> dict[str, float]:
    opened = seconds(lambda: open_comparison(paths), 3)
    shown = ComparisonWorkspace()
    shown.resize(*SIZE)
    shown.show()
    shown.show_comparison(open_comparison(paths), paths[0].parent)
    QCoreApplication.processEvents()

    def change(**fields: object) -> float:
        begun_s = time.thread_time()
        shown._change(**fields)
        shown.plot.canvas.viewport().repaint()
        return time.thread_time() - begun_s

    names = [path.name for path in paths]
    toggles = [change(hidden=(name,)) for name in names[:10]]
    orders = [change(runs=tuple(names[at:] + names[:at])) for at in range(1, 6)]
    relations = [change(relation=each) for each in (*Relation, *Relation)]
    falls = [change(over=each) for each in ("time", "", "amplitude", "")]
    figures = {
        f"{RUNS} runs opened, ms": 1e3 * median(opened),
        "a layer hidden, ms": 1e3 * median(toggles),
        "slowest change of layers, ms": 1e3 * max(toggles + orders),
        "slowest change of relation or waterfall, ms": 1e3 * max(relations + falls),
        "paints a second under the mouse": moved(shown.plot.canvas.viewport()),
    }
    shown.close()
    shown.deleteLater()
    return figures


def moved(canvas: QWidget) -> float:
    """Move the pointer across the plot, a paint for each place; return the paints a second."""
    paints = PaintCounter()
    QApplication.instance().installEventFilter(paints)
    begun_s = time.thread_time()
    for at in range(MOVES):
        place = QPointF(80 + (canvas.width() - 120) * at / MOVES, canvas.height() / 2)
        none = Qt.MouseButton.NoButton
        where = QPointF(canvas.mapToGlobal(QPoint(0, 0))) + place
        QCoreApplication.sendEvent(
            canvas, QMouseEvent(QEvent.Type.MouseMove, place, where, none, none, Qt.KeyboardModifier.NoModifier)
        )
        QCoreApplication.processEvents()
    taken_s = time.thread_time() - begun_s
    QApplication.instance().removeEventFilter(paints)
    return len(paints.times_s[canvas]) / taken_s


def listing(here: Path) -> dict[str, float]:
    folder, index = here / "runs", here / "index.sqlite"
    catalogue = Catalogue(folder, index)
    catalogue.scan()
    known = catalogue.entries()
    one, many = (folder / known[0].path).stat(), []
    for at in range(LISTED):
        run = known[at % RUNS]
        name, day = f"{at:05d}_{run.name}", f"2026-{1 + at % 12:02d}-{1 + at % 28:02d}T10:00:00.000+00:00"
        os.link(folder / known[0].path, folder / name)
        stamp = {"modified_ns": one.st_mtime_ns, "size": one.st_size, "notes_ns": 0}
        many.append(run._replace(path=name, start_time=day, **stamp))
    catalogue.upsert(many)
    bench = load_bench("ideal")
    page = RunsPage(lambda: folder, lambda: "T1", bench.amplifier, Overlay(bench.amplifier.amplifier_map), index)
    page.resize(*SIZE)
    begun_s = time.thread_time()
    page.show()
    page.tick()
    model = page.list.model
    while model.rowCount() < LISTED:
        QCoreApplication.processEvents()
    page.list.table.viewport().repaint()
    first_rows_s = time.thread_time() - begun_s
    while not page.list.folder_model.is_idle:
        QCoreApplication.processEvents()
    stalls, bar = Stalls(), page.list.table.verticalScrollBar()
    figures = {
        f"first rows of {LISTED}, s": first_rows_s,
        "longest stall in scrolling, ms": 1e3
        * max(stalls.during(lambda at=at: bar.setValue(at)) for at in range(0, bar.maximum(), bar.maximum() // 40)),
        "longest stall in searching, ms": 1e3
        * max(
            stalls.during(lambda text=text: page.list.filter_bar.search_edit.setText(text))
            for text in ("t", "t1", "t1 natural", "specimen:T1", "")
        ),
        "longest stall in sorting, ms": 1e3
        * max(
            stalls.during(lambda at=at: page.list.table.sortByColumn(at, Qt.SortOrder.DescendingOrder))
            for at in (4, 5, 0)
        ),
    }
    end_all(page)
    page.close()
    page.deleteLater()
    return figures


if __name__ == "__main__":
    tell(
        "Comparison of runs and their list.",
        measure,
        [
            ("slowest change of layers, ms", "<", 100.0),
            ("paints a second under the mouse", ">", 50.0),
            (f"first rows of {LISTED}, s", "<", 0.3),
        ],
    )
