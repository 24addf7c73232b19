"""End-to-end test of the window: a key press, drive voltage on the simulated bench, points on the screen, a run file."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtWidgets import QApplication

from app.config.bench_file import BenchConfig
from app.gui.shell.main_window import MainWindow
from app.session.state import BenchState
from protocols.base import Quality, RunStatus
from protocols.measurements.sine_dwell import SineDwell
from protocols.resume import ResumableRun, load_resumable
from protocols.runfile.reader import Run
from tests.helpers.main_window import Bench, find, press, sign, tells_what_to_do_by_hand, until, whole_window

DWELL = SineDwell(frequencies_hz=(50.0, 75.0, 150.0), record_s=0.2)


@pytest.fixture
def bench(config: BenchConfig) -> Bench:
    return Bench(config)


@pytest.fixture
def window(
    qt: QApplication,
    bench: Bench,
    config: BenchConfig,
    settings: QSettings,
    tmp_path: Path,
    no_widget_left_behind: None,
) -> Iterator[MainWindow]:
    with whole_window(bench, config, DWELL, tmp_path, settings) as window:
        yield window


def test_a_key_becomes_volts_points_and_a_file(window: MainWindow, tmp_path: Path) -> None:
    rehearsal = find(window, "measure.rehearsal").text()
    assert "3 points" in rehearsal
    assert "−500 … +1500 V" in rehearsal
    press(window, Qt.Key.Key_F5)
    assert window.state.busy
    until(lambda: not window.state.busy, "for the run")
    assert window.state.outcome is not None
    assert window.state.outcome.status is RunStatus.COMPLETED
    assert sign(window) == BenchState.AT_REST.upper()
    (path,) = tmp_path.glob("*_T7_sine-dwell.h5")
    with Run(path) as run:
        measured = 1e6 * run.points()["peak_to_peak"]
    shown = window.measure_page.live_pane.plots.chart.panels[0].drawn_layer("max − min, measured").scatter.points()
    assert [spot.pos().y() for spot in shown] == pytest.approx(list(measured))
    drive, moved = (
        trace.decimated_curve()[1] for trace in window.adapter.feed.traces(window.measure_page.live_pane.time_plot.span)
    )
    assert drive[-1] == pytest.approx(2.5, abs=0.01)
    assert abs(moved[-1]) < 5.0


@pytest.mark.deep
def test_the_run_that_is_gone_on_with_is_read_beside_the_window(
    window: MainWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    press(window, Qt.Key.Key_F5)
    until(lambda: not window.state.busy, "for the run")
    (first,) = tmp_path.glob("*.h5")
    asked, may_read, readers = threading.Event(), threading.Event(), []

    def slowly(path: Path, entries: tuple[int, ...]) -> ResumableRun:
        readers.append(threading.current_thread())
        asked.set()
        assert may_read.wait(60)
        return load_resumable(path, entries)

    monkeypatch.setattr("protocols.resume.load_resumable", slowly)
    window.controller.repeat_entries((1,), tmp_path)
    until(asked.is_set, "for the session to read")
    press(window, Qt.Key.Key_F5)
    window.controller.repeat_entries((2,), tmp_path)
    assert window.strip.view.run.title.endswith(f"reading {first.name}")
    assert window.measure_page.live_pane.plots.chart.layer("max − min, measured").x.size == 3
    may_read.set()
    until(lambda: not window.state.busy, "for the second run")
    assert readers
    assert threading.main_thread() not in readers
    _, second = sorted(tmp_path.glob("*.h5"))
    with Run(second) as run:
        assert run.resumed_from == first
        assert [bool(int(flag) & Quality.SUPERSEDED) for flag in run.points()["quality"]] == [False, True, False, False]


@pytest.mark.deep
def test_stop_pressed_at_a_point_brings_the_bench_to_rest(window: MainWindow, bench: Bench) -> None:
    bench.at_a_point = lambda _: bench.session.stop()
    press(window, Qt.Key.Key_F5)
    assert window.state.busy
    until(lambda: not window.state.busy, "for the run")
    assert window.state.outcome is not None
    assert window.state.outcome.status is RunStatus.STOPPED
    assert sign(window) == BenchState.AT_REST.upper()
    assert window.strip.view.measured == "0 V"


@pytest.mark.deep
@pytest.mark.breaks_the_drive
def test_a_generator_that_dies_mid_run_is_told_as_unsafe_with_what_to_do(window: MainWindow, bench: Bench) -> None:
    bench.at_a_point = lambda laboratory: laboratory.control.inject("generator-power-off")
    press(window, Qt.Key.Key_F5)
    assert window.state.busy
    until(lambda: not window.state.busy, "for the run")
    assert sign(window) == "UNSAFE"
    assert tells_what_to_do_by_hand(window)
    assert "Measured: " in find(window, "notices.unsafe.detail").text()
    assert window.state.exit_code == 3
