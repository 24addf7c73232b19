"""Main window: displays session events and forwards operator commands to the session."""

import itertools
import math
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from PySide6.QtCore import QCoreApplication, QPoint, QRect, QSettings, QSize, Qt
from PySide6.QtGui import QColor
from PySide6.QtTest import QTest

from app.gui.face import DARK, LIGHT, install_fonts, tokens
from app.gui.shell.main_window import MainWindow
from app.gui.status import notices
from app.gui.status.bench_strip import BenchStrip
from app.gui.status.prompt_card import INPUT_GUARD_S
from app.session.session import BenchFailed, Observation, RunRejected
from app.session.state import BenchState
from drivers.bench.card_reading import CardReading
from model import quantity_label
from protocols.base import (
    DISABLE_HIGH_VOLTAGE,
    ENABLE_HIGH_VOLTAGE,
    BlockStored,
    EstimatedQuantity,
    ProgressUpdated,
    PromptAnswered,
    PromptShown,
    Quality,
    RunEnded,
    RunStatus,
    SpecimenMayBeLive,
    StreamStarted,
)
from protocols.measurements.free_decay import FreeDecay
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.main_window import OpenStage, Stage, find, grab, sign, until, word
from tests.helpers.messages import assert_names
from tests.helpers.session_events import AT_REST, LIVE, LOST, OPENED, STARTED, STOPPED, point, sine_block
from tests.protocols.test_rehearsal import guard


def prompted(stage: Stage) -> None:
    """The runner asks this window."""
    stage.happen(OPENED)
    stage.window.start_run()
    stage.window.adapter.mailbox.show(2, ENABLE_HIGH_VOLTAGE)
    stage.happen(STARTED, PromptShown(2, ENABLE_HIGH_VOLTAGE))


def wait_past_the_guard() -> None:
    begin = time.monotonic()
    until(lambda: time.monotonic() - begin > INPUT_GUARD_S)


def test_the_bar_names_the_bench_its_instruments_and_that_it_is_simulated(stage: Stage) -> None:
    assert sign(stage.window) == "CONNECT"
    assert find(stage.window, "measure.run").isEnabled()  # it begins when the bench is connected
    stage.happen(OPENED)
    assert sign(stage.window) == BenchState.IDLE.upper()
    assert next(lamp.instrument.identity for lamp in stage.window.status_line.lamps) == "Keysight 33511B #1"
    assert stage.window.ribbon.accessibleName().startswith("SIMULATED")
    assert stage.window.ribbon.isVisible()
    assert find(stage.window, "measure.run").isEnabled()


def test_every_exported_picture_of_simulated_data_says_so_and_the_plots_in_the_window_do_not(stage: Stage) -> None:
    stage.happen(OPENED)
    pane = stage.window.measure_page.live_pane
    for chart in (pane.plots.chart, pane.time_plot):
        violet = QColor(tokens().violet)
        shown, picture = chart.canvas.viewport().grab().toImage(), chart.tools.files.picture().toImage()
        assert picture.pixelColor(picture.width() - 16, 2) == violet
        assert shown.pixelColor(shown.width() - 16, 2) != violet
        assert chart.table().startswith("SIMULATED")


@pytest.mark.one_in(100)
@pytest.mark.parametrize(
    ("key", "modifier"),
    [(Qt.Key.Key_F5, Qt.KeyboardModifier.NoModifier), (Qt.Key.Key_R, Qt.KeyboardModifier.ControlModifier)],
)
def test_one_key_runs_what_the_form_says(
    stage: Stage, tmp_path: Path, key: Qt.Key, modifier: Qt.KeyboardModifier
) -> None:
    stage.happen(OPENED)
    stage.window.measure_page.run_panel.form.rows["peak_to_peak_v"].set_value("4000 mV")
    stage.press(key, modifier)
    assert stage.session.runs == [(SineDwell(peak_to_peak_v=4.0), tmp_path, "T7")]
    assert stage.window.state.busy
    stage.press(key, modifier)
    assert len(stage.session.runs) == 1


