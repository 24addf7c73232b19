"""The whole way: a key pressed in the window, volts on the simulated bench, points on the screen, a file on the disk."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PySide6.QtCore import QSettings, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from app.build import Laboratory, connect
from app.config import BenchConfig
from app.gui.link import Link
from app.gui.window import MainWindow
from app.view import BenchState
from protocols.events import Status
from protocols.runreader import Run
from protocols.sine_dwell import SineDwell
from tests.app.gui.stage import end, until

DWELL = SineDwell(frequencies_hz=(50.0, 75.0, 150.0), record_s=0.2)


def test_a_key_becomes_volts_points_and_a_file_and_a_fault_is_told(
    qt: QApplication, config: BenchConfig, settings: QSettings, tmp_path: Path, no_widget_left_behind: None
) -> None:
    there: list[Laboratory] = []

    @contextmanager
    def open_bench() -> Iterator[Laboratory]:
        with connect(config, None) as laboratory:
            there.append(laboratory)
            yield laboratory

    window = MainWindow(Link(open_bench), config, DWELL, tmp_path, "T7", settings)
    window.show()
    window.activateWindow()
    assert QTest.qWaitForWindowActive(window, 5000)
    until(lambda: window.view.connected, "for the bench")
    assert "3 points" in window.measure.panel.rehearsal.text()
    assert "−500 … +1500 V" in window.measure.panel.rehearsal.text()

    QTest.keyClick(window, Qt.Key.Key_F5)
    until(lambda: not window.view.busy, "for the run")
    assert window.view.outcome is not None
    assert window.view.outcome.status is Status.COMPLETED
    assert window.bar.state.words == "AT REST"
    shown = window.measure.response.scatters[0].points()
    (path,) = tmp_path.glob("*.h5")
    with Run(path) as run:
        measured = 1e6 * run.points()["peak_to_peak"]
    assert [round(spot.pos().y(), 3) for spot in shown] == [round(y, 3) for y in measured]
    drive = window.link.feed.traces(window.measure.traces.span)[0].curve()[1]
    assert drive.size > 100

    there[0].control.inject("generator-power-off")
    window.run()
    until(lambda: not window.view.busy, "for the failure")
    assert window.view.outcome.status is not Status.COMPLETED
    assert window.notices.isVisible()
    assert window.view.state in (BenchState.UNSAFE, BenchState.IDLE, BenchState.AT_REST)

    there[0].control.clear()
    end(window)
