"""Measure page with any protocol: selection, presets, pause, prompts with answers, measuring points again."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QFileDialog, QPlainTextEdit

from app.gui.measure.presets import PresetError, PresetStore, presets_path
from app.gui.plots.response import COMING, LOWER
from app.session import BenchState
from app.session.session import RunRejected
from drivers.drive_shapes import Sine
from protocols.base import (
    DISABLE_HIGH_VOLTAGE,
    ENABLE_HIGH_VOLTAGE,
    BenchArmed,
    DriveStarted,
    EntryStarted,
    EstimatedQuantity,
    PointMeasured,
    Prompt,
    PromptAnswered,
    PromptShown,
    Quality,
    RunEnded,
    RunPaused,
    RunResumed,
    RunStarted,
    RunStatus,
)
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.wiring_check import WiringCheck
from tests.app.gui.test_other_protocols import POINT
from tests.helpers.main_window import Stage, find, sign, until
from tests.helpers.session_events import AT_REST, LIVE, OPENED, SEEN_AT_REST, STARTED, STOPPED, point

CTRL = Qt.KeyboardModifier.ControlModifier
WEIGHT = Prompt("place-weight", "Put 50 g on", {"mass_kg": 0.05}, ("done", "repeat the last", "skip"), hands_on=True)


@pytest.fixture(autouse=True)
def own_presets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


def live(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE)


@pytest.mark.deep
def test_another_protocol_brings_its_form_and_keeps_what_the_last_one_said(stage: Stage, tmp_path: Path) -> None:
    stage.happen(OPENED)
    panel = stage.window.measure_page.run_panel
    panel.form.rows["peak_to_peak_v"].set_value("4 V")
    find(panel, "measure.protocol").setCurrentIndex(find(panel, "measure.protocol").findData("wiring-check"))
    assert panel.kind is WiringCheck
    assert "level_v" in panel.form.rows
    assert stage.window.measure_page.live_pane.plots.chart.picture.title == WiringCheck.title
    stage.press(Qt.Key.Key_F5)
    assert stage.session.runs == [(WiringCheck(), tmp_path, "T7")]
    stage.happen(*LIVE[:0], RunEnded(RunStatus.STOPPED, "x", "run.h5"))
    find(panel, "measure.protocol").setCurrentIndex(find(panel, "measure.protocol").findData("sine-dwell"))
    assert panel.protocol == SineDwell(peak_to_peak_v=4.0)
    assert stage.window.measure_page.live_pane.plots.chart.picture.title == "Response"


@pytest.mark.deep
def test_presets_are_kept_taken_and_forgotten(stage: Stage) -> None:
    stage.happen(OPENED)
    panel = stage.window.measure_page.run_panel
    panel.form.rows["record_s"].set_value("2")
    button = find(panel, "measure.presets")
    actions(button)
    field = find(button.menu(), "measure.preset-name")
    QTest.keyClicks(field, "slow")
    QTest.keyClick(field, Qt.Key.Key_Return)
    panel.form.rows["record_s"].set_value("9")
    actions(find(panel, "measure.presets"))["slow"].trigger()
    assert panel.protocol == SineDwell(record_s=2.0)
    actions(find(panel, "measure.presets"))["The paper's"].trigger()
    assert panel.protocol == SineDwell()
    assert list(json.loads(presets_path().read_text("utf-8"))["sine-dwell"]) == ["slow"]
    actions(find(panel, "measure.presets"))["These, 3 Hz off the mains"].trigger()
    assert panel.protocol == SineDwell(mains_shift_hz=3.0)
    actions(find(panel, "measure.presets"))["Forget"].menu().actions()[0].trigger()
    assert "slow" not in actions(find(panel, "measure.presets"))


def actions(button: Any) -> dict[str, Any]:
    button.menu().aboutToShow.emit()
    return {action.text(): action for action in button.menu().actions()}


def test_neither_a_folder_nor_a_fault_of_a_preset_takes_the_stop_key(stage: Stage, tmp_path: Path) -> None:
    panel = stage.window.measure_page.run_panel
    find(panel, "measure.browse").click()
    (dialog,) = panel.findChildren(QFileDialog)
    assert not dialog.isModal()
    dialog.filesSelected.emit([str(tmp_path / "other")])
    dialog.close()
    assert panel.folder == tmp_path / "other"
    presets_path().parent.mkdir(parents=True, exist_ok=True)
    presets_path().write_text('{"sine-dwell": {"wild": {"record_s": -1}}}')
    actions(find(panel, "measure.presets"))["wild"].trigger()
    assert QApplication.activeModalWidget() is None
    assert "'wild' does not fit: record_s" in find(stage.window, "status.event").text()


def test_presets_that_do_not_fit_are_a_sentence(tmp_path: Path) -> None:
    presets = PresetStore(tmp_path / "presets.json")
    assert presets.names("sine-dwell") == []
    presets.path.write_text('{"sine-dwell": {"wild": {"record_s": -1}}}')
    with pytest.raises(PresetError, match="'wild' does not fit: record_s"):
        presets.get(SineDwell, "wild")
    with pytest.raises(PresetError, match="no preset 'tame'"):
        presets.get(SineDwell, "tame")
    presets.path.write_text("{")
    with pytest.raises(PresetError, match=re.escape(str(presets.path))):
        presets.names("sine-dwell")


def test_pause_is_one_key_and_says_that_high_voltage_is_still_on(stage: Stage) -> None:
    live(stage)
    stage.press(Qt.Key.Key_F8)
    assert stage.session.pauses == 1
    assert find(stage.window, "status.pause").text() == "Pause"
    assert sign(stage.window) == "PAUSING"
    stage.press(Qt.Key.Key_F8)
    assert stage.session.pauses == 1, "once asked is enough"
    stage.session.observation = SEEN_AT_REST
    stage.happen(RunPaused("the card sees 2.500 V"))
    assert sign(stage.window) == "PAUSED"
    assert stage.window.strip.view.measured == "0 V"
    assert stage.window.strip.view.act == "High voltage is still on"
    QTest.mouseClick(find(stage.window, "status.pause"), Qt.MouseButton.LeftButton)
    assert stage.session.resumes == 1
    stage.happen(RunResumed(), EntryStarted(3, "160 Hz", (160.0,)), DriveStarted(Sine(160.0, 2.5, 2.5, 1000)))
    assert sign(stage.window) == "LIVE"
    assert find(stage.window, "status.pause").text() == "Pause"


@pytest.mark.deep
def test_a_pause_of_a_run_without_high_voltage_does_not_say_that_it_is_on(stage: Stage) -> None:
    stage.happen(OPENED, STARTED, BenchArmed(False))
    stage.happen(RunPaused("the card sees 2.500 V", False))
    assert (sign(stage.window), stage.window.strip.view.aim) == (
        "HV OFF",
        "high voltage off, 0 V",
    )
    assert "Paused, high voltage off: the card sees 2.500 V" in stage.window.log.view.toPlainText()


def test_while_hands_are_on_the_specimen_the_sign_says_that_high_voltage_is_off(stage: Stage) -> None:
    live(stage)
    stage.happen(PromptShown(11, DISABLE_HIGH_VOLTAGE))
    assert sign(stage.window) == "LIVE", "asked is not done"
    stage.session.observation = SEEN_AT_REST
    stage.happen(PromptAnswered(11, "done"))
    assert sign(stage.window) == "HV OFF"
    assert (stage.window.strip.view.measured, stage.window.strip.view.aim) == ("0 V", "high voltage off, 0 V")
    stage.happen(PromptShown(12, WEIGHT), PromptAnswered(12, "done"))
    assert sign(stage.window) == "HV OFF"
    stage.happen(PromptShown(13, ENABLE_HIGH_VOLTAGE))
    assert sign(stage.window) == "LIVE", "whoever is asked switches before answering"


def test_a_run_without_high_voltage_never_says_live(stage: Stage) -> None:
    stage.happen(OPENED, RunStarted("sine-dwell", "x.h5", 9.0, 3, True), BenchArmed(high_voltage=False))
    assert sign(stage.window) == "HV OFF"


@pytest.mark.parametrize(
    ("key", "message"),
    [
        (Qt.Key.Key_R, "repeat the last"),
        pytest.param(Qt.Key.Key_Return, "done", marks=pytest.mark.deep),
        pytest.param(Qt.Key.Key_S, "skip", marks=pytest.mark.deep),
    ],
)
def test_every_answer_of_a_prompt_has_its_key(stage: Stage, key: Qt.Key, message: str) -> None:
    live(stage)
    stage.window.adapter.mailbox.show(21, WEIGHT)
    stage.happen(PromptShown(21, WEIGHT))
    prompt = stage.window.notices.prompt
    assert [(b.text(), b.property("cap")) for b in prompt.buttons] == [
        ("Done", "Enter"),
        ("Repeat the last", "R"),
        ("Skip", "S"),
    ]
    assert prompt.drawing.isVisible()
    assert prompt.laser_note.text() == "laser now; moves by about 68 µm"  # 0.05 kg × 9.807 m/s² × 138 µm/N
    until(lambda: stage.window.notices.prompt.accepts_input, "for the guard")
    stage.press(key)
    assert stage.window.adapter.mailbox.answer(21) == message


def test_chosen_points_are_measured_again(stage: Stage, tmp_path: Path) -> None:
    live(stage)
    stage.happen(*(point(i, 100.0 + 10 * i) for i in range(3)))
    plot = stage.window.measure_page.live_pane.plots

    def drawn() -> int:
        layer = plot.chart.layer("max − min, measured")
        return 0 if layer is None else layer.x.size

    plot.chart.point_picked.emit("max − min, measured", 1)
    assert plot.repeat_button.isVisible()
    assert not plot.repeat_button.isEnabled()
    stage.happen(AT_REST, RunEnded(RunStatus.COMPLETED, "done", "run.h5"))
    assert plot.repeat_button.isEnabled()
    plot.repeat_button.click()
    assert stage.session.again == [(Path("run.h5"), (1,), tmp_path)]
    assert stage.window.strip.view.run.title == "Sine dwell · reading run.h5"
    assert drawn() == 3, "until the new run has begun the old one is seen"
    stage.press(Qt.Key.Key_F5)
    assert len(stage.session.runs) == 1, "nothing else begins meanwhile"
    why = "run.h5 is damaged inside; take another copy of it"
    stage.happen(RunRejected(why))
    assert find(stage.window, "notices.problem.message").text().casefold() == why.casefold()
    assert drawn() == 3
    plot.chart.point_picked.emit("max − min, measured", 2)
    plot.repeat_button.click()
    assert stage.session.again[1:] == [(Path("run.h5"), (2,), tmp_path)], "it can be tried once more"
    stage.happen(STARTED)
    assert drawn() == 0


@pytest.mark.deep
def test_a_point_measured_again_takes_the_place_of_the_old_one(stage: Stage) -> None:
    live(stage)
    first = point(0, 100.0)
    stage.happen(first, PointMeasured(1, first.point, 0, replaces=0))
    flags = [Quality(p.quality) for p in stage.window.state.points]
    assert [Quality.SUPERSEDED in flag for flag in flags] == [True, False]
    assert stage.window.state.unusable == 0


@pytest.mark.deep
def test_points_of_any_protocol_are_drawn_over_its_axes(stage: Stage) -> None:
    stage.happen(OPENED, RunStarted("wiring-check", "run.h5", 6.0, 4, True), PointMeasured(0, POINT))
    plots = stage.window.measure_page.live_pane.plots
    layer = plots.chart.layer(plots.kind.title)
    assert layer is not None
    assert (*layer.x, *layer.y) == pytest.approx((2.6, 14.0))


@pytest.mark.parametrize("at", [1, pytest.param(2, marks=pytest.mark.deep)])
def test_residual_and_phase_are_there_on_request(stage: Stage, at: int) -> None:
    live(stage)
    stage.happen(point(0, 100.0))
    plots = stage.window.measure_page.live_pane.plots
    plots.resize(900, 400)
    assert len(plots.chart.panels) == 1
    plots.choose_lower(LOWER[at])
    assert len(plots.chart.panels) == 2
    until(lambda: stage.window.overlay.result() is not None, "for the model")
    stage.window.tick()
    layer = plots.chart.layer(LOWER[at])
    assert layer is not None
    (x,), (y,) = layer.x, layer.y
    assert x == 100.0
    curve = stage.window.overlay.result()
    assert curve is not None
    model = np.interp(100.0, curve.free["peak_to_peak"].x, curve.free["peak_to_peak"].y)
    assert y == pytest.approx(100 * (9e-4 / model - 1) if at == 1 else 0.0)


def test_what_the_form_said_comes_back(stage: Stage) -> None:
    stage.happen(OPENED)
    measure = stage.window.measure_page
    panel = measure.run_panel
    measure.activate()
    panel.form.rows["peak_to_peak_v"].set_value("4 V")
    until(lambda: not measure.history._settle_timer.isActive())
    panel.form.rows["peak_to_peak_v"].set_value("3 V")
    until(lambda: not measure.history._settle_timer.isActive())
    panel.set_protocol(SineDwell(peak_to_peak_v=2.0, record_s=1.0, min_cycles=30))
    until(lambda: not measure.history._settle_timer.isActive())
    find(panel, "measure.protocol").setCurrentIndex(find(panel, "measure.protocol").findData("wiring-check"))
    until(lambda: not measure.history._settle_timer.isActive())
    for text in (
        SineDwell(peak_to_peak_v=2.0, record_s=1.0, min_cycles=30),
        SineDwell(peak_to_peak_v=3.0),
        SineDwell(),
        SineDwell(),
    ):
        stage.press(Qt.Key.Key_Z, CTRL)
        assert panel.protocol == text
    for text in (
        SineDwell(peak_to_peak_v=3.0),
        SineDwell(peak_to_peak_v=2.0, record_s=1.0, min_cycles=30),
        WiringCheck(),
    ):
        stage.press(Qt.Key.Key_Y, CTRL)
        assert panel.protocol == text
    stage.window.start_run()
    stage.press(Qt.Key.Key_Z, CTRL)
    assert panel.protocol == WiringCheck(), "what is being run stands still"


def test_the_plot_marks_the_points_that_are_to_come(stage: Stage) -> None:
    live(stage)
    chart = stage.window.measure_page.live_pane.plots.chart

    def coming() -> list[float]:
        marks = chart.layer(COMING)
        return [] if marks is None else list(marks.x)

    every = list(SineDwell().frequencies_hz)
    present = stage.window.state.drive.frequency_hz
    assert coming() == [hz for hz in every if hz != present]
    stage.happen(point(0, every[0]), DriveStarted(Sine(every[1], 2.5, 2.5, 1000)))
    assert coming() == every[2:]
    stage.happen(AT_REST, RunEnded(RunStatus.COMPLETED, "done", "run.h5"))
    assert coming() == []


@pytest.mark.deep
def test_the_result_stands_beside_the_plot_of_a_wide_window_and_under_a_switch_in_a_narrow_one(stage: Stage) -> None:
    window, panel = stage.window, stage.window.measure_page.run_panel
    window.look.set_text_size("100")
    card, protocol, segments = panel.result_card, find(panel, "measure.protocol"), panel.segments
    stage.happen(OPENED)
    window.resize(1280, 800)
    assert not segments.buttons["result"].isEnabled(), "there is no result"
    live(stage)
    assert (card.isVisible(), protocol.isVisible()) == (True, False), "a run turns to its result"
    assert segments.buttons["result"].text() == "Result so far"
    stage.happen(*(point(at, hz) for at, hz in enumerate((100.0, 150.0, 200.0))))
    found = tuple(EstimatedQuantity(f"quantity {at}", 1.0 + at, 0.01, "Hz", "fit") for at in range(12))
    hints = ("the peak lies near the edge of the band; widen it before more is measured",) * 3
    stage.happen(AT_REST, RunEnded(RunStatus.COMPLETED, "all points measured", "run.h5", found, hints=hints))
    for width, height in ((900, 560), (1280, 800), (1920, 1080)):
        window.resize(width, height)
        until(lambda: card.visibleRegion().boundingRect() == card.rect(), "for the whole card")
        assert find(card, "result.figure").font().pixelSize() == 40
        assert find(card, "result.again").isVisible()
        assert find(panel, "measure.run").isVisible()
        beside = width >= 1600
        assert protocol.isVisible() is beside
        assert segments.isVisible() is not beside
        left = card.mapTo(window, card.rect().topLeft()).x()
        plots = window.measure_page.live_pane
        assert (left >= plots.mapTo(window, plots.rect().topRight()).x()) is beside
    window.resize(1280, 800)
    segments.buttons["set-up"].click()
    assert (card.isVisible(), protocol.isVisible()) == (False, True)


def test_a_list_that_fits_has_no_scroll_bar(stage: Stage) -> None:
    editor = stage.window.measure_page.run_panel.form.rows["frequencies_hz"].editor
    assert isinstance(editor, QPlainTextEdit)
    for count in (6, 18):
        editor.setPlainText(", ".join(str(100 + at) for at in range(count)))
        assert editor.verticalScrollBar().maximum() == 0, count
    editor.setPlainText(", ".join(str(100 + at) for at in range(99)))
    assert editor.verticalScrollBar().maximum() > 0


def test_a_fault_in_a_folded_field_is_named_and_moves_nothing(stage: Stage) -> None:
    stage.happen(OPENED)
    form = stage.window.measure_page.run_panel.form
    *_, folded = form.rows.values()
    form.rows["frequencies_hz"].editor.setFocus()
    folded.set_value("abc")
    assert not form.more_button.isChecked()
    assert not folded.note_label.isVisible()
    assert form.more_button.text().endswith(f"correct {folded.field.label}")
    form.more_button.click()
    assert folded.note_label.isVisible(), "unfolded, the fault stands below its field"


def test_a_run_gives_the_keyboard_back_to_the_field_that_had_it(stage: Stage) -> None:
    stage.happen(OPENED)
    page = stage.window.measure_page
    editor = page.run_panel.form.rows["peak_to_peak_v"].editor
    editor.setFocus()
    stage.press(Qt.Key.Key_F5)
    assert stage.window.focusWidget() is page, "no control has it by chance"
    stage.happen(*LIVE)
    assert stage.window.focusWidget() is page
    stage.happen(AT_REST, RunEnded(RunStatus.COMPLETED, "", "run.h5"))
    assert stage.window.focusWidget() is editor


def test_the_mark_of_the_present_frequency_ends_with_the_drive(stage: Stage) -> None:
    def marks() -> list[str]:
        return [spot.label for spot in stage.window.measure_page.live_pane.plots.chart.picture.spots]

    stage.happen(OPENED, *LIVE)
    assert marks() == ["160 Hz, measuring"]
    stage.happen(STOPPED[0])
    assert stage.window.state.bench_state is BenchState.GOING_TO_REST
    assert marks() == []