def test_a_fault_in_the_form_is_told_beside_the_field_and_keeps_run_away(stage: Stage) -> None:
    stage.happen(OPENED)
    panel = stage.window.measure_page.run_panel
    editor = panel.form.rows["peak_to_peak_v"].editor
    editor.selectAll()
    QTest.keyClicks(editor, "6 V")
    assert "6 V is outside the range" in panel.form.rows["peak_to_peak_v"].note_label.text()
    assert not find(panel, "measure.run").isEnabled()
    stage.press(Qt.Key.Key_F5)
    assert stage.session.runs == []
    find(panel, "measure.presets").menu().aboutToShow.emit()
    find(panel, "measure.presets").menu().actions()[0].trigger()
    assert find(panel, "measure.run").isEnabled()


def test_live_tells_volts_task_and_time_left(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.session.observation = Observation(CardReading((0.0, 5.0), (0.0, 5.0), time.monotonic() + 3600))
    stage.happen(*LIVE, ProgressUpdated(7, 18, 15.0, "160 Hz"))
    view = stage.window.strip.view
    assert sign(stage.window) == "LIVE"
    assert (view.measured, view.caption) == ("−500 … +1500 V", "at the specimen, 0.1 s ago")
    assert view.aim == "sine, 160 Hz, −500 … +1500 V"
    assert "160 Hz" in view.run.title
    assert_names(view.run.note, 7, 18)
    assert "15 s left" in view.run.note
    for drive_v, volts in (((0.0, 2.5), "−500 … 0 V"), ((2.5, 2.5), "0 V"), ((2.5, 5.0), "0 … +1500 V")):
        stage.session.observation = Observation(CardReading(drive_v, drive_v, time.monotonic() + 3600))
        stage.window.tick()
        assert stage.window.strip.view.measured == volts, "other volts wait for no interval"


def test_the_time_left_stays_real_when_the_state_changes(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.session.bench = SimpleNamespace(configuration={"speed": 20.0})
    stage.happen(*LIVE, ProgressUpdated(7, 18, 300.0, "160 Hz"))
    assert "15 s left" in stage.window.strip.view.run.note
    stage.window.controller.toggle_pause()
    assert sign(stage.window) == "PAUSING"
    assert "15 s left" in stage.window.strip.view.run.note


def test_a_run_that_is_asked_for_while_the_bench_is_connected_begins_then(stage: Stage) -> None:
    stage.press(Qt.Key.Key_F5)
    assert stage.session.runs == []
    assert_names(stage.window.strip.view.run.note, "begins", "connected")
    assert not find(stage.window, "measure.run").isEnabled()
    stage.happen(OPENED)
    assert len(stage.session.runs) == 1
    assert stage.window.state.busy


def test_stop_and_a_bench_that_is_not_there_drop_the_run_that_waits(stage: Stage) -> None:
    stage.press(Qt.Key.Key_F5)
    stage.press(Qt.Key.Key_F12)
    stage.happen(OPENED)
    assert stage.session.runs == []
    stage.window.controller.reconnect()
    stage.window.tick()
    stage.press(Qt.Key.Key_F5)
    stage.happen(BenchFailed("no generator"))
    stage.happen(OPENED)
    assert stage.session.runs == []


@pytest.mark.parametrize("key", [Qt.Key.Key_Escape, Qt.Key.Key_F12])
def test_stop_is_one_key_and_is_shown_at_once(stage: Stage, key: Qt.Key) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE)
    stage.press(key)
    assert stage.session.stops == 1
    assert sign(stage.window) == word(BenchState.GOING_TO_REST)


def test_stop_is_answered_before_the_samples_that_wait_are_drawn(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.session.bench = _Sensing(stage)
    stage.window.start_run()
    stage.happen(*LIVE, StreamStarted(500_000.0, stage.session.bench.scales))
    blocks = [BlockStored(sine_block(25_000 * i, 25_000, 500_000.0), 25_000 * i) for i in range(4)]
    for i in range(40):
        stage.window.adapter.observe(blocks[i % 4])
        stage.window.tick()
    drawn = stage.window.measure_page.live_pane.time_plot.frames
    assert drawn > 0
    for i in range(40):
        stage.window.adapter.observe(blocks[i % 4])
    QTest.mouseClick(find(stage.window, "status.stop"), Qt.MouseButton.LeftButton)
    stage.window.strip.repaint()
    assert stage.session.stops == 1
    assert sign(stage.window) == word(BenchState.GOING_TO_REST)
    assert stage.window.measure_page.live_pane.time_plot.frames == drawn
    stage.window.tick()
    assert stage.window.measure_page.live_pane.time_plot.frames == drawn + 1  # they were waiting


def test_points_arrive_and_unusable_ones_are_hollow_with_their_reason(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), point(1, 150.0, Quality.UNSETTLED))
    chart = stage.window.measure_page.live_pane.plots.chart
    measured, twice = chart.layer("max − min, measured"), chart.layer("2 × fundamental, measured")
    assert measured is not None
    assert twice is not None
    assert measured.x.tolist() == [100.0, 150.0]
    assert measured.y[0] == pytest.approx(900.0)
    drawn = chart.panels[0].drawn_layer("max − min, measured")
    paper = tokens().surface
    assert [spot.brush().color().name() == paper for spot in drawn.scatter.points()] == [False, True]
    assert "unsettled" in measured.texts[1]
    assert twice.y[0] == pytest.approx(864.0)


@pytest.mark.deep
def test_what_was_identified_stands_above_the_points(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    found = EstimatedQuantity("natural_frequency", 158.35, 0.0072, "Hz", "this run")
    stage.happen(*LIVE, AT_REST, RunEnded(RunStatus.COMPLETED, "all points measured", "run.h5", (found,)))
    (rule,) = [r for r in stage.window.measure_page.live_pane.plots.chart.picture.rules if r.marked]
    assert rule.at == 158.35
    assert rule.label == f"{quantity_label(found.name).capitalize()} 158.3 Hz"


@pytest.mark.deep
def test_each_amplitude_can_be_hidden(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), point(1, 150.0))
    chart = stage.window.measure_page.live_pane.plots.chart
    chart.chips["2 × fundamental"].click()
    shown = [layer.name for layer in chart.panels[0].layers]
    assert "max − min, measured" in shown
    assert "2 × fundamental, measured" not in shown


@pytest.mark.deep
def test_what_is_typed_for_the_next_run_changes_nothing_of_the_finished_one(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), *STOPPED)
    until(lambda: stage.window.overlay.result() is not None)
    stage.window.tick()
    chart = stage.window.measure_page.live_pane.plots.chart
    before = {layer.name: layer for layer in chart.picture.layers}
    stage.window.measure_page.run_panel.form.rows["peak_to_peak_v"].set_value(2.0)
    until(lambda: len(chart.picture.layers) > len(before), "for the preview")
    after = {layer.name: layer for layer in chart.picture.layers}
    (preview,) = after.keys() - before.keys()
    assert after[preview].label == "next, 2 V"
    for name, layer in before.items():
        np.testing.assert_array_equal(after[name].y, layer.y)
    stage.happen(*LIVE)
    assert not chart.picture.layers or all(layer.label != "next, 2 V" for layer in chart.picture.layers)


