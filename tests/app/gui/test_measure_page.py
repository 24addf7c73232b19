"""The measuring page with any protocol: choosing it, presets, pausing, prompts with answers, measuring points again."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from app.gui.measure.presets import PresetError, Presets, presets_path
from app.session.session import Refused
from drivers.drive import Sine
from protocols.base.events import (
    Answered,
    Armed,
    Asked,
    EntryBegan,
    Paused,
    Playing,
    PointMeasured,
    Resumed,
    RunEnded,
    RunStarted,
    Status,
)
from protocols.base.operator import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE
from protocols.base.quality import Quality
from protocols.base.steps import Prompt
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.wiring_check import WiringCheck
from tests.app.gui.test_other_protocols import POINT
from tests.helpers.main_window import Stage, until
from tests.helpers.session_events import AT_REST, LIVE, OPENED, STARTED, point

CTRL = Qt.KeyboardModifier.ControlModifier
WEIGHT = Prompt("place-weight", "Put 50 g on", {"mass_kg": 0.05}, ("done", "repeat the last", "skip"), hands_on=True)


@pytest.fixture(autouse=True)
def own_presets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


def live(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.run()
    stage.happen(*LIVE)


def test_another_protocol_brings_its_form_and_keeps_what_the_last_one_said(stage: Stage, tmp_path: Path) -> None:
    stage.happen(OPENED)
    panel = stage.window.measure.panel
    panel.form.rows["peak_to_peak_v"].set("4 V")
    panel.choice.setCurrentIndex(panel.choice.findData("wiring-check"))
    assert panel.kind is WiringCheck
    assert "level_v" in panel.form.rows
    assert stage.window.measure.plots.currentWidget() is stage.window.measure.points
    stage.press(Qt.Key.Key_F5)
    assert stage.session.runs == [(WiringCheck(), tmp_path, "T7")]
    stage.happen(*LIVE[:0], RunEnded(Status.STOPPED, "x", "run.h5"))
    panel.choice.setCurrentIndex(panel.choice.findData("sine-dwell"))
    assert panel.protocol == SineDwell(peak_to_peak_v=4.0)
    assert stage.window.measure.plots.currentWidget() is stage.window.measure.response


def test_presets_are_kept_taken_and_forgotten(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    stage.happen(OPENED)
    panel = stage.window.measure.panel
    panel.form.rows["record_s"].set("2")
    monkeypatch.setattr("app.gui.measure.presets.QInputDialog.getText", lambda *_: ("slow", True))
    actions(panel.presets)["Keep these as …"].trigger()
    panel.form.rows["record_s"].set("9")
    actions(panel.presets)["slow"].trigger()
    assert panel.protocol == SineDwell(record_s=2.0)
    actions(panel.presets)["The paper's"].trigger()
    assert panel.protocol == SineDwell()
    assert list(json.loads(presets_path().read_text("utf-8"))["sine-dwell"]) == ["slow"]
    actions(panel.presets)["Forget"].menu().actions()[0].trigger()
    assert "slow" not in actions(panel.presets)


def actions(button: Any) -> dict[str, Any]:
    button.menu().aboutToShow.emit()
    return {action.text(): action for action in button.menu().actions()}


def test_presets_that_do_not_fit_are_a_sentence(tmp_path: Path) -> None:
    presets = Presets(tmp_path / "presets.json")
    assert presets.names("sine-dwell") == []
    presets.path.write_text('{"sine-dwell": {"wild": {"record_s": -1}}}')
    with pytest.raises(PresetError, match="'wild' does not fit: record_s"):
        presets.get(SineDwell, "wild")
    with pytest.raises(PresetError, match="no preset 'tame'"):
        presets.get(SineDwell, "tame")
    presets.path.write_text("{")
    with pytest.raises(PresetError, match="cannot be read"):
        presets.names("sine-dwell")


def test_pause_is_one_key_and_says_that_high_voltage_is_still_on(stage: Stage) -> None:
    live(stage)
    bar = stage.window.bar
    stage.press(Qt.Key.Key_F8)
    assert stage.session.pauses == 1
    assert bar.pause.text() == "PAUSING"
    stage.press(Qt.Key.Key_F8)
    assert stage.session.pauses == 1, "once asked is enough"
    stage.happen(Paused("the card sees 2.500 V"))
    assert bar.state.words == "PAUSED"
    assert (bar.volts.words, bar.volts.note) == ("0 V", "rest measured, high voltage still on")
    QTest.mouseClick(bar.pause, Qt.MouseButton.LeftButton)
    assert stage.session.resumes == 1
    stage.happen(Resumed(), EntryBegan(3, "160 Hz", (160.0,)), Playing(Sine(160.0, 2.5, 2.5, 1000)))
    assert bar.state.words == "LIVE"
    assert bar.pause.text().startswith("PAUSE")


def test_a_pause_of_a_run_without_high_voltage_does_not_say_that_it_is_on(stage: Stage) -> None:
    stage.happen(OPENED, STARTED, Armed(False))
    stage.happen(Paused("the card sees 2.500 V", False))
    bar = stage.window.bar
    assert (bar.state.words, bar.volts.note) == ("HV OFF", "paused; rest measured, high voltage off")
    assert "Paused, high voltage off: the card sees 2.500 V" in stage.window.measure.log.toPlainText()


def test_while_hands_are_on_the_specimen_the_sign_says_that_high_voltage_is_off(stage: Stage) -> None:
    live(stage)
    bar = stage.window.bar
    stage.happen(Asked(11, DISABLE_HIGH_VOLTAGE))
    assert bar.state.words == "LIVE", "asked is not done"
    stage.happen(Answered(11, "done"))
    assert bar.state.words == "HV OFF"
    assert (bar.volts.words, bar.volts.note) == ("0 V", "rest measured, high voltage off")
    stage.happen(Asked(12, WEIGHT), Answered(12, "done"))
    assert bar.state.words == "HV OFF"
    stage.happen(Asked(13, ENABLE_HIGH_VOLTAGE))
    assert bar.state.words == "LIVE", "whoever is asked switches before answering"


def test_a_run_without_high_voltage_never_says_live(stage: Stage) -> None:
    stage.happen(OPENED, RunStarted("sine-dwell", "x.h5", 9.0, 3, True), Armed(high_voltage=False))
    assert stage.window.bar.state.words == "HV OFF"


@pytest.mark.parametrize(
    ("key", "words"), [(Qt.Key.Key_Return, "done"), (Qt.Key.Key_R, "repeat the last"), (Qt.Key.Key_S, "skip")]
)
def test_every_answer_of_a_prompt_has_its_key(stage: Stage, key: Qt.Key, words: str) -> None:
    live(stage)
    stage.window.link.mailbox.show(21, WEIGHT)
    stage.happen(Asked(21, WEIGHT))
    prompt = stage.window.notices.prompt
    assert [b.text() for b in prompt.buttons] == ["Done   (Enter)", "Repeat the last   (R)", "Skip   (S)"]
    assert prompt.drawing.isVisible()
    until(lambda: stage.window.notices.patient, "for the guard")
    stage.press(key)
    assert stage.window.link.mailbox.answer(21) == words


def test_chosen_points_are_measured_again(stage: Stage, tmp_path: Path) -> None:
    live(stage)
    stage.happen(*(point(i, 100.0 + 10 * i) for i in range(3)))
    plot = stage.window.measure.response
    plot.chosen.toggle((0, 1, 2), [plot.scatters[0].points()[1]])
    assert plot.again.isVisible()
    assert not plot.again.isEnabled()
    stage.happen(AT_REST, RunEnded(Status.COMPLETED, "done", "run.h5"))
    assert plot.again.isEnabled()
    plot.again.click()
    assert stage.session.again == [(Path("run.h5"), (1,), tmp_path)]
    assert stage.window.bar.task.words == "Sine dwell · reading run.h5"
    assert len(plot.scatters[0].points()) == 3, "until the new run has begun the old one is seen"
    stage.press(Qt.Key.Key_F5)
    assert len(stage.session.runs) == 1, "nothing else begins meanwhile"
    stage.happen(Refused("run.h5 is damaged inside; take another copy of it"))
    assert "another copy" in stage.window.notices.trouble.words.text()
    assert len(plot.scatters[0].points()) == 3
    plot.chosen.toggle((0, 1, 2), [plot.scatters[0].points()[2]])
    plot.again.click()
    assert stage.session.again[1:] == [(Path("run.h5"), (2,), tmp_path)], "it can be tried once more"
    stage.happen(STARTED)
    assert len(plot.scatters[0].points()) == 0


def test_a_point_measured_again_takes_the_place_of_the_old_one(stage: Stage) -> None:
    live(stage)
    first = point(0, 100.0)
    stage.happen(first, PointMeasured(1, first.point, 0, replaces=0))
    flags = [Quality(p.quality) for p in stage.window.view.points]
    assert [Quality.SUPERSEDED in flag for flag in flags] == [True, False]
    assert stage.window.view.unusable == 0


def test_points_of_any_protocol_are_drawn_over_its_axes(stage: Stage) -> None:
    stage.happen(OPENED, RunStarted("wiring-check", "run.h5", 6.0, 4, True), PointMeasured(0, POINT))
    plot = stage.window.measure.points
    assert stage.window.measure.plots.currentWidget() is plot
    (x,), (y,) = plot.scatter.getData()
    assert (x, y) == pytest.approx((2.6, 14.0))


@pytest.mark.parametrize("at", [1, 2])
def test_residual_and_phase_are_there_on_request(stage: Stage, at: int) -> None:
    live(stage)
    stage.happen(point(0, 100.0))
    response = stage.window.measure.response
    assert not response.strip.isVisible()
    response.below.setCurrentIndex(at)
    assert response.strip.isVisible()
    until(lambda: stage.window.overlay.ready() is not None, "for the model")
    stage.window.tick()
    (x,), (y,) = response.strip.scatter.getData()
    assert x == 100.0
    curve = stage.window.overlay.ready()
    assert curve is not None
    model = np.interp(100.0, curve.frequency_hz, curve.peak_to_peak)
    assert y == pytest.approx(100 * (9e-4 / model - 1) if at == 1 else 0.0)


def test_what_the_form_said_comes_back(stage: Stage) -> None:
    stage.happen(OPENED)
    measure = stage.window.measure
    panel = measure.panel
    measure.enter()
    panel.form.rows["peak_to_peak_v"].set("4 V")
    until(lambda: not measure.history._settled.isActive())
    panel.form.rows["peak_to_peak_v"].set("3 V")
    until(lambda: not measure.history._settled.isActive())
    panel.fill(SineDwell(peak_to_peak_v=2.0, record_s=1.0, min_cycles=30))
    until(lambda: not measure.history._settled.isActive())
    panel.choice.setCurrentIndex(panel.choice.findData("wiring-check"))
    until(lambda: not measure.history._settled.isActive())
    for said in (
        SineDwell(peak_to_peak_v=2.0, record_s=1.0, min_cycles=30),
        SineDwell(peak_to_peak_v=3.0),
        SineDwell(),
        SineDwell(),
    ):
        stage.press(Qt.Key.Key_Z, CTRL)
        assert panel.protocol == said
    for said in (
        SineDwell(peak_to_peak_v=3.0),
        SineDwell(peak_to_peak_v=2.0, record_s=1.0, min_cycles=30),
        WiringCheck(),
    ):
        stage.press(Qt.Key.Key_Y, CTRL)
        assert panel.protocol == said
    stage.window.run()
    stage.press(Qt.Key.Key_Z, CTRL)
    assert panel.protocol == WiringCheck(), "what is being run stands still"
