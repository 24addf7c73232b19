"""Fault panel: ticked faults are injected into the running simulated bench and shown prominently."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QWidget

from app.archive.description import injected_faults, run_text
from app.config.bench_file import BenchConfig
from app.gui.shell.main_window import InitialForm, MainWindow
from app.gui.status.fault_drawer import FaultDrawer
from app.gui.status.simulation_controls import SimulationControls
from app.gui.widgets import OverlayHost, column, end_all
from app.live.session_link import SessionAdapter
from app.session import AnsweredBy, FaultPlan, SimulationSettings
from app.session.bench_connection import connect
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.reader import Run
from tests.helpers.main_window import OpenStage, Stage, end, find, press, sign, until
from tests.helpers.session_events import OPENED

SHIFT = Qt.KeyboardModifier.ShiftModifier


@pytest.fixture
def window(
    qt: QApplication, config: BenchConfig, settings: QSettings, tmp_path: Path, no_widget_left_behind: None
) -> Iterator[MainWindow]:
    """On the virtual clock; the bench thread waits at every point until the window has drawn it."""
    # Long enough for every test to finish with it on the busiest computer: the tests stop the run themselves.
    protocol = SineDwell(frequencies_hz=(100.0,) * 500, record_s=1.0)
    # A sensor that is stuck for three points would stop the run before a busy computer has cleared the fault.
    config = config.model_copy(update={"levels": config.levels.model_copy(update={"no_response_points": 1000})})
    window = MainWindow(
        SessionAdapter(lambda: connect(config, None)), config, InitialForm(protocol, tmp_path, "T7"), settings
    )
    window.show()
    window.activateWindow()
    assert QTest.qWaitForWindowActive(window, 30_000)
    until(lambda: window.state.can_run, "for the bench")
    yield window
    end(window)


@pytest.mark.deep
def test_f9_begins_at_the_present_speed_and_tab_leads_on_to_the_faults(qt: QApplication) -> None:
    frame, chosen = QWidget(), list[float | None]()
    panel = FaultDrawer(FaultPlan(), frame, SimulationControls(SimulationSettings(20.0), chosen.append))
    host = OverlayHost(QWidget())
    host.add_overlay(panel)
    column(host, parent=frame)
    frame.resize(900, 600)
    frame.show()
    frame.activateWindow()
    assert QTest.qWaitForWindowActive(frame, 30_000)
    panel.toggle()
    assert panel.controls is not None
    assert panel.controls.speeds.buttons[20.0].hasFocus()
    QTest.keyClick(panel.controls.speeds.buttons[20.0], Qt.Key.Key_Left)
    assert chosen == [5.0]
    assert panel.controls.answered_by.selected is AnsweredBy.USER, "who looks at faults answers prompts"
    panel.controls.answered_by.buttons[AnsweredBy.USER].setFocus()
    QTest.keyClick(panel.controls.answered_by.buttons[AnsweredBy.USER], Qt.Key.Key_Tab)
    assert next(iter(panel.fault_boxes.values())).hasFocus()
    end_all(panel)
    frame.close()
    frame.deleteLater()


@pytest.mark.deep
@pytest.mark.breaks_the_drive
def test_a_fault_ticked_by_keys_breaks_the_run_and_both_are_told(window: MainWindow) -> None:
    faults = window.faults
    assert faults is not None
    assert faults.isHidden()
    press(window, Qt.Key.Key_F5)
    until(lambda: window.state.points, "for a point")
    press(window, Qt.Key.Key_F9)
    boxes = list(faults.fault_boxes.values())
    assert boxes[0].hasFocus()
    box = faults.fault_boxes["generator-power-off"]
    for _ in range(boxes.index(box)):
        QTest.keyClick(QApplication.focusWidget(), Qt.Key.Key_Tab)
    assert box.hasFocus()
    QTest.keyClick(box, Qt.Key.Key_Space)
    until(lambda: not window.state.busy, "for the run")
    assert sign(window) == "UNSAFE"
    until(lambda: faults.active_faults, "for the bench's word")
    assert window.adapter.faults.active_faults() == ("generator-power-off",)
    assert faults.count_label.text() == "1 fault on"
    assert any("Fault injected: the generator loses mains" in m.text for m in window.state.messages)
    press(window, Qt.Key.Key_F9)
    assert not faults.isVisible()
    assert window.ribbon.fault_count == 1, "what is broken stays in sight"
    press(window, Qt.Key.Key_F9, SHIFT)
    until(lambda: not faults.active_faults, "for the repair")
    assert window.adapter.faults.active_faults() == ()
    assert window.ribbon.fault_count == 0


@pytest.mark.deep
def test_what_was_broken_stands_in_the_runs_file_also_what_was_broken_before_it(
    window: MainWindow, tmp_path: Path
) -> None:
    def told() -> list[str]:
        return [
            m.text.split(":")[0]
            for m in window.state.messages
            if m.text.startswith(("Fault injected", "Fault cleared"))
        ]

    on, off = "Fault injected", "Fault cleared"
    faults = window.faults
    assert faults is not None
    faults.fault_boxes["sensor-stuck"].click()
    # It is also reported without a run.
    until(lambda: any("Fault injected: the laser" in m.text for m in window.state.messages), "for the bench's word")
    press(window, Qt.Key.Key_F5)
    until(lambda: window.state.points, "for a point")
    faults.clear_button.click()
    until(lambda: not faults.active_faults, "for the repair")
    faults.fault_boxes["clock-drift"].click()
    until(lambda: faults.active_faults, "for the second fault")
    until(lambda: told() == [on, on, off, on], "for the log")
    assert window.state.busy, f"it is told while the run goes on: {[m.text for m in window.state.messages][-8:]}"
    window.controller.stop()
    until(lambda: not window.state.busy, "for the end")
    faults.clear_button.click()
    # The bench acts before its message arrives: wait for the last message.
    labels = [on, on, off, on, off]
    until(lambda: told() == labels, "for the repair after the run to be told")
    (path,) = tmp_path.glob("*.h5")
    with Run(path) as run:
        stuck, drift = injected_faults(run)
        length_s = run.trace.duration_s
        assert stuck.description in run_text(run)
    assert (stuck.fault, stuck.from_s) == ("sensor-stuck", pytest.approx(0.0, abs=0.5))
    assert stuck.until_s is not None
    assert stuck.from_s < stuck.until_s < length_s + 1
    assert (drift.fault, drift.until_s) == ("clock-drift", None), "mended after the run: it does not say when"


def test_stop_is_one_key_while_the_list_is_open(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    press(stage.window, Qt.Key.Key_F9)
    stage.press(Qt.Key.Key_Escape)
    assert stage.session.stops == 1


def test_without_a_bench_a_fault_is_refused_in_words_and_stays_unticked(stage: Stage) -> None:
    faults = stage.window.faults
    assert faults is not None
    press(stage.window, Qt.Key.Key_F9)
    box = faults.fault_boxes["card-unplugged"]
    QTest.mouseClick(box, Qt.MouseButton.LeftButton, pos=box.rect().center() - box.rect().bottomRight() / 2.5)
    until(lambda: "open simulated bench" in faults.message_label.text(), "for the sentence")
    assert not box.isChecked()


def test_a_real_bench_offers_no_faults(
    open_stage: OpenStage, config: BenchConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(BenchConfig, "simulated", property(lambda _: False))
    stage = open_stage()
    assert stage.window.faults is None
    assert not stage.window.ribbon.accessibleName().startswith("SIMULATED")


@pytest.mark.deep
def test_the_list_goes_with_escape_and_gives_the_keyboard_back(stage: Stage) -> None:
    stage.happen(OPENED)
    find(stage.window, "measure.specimen").setFocus()
    stage.press(Qt.Key.Key_F9)
    assert stage.window.faults is not None
    assert stage.window.faults.isVisible()
    stage.press(Qt.Key.Key_Escape)
    assert not stage.window.faults.isVisible()
    assert find(stage.window, "measure.specimen").hasFocus()
