"""Closing the window: ramps to rest first, asks once during a run, reports if rest is not confirmed."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest
from PySide6.QtCore import QSettings, Qt, QTimer
from PySide6.QtWidgets import QApplication

from app.config.bench_file import BenchConfig
from app.gui.application import InitialForm, OpenedBench, open_window
from app.gui.shell.main_window import MainWindow
from app.gui.status.prompt_card import INPUT_GUARD_S
from app.session.bench_connection import connect
from app.session.state import BenchState
from drivers import ArmedBench, Clock
from drivers.deadlines import Deadline
from drivers.generators.keysight import Keysight33500
from protocols.base import RunStatus
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.main_window import (
    Bench,
    Stage,
    find,
    press,
    sign,
    tells_what_to_do_by_hand,
    until,
    whole_window,
    word,
)
from tests.helpers.messages import assert_names
from tests.helpers.session_events import LIVE, LOST, OPENED, STOPPED


def running(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE)


def test_an_idle_window_closes_without_a_question(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.close()
    until(lambda: not stage.window.isVisible())
    assert stage.session.closed


def test_closing_mid_run_asks_goes_to_rest_and_waits_for_the_session(stage: Stage) -> None:
    stage.session.lets_go = False
    running(stage)
    stage.window.close()
    assert stage.window.isVisible()
    assert find(stage.window, "notices.closing").isVisible()
    assert not stage.session.closed
    assert sign(stage.window) == "LIVE"
    begin = time.monotonic()
    until(lambda: time.monotonic() - begin > INPUT_GUARD_S)
    stage.press(Qt.Key.Key_Return)
    assert stage.session.closed
    assert sign(stage.window) == word(BenchState.GOING_TO_REST)
    stage.happen(*STOPPED)
    assert sign(stage.window) == BenchState.AT_REST.upper(), "the window is alive while it closes"
    assert stage.window.isVisible()
    stage.session.lets_go = True
    until(lambda: not stage.window.isVisible())


@pytest.mark.deep
def test_the_run_goes_on_if_the_window_is_kept(stage: Stage) -> None:
    running(stage)
    stage.window.close()
    stage.press(Qt.Key.Key_F4)
    assert not find(stage.window, "notices.closing").isVisible()
    assert stage.session.stops == 0
    assert sign(stage.window) == "LIVE"


def test_stop_works_while_the_question_stands(stage: Stage) -> None:
    running(stage)
    stage.window.close()
    stage.press(Qt.Key.Key_Escape)
    assert stage.session.stops == 1
    assert stage.window.isVisible()


def test_a_window_that_closes_over_a_lost_rest_stays_until_that_was_read(stage: Stage) -> None:
    stage.session.lets_go = False
    running(stage)
    stage.window.close_session()
    stage.happen(*LOST)
    stage.session.lets_go = True
    stage.window.tick()
    assert stage.window.isVisible()
    assert find(stage.window, "notices.unsafe").isVisible()
    stage.press(Qt.Key.Key_F4)
    until(lambda: not stage.window.isVisible())
    assert stage.window.state.exit_code == 3


@pytest.mark.deep
def test_a_driver_that_hangs_after_stop_is_given_up_unsafe_and_does_not_keep_the_window(
    qt: QApplication, config: BenchConfig, settings: QSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    over, hangs = threading.Event(), threading.Event()

    def hang(*_: object) -> None:
        hangs.set()
        over.wait()

    test_source = ArmedBench.test_source

    def tested(armed: ArmedBench, clock: Clock) -> None:
        test_source(armed, clock)
        monkeypatch.setattr(Keysight33500, "start_drive", hang)

    monkeypatch.setattr(Deadline.STOPPED_RUN, "seconds", 0.2)
    monkeypatch.setattr(ArmedBench, "test_source", tested)
    bench = Bench(config)
    with whole_window(bench, config, SineDwell(frequencies_hz=(100.0,)), tmp_path, settings) as window:
        press(window, Qt.Key.Key_F5)
        until(hangs.is_set, "for the driver to hang")
        assert window.state.busy
        press(window, Qt.Key.Key_Escape)
        until(lambda: not window.state.busy, "for the run to be given up")
        assert sign(window) == "UNSAFE"
        assert tells_what_to_do_by_hand(window)
        assert window.state.outcome is not None
        assert window.state.outcome.status is RunStatus.UNSAFE
        assert_names(find(window, "notices.unsafe.detail").text(), "driver", "hangs")
        assert not window.state.can_run, "its thread would never begin another run"
        window.close_session()
        until(lambda: not find(window, "notices.closing").isVisible(), "for the window to wait for the acknowledgement")
        assert window.isVisible()
        window.controller.acknowledge()
        until(lambda: not window.isVisible(), "for the window to close")
        assert window.state.exit_code == 3
    over.set()
    bench.session._thread.join()


@pytest.mark.deep
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.skipif(os.name != "posix", reason="Windows has no signals that one process sends another")
def test_a_signal_takes_the_same_way_out(
    qt: QApplication, config: BenchConfig, settings: QSettings, tmp_path: Path, number: signal.Signals
) -> None:
    before = signal.getsignal(number)
    seen: list[BenchState] = []

    def interrupt() -> None:
        window = next(w for w in qt.topLevelWidgets() if isinstance(w, MainWindow))
        seen.append(window.state.bench_state)
        if window.state.bench_state is BenchState.LIVE:
            os.kill(os.getpid(), number)
        else:
            QTimer.singleShot(1, interrupt)

    QTimer.singleShot(0, interrupt)
    protocol = SineDwell(frequencies_hz=(100.0,) * 200)
    code = open_window(
        OpenedBench(lambda: connect(config, None), config),
        InitialForm(protocol, tmp_path, "T7", autostart=True),
        settings,
    )
    assert code == 0
    assert seen[-1] is BenchState.LIVE
    assert signal.getsignal(number) == before
    assert not [w for w in qt.topLevelWidgets() if isinstance(w, MainWindow)]