def test_the_model_curve_comes_without_being_waited_for(stage: Stage) -> None:
    until(lambda: stage.window.overlay.result() is not None)
    stage.window.tick()
    curve = stage.window.overlay.result()
    assert curve is not None
    assert curve.request.amplitude_v == 2.5


def test_a_prompt_is_answered_by_enter_once_it_could_be_read(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    guard = "app.gui.status.prompt_card.INPUT_GUARD_S"
    monkeypatch.setattr(guard, float("inf"))  # however slow this computer is
    prompted(stage)
    assert find(stage.window, "notices.prompt").isVisible()
    assert find(stage.window, "notices.prompt.detail").text() == ENABLE_HIGH_VOLTAGE.text
    assert sign(stage.window) == "LIVE"
    stage.press(Qt.Key.Key_Return)
    assert stage.window.adapter.mailbox.answer(2) is None, "an Enter meant for something else"
    monkeypatch.setattr(guard, 0.0)
    stage.press(Qt.Key.Key_Return)
    assert stage.window.adapter.mailbox.answer(2) == "done"
    stage.happen(PromptAnswered(2, "done"))
    assert not stage.window.central.opened


@pytest.mark.deep
def test_a_prompt_that_follows_at_once_is_answered_by_enter_too(stage: Stage) -> None:
    prompted(stage)
    stage.window.adapter.mailbox.show(3, DISABLE_HIGH_VOLTAGE)
    stage.happen(PromptAnswered(2, "done"), PromptShown(3, DISABLE_HIGH_VOLTAGE))
    assert find(stage.window, "notices.prompt.detail").text() == DISABLE_HIGH_VOLTAGE.text
    wait_past_the_guard()
    stage.press(Qt.Key.Key_Return)
    assert stage.window.adapter.mailbox.answer(3) == "done"


def test_a_prompt_names_its_point_and_what_comes_next_from_the_first_entry_on(stage: Stage) -> None:
    prompted(stage)
    assert [find(stage.window, f"prompt.{part}").text() for part in ("note", "then")] == ["", ""]
    stage.window.adapter.mailbox.show(3, DISABLE_HIGH_VOLTAGE)
    progress = ProgressUpdated(6, 100, 900.0, "MFC up, 200 g, repeat 2", "MFC up, 50 g, repeat 2")
    stage.happen(PromptAnswered(2, "done"), progress, PromptShown(3, DISABLE_HIGH_VOLTAGE))
    assert find(stage.window, "prompt.note").text() == "Point 7 of 100, MFC up, 200 g, repeat 2"
    assert find(stage.window, "prompt.then").text() == "Then: MFC up, 50 g, repeat 2"


def test_a_prompt_can_be_answered_by_stop(stage: Stage) -> None:
    prompted(stage)
    QTest.mouseClick(find(stage.window, "status.stop"), Qt.MouseButton.LeftButton)
    assert stage.session.stops == 1
    assert not find(stage.window, "notices.prompt").isVisible()


@pytest.mark.deep
def test_a_prompt_for_the_simulated_operator_is_not_put_to_the_person(stage: Stage) -> None:
    stage.happen(OPENED, STARTED, PromptShown(2, ENABLE_HIGH_VOLTAGE))
    assert not find(stage.window, "notices.prompt").isVisible()


def test_unsafe_stays_until_it_is_acknowledged_and_no_run_begins_before(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[tuple[str, ...]] = []
    monkeypatch.setattr(BenchStrip, "_draw_line", lambda _strip, _painter, _area, texts, *_: drawn.append(texts))

    def next_act() -> str:
        drawn.clear()
        stage.window.strip.grab()
        return " ".join(drawn[-1])

    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, *LOST)
    assert sign(stage.window) == "UNSAFE"
    assert "Then F4" in next_act()
    assert "high voltage OFF by hand" in find(stage.window, "notices.unsafe.detail").text()
    assert find(stage.window, "notices.unsafe").isVisible()
    stage.press(Qt.Key.Key_F5)
    assert len(stage.session.runs) == 1
    stage.press(Qt.Key.Key_F4)
    assert not find(stage.window, "notices.unsafe").isVisible()
    assert sign(stage.window) == "UNSAFE", "acknowledging measures nothing"
    assert "Then F6" in next_act()
    stage.press(Qt.Key.Key_F5)
    assert len(stage.session.runs) == 2


def test_a_key_meant_for_a_problem_does_not_answer_the_unsafe_card_that_replaces_it(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(notices, "INPUT_GUARD_S", math.inf)
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, SpecimenMayBeLive(0.0, 0.0, "the specimen may be live"))
    assert find(stage.window, "notices.problem").isVisible()
    stage.happen(*LOST)
    stage.press(Qt.Key.Key_F4)
    assert find(stage.window, "notices.unsafe").isVisible()
    monkeypatch.setattr(notices, "INPUT_GUARD_S", 0.0)
    stage.press(Qt.Key.Key_F4)
    assert not find(stage.window, "notices.unsafe").isVisible()


@pytest.mark.deep
def test_why_a_run_failed_is_told_and_can_be_dismissed(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    why = "the generator was silent for 2 s"
    stage.happen(*LIVE, AT_REST, RunEnded(RunStatus.FAILED, why, "run.h5"))
    assert find(stage.window, "notices.problem.message").text().casefold() == why
    stage.press(Qt.Key.Key_F4)
    assert not stage.window.central.opened


@pytest.mark.deep
def test_a_refused_run_file_is_told_and_the_window_is_ready_again(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    why = "the folder cannot be written; choose another"
    stage.happen(RunRejected(why))
    assert find(stage.window, "notices.problem.message").text().casefold() == why.casefold()
    assert find(stage.window, "measure.run").isEnabled()


def test_a_bench_that_was_not_there_can_be_opened_again(stage: Stage) -> None:
    why = "no generator answers; switch it on"
    stage.happen(BenchFailed(why))
    assert sign(stage.window) == BenchState.NO_BENCH.upper()
    assert why in find(stage.window, "notices.problem.message").text().casefold()
    stage.press(Qt.Key.Key_F6)
    assert sign(stage.window) == "CONNECT"
    stage.window.tick()
    stage.happen(OPENED)
    assert stage.window.state.bench_state is BenchState.IDLE


@pytest.mark.deep
def test_autostart_begins_as_soon_as_the_bench_is_there(open_stage: OpenStage) -> None:
    stage = open_stage(autostart=True)
    assert stage.session.runs == []
    stage.happen(OPENED)
    stage.window.tick()
    assert len(stage.session.runs) == 1


@pytest.mark.deep
def test_what_happens_is_written_with_its_time(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), *STOPPED)
    log = stage.window.log.view.toPlainText()
    assert "simulated bench is open" in log
    assert_names(next(line for line in log.splitlines() if "100.000 Hz" in line), "900.0", "µm")
    assert STOPPED[-1].reason in log.casefold()
    assert log[2] == log[5] == ":"


@pytest.mark.deep
def test_it_comes_back_as_it_was_left(open_stage: OpenStage, settings: QSettings) -> None:
    first = open_stage()
    first.window.resize(1100, 640)
    first.window.measure_page.live_pane.setSizes([150, 150, 120])
    find(first.window, "measure.specimen").setText("T12 left")
    first.window.measure_page.live_pane.time_plot.select_span(2)
    rows = first.window.measure_page.live_pane.sizes()
    first.window.close()
    until(lambda: not first.window.isVisible())
    second = open_stage(folder=None, specimen=None)
    assert second.window.size().height() == 640
    assert second.window.measure_page.live_pane.sizes() == rows
    assert find(second.window, "measure.specimen").text() == "T12 left"
    assert second.window.measure_page.live_pane.time_plot.selected_span == 2
    assert find(second.window, "measure.folder").text() == find(first.window, "measure.folder").text()


@pytest.mark.deep
def test_the_form_says_what_it_said_unless_a_protocol_is_asked_for(open_stage: OpenStage, settings: QSettings) -> None:
    left = FreeDecay(step_v=0.25)
    first = open_stage()
    first.window.measure_page.run_panel.set_protocol(left)
    first.window.close()
    until(lambda: not first.window.isVisible())
    assert open_stage().window.measure_page.run_panel.protocol == left
    assert open_stage(protocol=SineDwell(record_s=0.7)).window.measure_page.run_panel.protocol == SineDwell(
        record_s=0.7
    )


@pytest.mark.deep
@pytest.mark.parametrize(
    "kept",
    [
        '{"protocol": "gone", "parameters": {}}',
        *(
            pytest.param(kept, marks=pytest.mark.deep)
            for kept in ("", "[]", '{"protocol": "sine-dwell", "parameters": {"record_s": -1}}')
        ),
    ],
)
def test_a_form_that_was_kept_by_another_version_is_the_papers(
    open_stage: OpenStage, settings: QSettings, kept: str
) -> None:
    settings.setValue("measure/form", kept)
    assert open_stage().window.measure_page.run_panel.protocol == SineDwell()


@pytest.mark.parametrize("size", [(1280, 720), pytest.param((2560, 1440), marks=pytest.mark.deep)])
def test_light_and_dark_can_be_told_in_the_picture(stage: Stage, tmp_path: Path, size: tuple[int, int]) -> None:
    stage.happen(OPENED)
    stage.window.resize(*size)
    brightness = []
    for theme in (LIGHT, DARK):
        stage.window.look.set_appearance("dark" if theme is DARK else "light")
        grab(stage.window, tmp_path / "window.png")
        image = stage.window.grab().toImage()
        assert image.width() == size[0]
        brightness.append(image.pixelColor(4, image.height() // 2).lightness())
    assert brightness[0] > 200
    assert brightness[1] < 60


@pytest.mark.deep
def test_pointing_at_a_point_tells_its_value_and_what_is_wrong(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 150.0, Quality.UNSETTLED))
    chart = stage.window.measure_page.live_pane.plots.chart
    canvas, scatter = chart.canvas, chart.panels[0].drawn_layer("max − min, measured").scatter
    until(lambda: stage.window.overlay.result() is not None)
    stage.window.tick()
    QCoreApplication.processEvents()
    at = canvas.mapFromScene(scatter.mapToScene(scatter.points()[0].pos()))
    steps = itertools.cycle((QPoint(0, 0), QPoint(1, 0)))  # the plot processes at most a hundred moves a second

    def told() -> bool:
        QTest.mouseMove(canvas.viewport(), at + next(steps))
        return "not usable: unsettled" in find(canvas, "plot.read-out").text()

    until(told)


class _Sensing:
    """As much of a bench as traces and rehearsal need."""

    amplifier = guard()
    configuration: ClassVar[dict[str, Any]] = {}
    meters: ClassVar[dict[str, Any]] = {}
    channels = ()

    def __init__(self, stage: Stage) -> None:
        from drivers.sensors.laser_sensor import LaserSensor
        from tests.helpers.session_events import SCALES

        self.sensor = LaserSensor("laser", 1e-4)
        self.scales = SCALES


@pytest.mark.deep
def test_a_window_that_was_large_becomes_small_again(stage: Stage) -> None:
    for size in (QSize(1280, 720), QSize(2560, 1440), QSize(1280, 720)):
        stage.window.resize(size)
        QCoreApplication.processEvents()
        assert stage.window.size() == size


@pytest.mark.one_in(100)
@pytest.mark.parametrize("state", ["idle", "live", "unsafe"])
def test_state_pause_and_stop_are_whole_in_the_smallest_window(stage: Stage, state: str) -> None:
    stage.happen(OPENED)
    if state != "idle":
        stage.window.start_run()
        stage.happen(*LIVE, *(LOST if state == "unsafe" else ()))
    for page in range(stage.window.tabs.count()):
        stage.window.tabs.setCurrentIndex(page)
        for size in (QSize(900, 540), QSize(1092, 614)):
            stage.window.resize(size)
            QCoreApplication.processEvents()
            assert stage.window.size() == size
            for name in ("strip", "status.pause", "status.stop"):
                shown = find(stage.window, name)
                assert stage.window.rect().contains(QRect(shown.mapTo(stage.window, QPoint(0, 0)), shown.size())), (
                    name,
                    size,
                )
                assert shown.visibleRegion().boundingRect().size() == shown.size(), (name, size)
                assert shown.height() >= 40


def test_an_unsafe_message_lies_over_the_page_and_moves_nothing(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE)
    QCoreApplication.processEvents()
    run_button = find(stage.window, "measure.run")
    before = run_button.mapTo(stage.window, QPoint(0, 0))
    stage.happen(*LOST)
    QCoreApplication.processEvents()
    message = find(stage.window, "notices.unsafe")
    assert message.isVisible()
    assert run_button.mapTo(stage.window, QPoint(0, 0)) == before
    centre = message.mapTo(stage.window, message.rect().center())
    assert message.isAncestorOf(stage.window.childAt(centre))


@pytest.mark.deep
def test_a_window_is_never_larger_than_its_screen(
    open_stage: OpenStage, settings: QSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A laptop's screen of 1366 x 768 has 910 x 512 points at 150 %."""
    screen = SimpleNamespace(availableSize=lambda: QSize(910, 512))
    monkeypatch.setattr(MainWindow, "screen", lambda _: screen)
    assert open_stage().window.size() == QSize(906, 480)


def test_a_first_window_is_as_large_as_its_text_needs(open_stage: OpenStage, settings: QSettings) -> None:
    settings.setValue("window/text-size", "125")
    assert open_stage().window.size() == QSize(1600, 900)
    install_fonts(100)
