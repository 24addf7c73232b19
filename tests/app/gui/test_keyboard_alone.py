"""Ten minutes by the keyboard alone: a run, its figures, a comparison, a picture, a bench, and a wiring check."""

from pathlib import Path

import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QFileDialog, QLineEdit, QWidget

from app.config.bench_file import BenchConfig
from app.gui.shell.main_window import MainWindow
from protocols.base import Outcome
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.main_window import Bench, find, until, whole_window

DWELL = SineDwell(frequencies_hz=(60.0, 110.0, 140.0, 150.0, 160.0, 200.0), record_s=0.2)
CTRL, SHIFT, ALT = (
    Qt.KeyboardModifier.ControlModifier,
    Qt.KeyboardModifier.ShiftModifier,
    Qt.KeyboardModifier.AltModifier,
)
NONE = Qt.KeyboardModifier.NoModifier
MOST_STEPS = 150
"""Of Tab: far more than a page has controls."""


def key(window: MainWindow, pressed: Qt.Key, modifier: Qt.KeyboardModifier = NONE) -> None:
    """Press a key where the keyboard is."""
    QTest.keyClick(QApplication.focusWidget() or window, pressed, modifier)
    QTest.qWait(120)  # a key that may begin a scan waits


def type_text(text: str) -> None:
    focused = QApplication.focusWidget()
    assert isinstance(focused, QLineEdit)
    focused.selectAll()
    QTest.keyClicks(focused, text)


def tab_to(window: MainWindow, name: str) -> None:
    """Press Tab until a control has the keyboard."""
    wanted, seen = find(window, name), list[str]()
    for _ in range(MOST_STEPS):
        focused = QApplication.focusWidget()
        if focused is wanted:
            return
        seen.append("nothing" if focused is None else focused.objectName() or type(focused).__name__)
        QTest.keyClick(focused or window, Qt.Key.Key_Tab)
    pytest.fail(f"Tab does not reach {name}: {', '.join(seen)}")


def run(window: MainWindow) -> None:
    key(window, Qt.Key.Key_F5)
    until(lambda: window.state.busy, "for the run")
    until(lambda: not window.state.busy, "for the end of the run")


@pytest.mark.deep
def test_ten_minutes_by_the_keyboard_alone(
    qt: QApplication,
    config: BenchConfig,
    settings: QSettings,
    tmp_path: Path,
) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    with whole_window(Bench(config), config, DWELL, runs, settings) as window:
        window.resize(1366, 768)
        until(lambda: len(window.tabs.created_pages) == window.tabs.count(), "for the pages")
        key(window, Qt.Key.Key_1, CTRL)
        run(window)
        run(window)
        card = window.measure_page.run_panel.result_card
        assert card.isVisible()
        assert "atural frequency" in card.name_label.text()
        assert card.figure_label.text().startswith("1")
        compare_with_earlier(window, runs)
        set_up_a_bench(window)


def compare_with_earlier(window: MainWindow, runs: Path) -> None:
    key(window, Qt.Key.Key_4, CTRL)
    page = window.tabs.runs
    until(lambda: len(page.list.model.summaries) == 2, "for the list")
    assert page.list.table.hasFocus()
    key(window, Qt.Key.Key_Home, CTRL)
    key(window, Qt.Key.Key_Down, SHIFT)
    assert len(page.list.selected) == 2
    key(window, Qt.Key.Key_Return)
    until(lambda: page.currentWidget() is page.workspace, "for the comparison")
    layers = page.workspace.layers
    assert layers.hasFocus()
    key(window, Qt.Key.Key_Space)
    assert [each.hidden for each in page.workspace.comparison.layers].count(True) == 1
    key(window, Qt.Key.Key_Space)
    key(window, Qt.Key.Key_Down, ALT)
    key(window, Qt.Key.Key_R)
    export_a_picture(window, runs)
    key(window, Qt.Key.Key_Escape)
    assert page.currentWidget() is page.list
    read_figures(window)


def export_a_picture(window: MainWindow, runs: Path) -> None:
    key(window, Qt.Key.Key_P, CTRL | SHIFT)
    until(lambda: isinstance(QApplication.activeWindow(), QFileDialog), "for the dialog")
    type_text(str(runs / "two.png"))
    key(window, Qt.Key.Key_Return)
    until((runs / "two.png").exists, "for the picture")
    window.activateWindow()  # which a desktop does when the dialog closes
    until(window.isActiveWindow, "for the window")


def read_figures(window: MainWindow) -> None:
    """Open the newer run and put the cursor on its largest response."""
    key(window, Qt.Key.Key_Up)
    key(window, Qt.Key.Key_Return)
    page = window.tabs.runs
    until(lambda: page.currentWidget() is page.viewer, "for the run")
    canvas = page.viewer.plots.chart.canvas
    canvas.setObjectName("canvas of the run")
    tab_to(window, canvas.objectName())
    key(window, Qt.Key.Key_P)
    assert "µm" in page.viewer.plots.chart.tools.label.text()
    key(window, Qt.Key.Key_D)
    key(window, Qt.Key.Key_Right)
    assert "Δ" in page.viewer.plots.chart.tools.label.text()
    key(window, Qt.Key.Key_Escape)


def set_up_a_bench(window: MainWindow) -> None:
    key(window, Qt.Key.Key_5, CTRL)
    page, chosen = window.tabs.bench, list[str]()
    tab_to(window, "bench.check")
    key(window, Qt.Key.Key_Space)
    until(lambda: window.state.busy, "for the check")
    until(lambda: not window.state.busy, "for the end of the check")
    assert window.state.outcome is not None
    assert window.state.outcome.verdict.outcome is Outcome.GOOD
    assert page.wiring.table.isVisible()
    page.bench_chosen.disconnect()
    page.bench_chosen.connect(chosen.append)
    key(window, Qt.Key.Key_5, CTRL)
    tab_to(window, "bench.new")
    key(window, Qt.Key.Key_Space)
    name: QWidget = find(window, "bench.name")
    until(lambda: name.hasFocus() and page.draft is not None and not page.draft.name, "for the new bench")
    tab_to(window, "bench.kind.False")
    key(window, Qt.Key.Key_Right)
    key(window, Qt.Key.Key_Space)
    until(lambda: page.draft is not None and page.draft.config.simulated and not page.draft.name, "for its kind")
    until(name.hasFocus, "for the name")
    type_text("by-keyboard")
    tab_to(window, "bench.connect")
    key(window, Qt.Key.Key_Space)
    until(lambda: bool(chosen), "for the file")
    assert Path(chosen[0]).name == "by-keyboard.toml"
    Path(chosen[0]).unlink()  # all tests of this process share the folder
