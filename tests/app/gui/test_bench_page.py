"""Bench page: benches, tiles with live values, scan, editing and saving, and the bench chosen last."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from PySide6.QtCore import QCoreApplication, QSettings, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QWidget

from app.config.bench_editing import bench_files
from app.config.bench_file import BenchConfig, load_bench
from app.config.discovery import FoundDevice
from app.config.template import TEMPLATE
from app.gui import application
from app.gui.bench_page.editor import NEW_BENCH
from app.gui.shell.main_window import MainWindow
from app.gui.shell.page_host import BENCH, MEASURE
from app.gui.widgets import end_all
from app.live.commissioning_job import STOPPED, CommissioningJob
from app.live.feed import READING_BLOCKS
from app.live.session_link import SessionAdapter
from app.session import commissioning, commissioning_record, connect
from app.session.state import BenchState, InstrumentStatus, Lamp
from drivers import WallClock
from drivers.evidence.assumption import OutputCheck
from protocols.base import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE
from protocols.commissioning.sequence import Commissioned
from protocols.commissioning.verdict import CheckedOutput, MeasuredTimes, OutputVerdict
from protocols.measurements.sine_dwell import SineDwell
from sim_hardware.bench import SimulatedBench
from sim_hardware.operator import SimulatedOperator
from sim_hardware.service.served_bench import ServedBench
from tests.app.test_bench_editing import comment_of
from tests.helpers.double_faults import INTERLOCK
from tests.helpers.main_window import Bench, ListeningSession, OpenStage, find, press, sign, until, whole_window, word
from tests.helpers.simulated_bench import simulated

pytestmark = pytest.mark.deep

FOUND = [
    FoundDevice("generator", "TCPIP::192.0.2.7::5025::SOCKET", "Keysight 33511B #MY1", "MY1", "keysight-33500"),
    FoundDevice("card", "Dev3", "NI USB-6341 #77", "77"),
]


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


@pytest.fixture
def window(
    qt: QApplication, config: BenchConfig, settings: QSettings, tmp_path: Path, no_widget_left_behind: None
) -> Iterator[MainWindow]:
    with whole_window(Bench(config), config, SineDwell(frequencies_hz=(100.0,)), tmp_path, settings) as window:
        press(window, Qt.Key.Key_5, Qt.KeyboardModifier.ControlModifier)
        until(lambda: window.tabs.currentIndex() == BENCH and window.tabs.bench.draft is not None, "for the page")
        yield window


def type_into(window: QWidget, name: str, text: str) -> None:
    edit = find(window, name)
    edit.setFocus()
    edit.selectAll()
    edit.insert(text)


def test_the_open_bench_has_identity_state_and_live_values(window: MainWindow) -> None:
    until(lambda: find(window, "bench.card.live").text(), "for a reading")
    assert re.fullmatch(r"−?0\.00\d V", find(window, "bench.card.live").text())
    assert re.fullmatch(r"ai0, drive; ai1, sensor: −?0\.00\d\d V", find(window, "bench.card.live-note").text())
    assert find(window, "bench.amplifier.live").text() == "−500 V"
    assert "33511B" in find(window, "bench.generator.identity").text()
    assert "ready" in find(window, "bench.sensor.state").text()


def test_tiles_of_a_bench_that_is_not_open_name_the_button_that_opens_it(window: MainWindow) -> None:
    page, card = window.tabs.bench, find(window, "bench.card.identity")
    other = next(each for name, each in page.benches.buttons.items() if name != page.draft.name)
    other.click()
    until(lambda: not page.is_open, "for the other bench")
    for what in ("Connect", "Save and connect"):
        assert find(page, "bench.connect").text() == what
        assert re.match(f"{what} (?!again)", card.text())
        type_into(window, "bench.amplifier.rest_v", "2.4")


def test_speed_prompts_and_faults_of_the_simulated_bench_are_at_hand(window: MainWindow) -> None:
    find(window, "bench.faults").click()
    assert window.faults.isVisible()
    find(window, "bench.faults").click()
    assert not window.faults.isVisible()


def test_the_true_parameters_of_a_simulated_bench_are_a_form_in_bench_units(window: MainWindow) -> None:
    page = window.tabs.bench
    find(page, "bench.simulation.open").click()
    assert (find(page, "bench.simulation.tactor.L").text(), find(page, "bench.simulation.sensor.noise_m").text()) == (
        "22",
        "0.5",
    )  # mm, µm
    type_into(window, "bench.simulation.tactor.L1", "16 mm")
    assert "must be less than L2" in find(page, "bench.simulation.tactor.L1.fault").text()
    type_into(window, "bench.simulation.tactor.L1", "9")
    type_into(window, "bench.simulation.speed", "5")
    type_into(window, "bench.simulation.noise_seed", "77")
    find(page, "bench.simulation.card.usb_adjustable").setCurrentText("no")
    find(page, "bench.save").click()
    until(bench_files, "for the file")
    until(lambda: page.draft.has_file, "for the page")
    saved = load_bench(str(bench_files()[0])).simulation_parameters
    assert (saved.tactor.L1, saved.speed, saved.noise_seed, saved.card.usb_adjustable) == (0.009, 5.0, 77, False)
    assert saved.tactor.L2 == 0.015
    text = bench_files()[0].read_text("utf-8")
    assert "speed = 5.0             # bench seconds per wall second" in text
    assert "[simulation.skin]" not in text


def test_a_real_bench_has_no_simulation_panel(window: MainWindow) -> None:
    page = window.tabs.bench
    assert page.editor.simulation.isVisible()
    find(page, "bench.new").click()
    until(lambda: page.draft.name == "", "for the new bench")
    assert not page.editor.simulation.isVisible()
    assert find(page, "bench.message").text() == NEW_BENCH
    find(page, "bench.show.sim").click()
    until(lambda: page.draft.name, "for the simulated bench")
    assert not find(page, "bench.message").isVisible()


def test_a_new_bench_can_be_simulated(window: MainWindow) -> None:
    page = window.tabs.bench
    assert not find(page, "bench.kind").isVisible(), "a bench that has a file keeps its kind"
    find(page, "bench.new").click()
    until(lambda: page.draft.name == "", "for the new bench")
    assert not page.draft.config.simulated
    name = find(page, "bench.name")
    QTest.keyClicks(name, "Practice")
    assert name.text() == "Practice", "what is typed takes the place of the suggested name"
    find(page, "bench.kind.True").click()
    until(lambda: page.draft is not None and page.draft.config.simulated, "for the simulated one")
    assert name.text() == "Practice"
    find(page, "bench.save").click()
    until(lambda: page.draft.name, "for the file")
    assert load_bench(page.draft.name).simulated
    assert Path(page.draft.name).stem == "practice"


@pytest.mark.parametrize(
    ("role", "control"),
    [("generator", "bench.generator.resource"), ("card", "bench.card.device"), ("sensor", "bench.live")],
)
def test_a_problem_of_a_tile_leads_to_what_mends_it(window: MainWindow, role: str, control: str) -> None:
    page = window.tabs.bench
    problem = find(page, f"bench.{role}.problem")
    until(lambda: not window.state.problem, "for the bench")
    lamps = (InstrumentStatus(role, "x", Lamp.MISSING, "does not answer"),)
    page.set_state(replace(window.state, fitted=lamps))
    assert problem.isVisible()
    assert lamps[0].remark in problem.text()
    remedy = find(page, f"bench.{role}.remedy")
    before = remedy.previousInFocusChain()
    while before.focusPolicy() is Qt.FocusPolicy.NoFocus or not before.isVisible():
        before = before.previousInFocusChain()
    before.setFocus()
    QTest.keyClick(before, Qt.Key.Key_Tab)
    assert window.focusWidget() is remedy, "one Tab leads to it"
    QTest.keyClick(remedy, Qt.Key.Key_Space)
    QCoreApplication.processEvents()
    assert window.focusWidget() is find(page, control)
    place = page._area.viewport()
    target = find(page, control)
    assert place.rect().contains(target.mapTo(place, target.rect().center()))


def test_a_run_takes_the_card_from_the_live_values_and_gives_it_back(window: MainWindow) -> None:
    until(lambda: window.adapter.feed.reading is not None, "for a reading")
    window.tabs.select_page(MEASURE)
    press(window, Qt.Key.Key_F5)
    during = []  # readings shown during the run; the last one before it may arrive with its state

    def has_ended() -> bool:
        if window.state.phase is BenchState.LIVE:
            during.append(window.adapter.feed.reading)
        return window.state.outcome is not None

    until(has_ended, "for its end")
    assert len({id(reading) for reading in during if reading is not None}) <= 1
    assert window.state.outcome.verdict.outcome.has_result
    window.tabs.select_page(BENCH)
    until(lambda: window.adapter.feed.reading is not None, "for a reading after the run")
    until(lambda: find(window, "bench.card.live").text() == "2.500 V", "for rest")


def test_a_scan_fills_in_what_it_found_and_the_file_is_saved(
    window: MainWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[object] = []
    monkeypatch.setattr(
        "app.gui.bench_page.editor.find_devices", lambda *given: asked.append(given) or (FOUND, ["no VISA library"])
    )
    page = window.tabs.bench
    find(page, "bench.new").click()
    until(lambda: page.draft is not None and page.draft.name == "", "for the new bench")
    type_into(window, "bench.hosts", "192.0.2.7, 192.0.2.8:5555")
    type_into(window, "bench.server", "192.0.2.9:31763")
    find(page, "bench.scan").click()
    until(lambda: find(page, "bench.card.device").text() == "Dev3", "for the scan")
    assert asked == [(["192.0.2.7", "192.0.2.8:5555"], "192.0.2.9:31763")]
    assert "no VISA library" in find(page, "bench.message").text()
    type_into(window, "bench.name", "Ann")
    type_into(window, "bench.sensor.gain_m_per_v", "0.5 mm/V")
    address = "USB0::0x0957::0x2C07::MY52800000::0::INSTR"
    type_into(window, "bench.card.serial", address)
    assert find(page, "bench.card.serial").toolTip().startswith(f"{address}\n"), "the field is too narrow for it"
    type_into(window, "bench.card.serial", "1A2B")
    assert "1A2B" not in find(page, "bench.card.serial").toolTip()
    find(page, "bench.further").click()
    type_into(window, "bench.environment.port", "COM7")
    type_into(window, "bench.backup.folder", "/mnt/share/tactors")
    type_into(window, "bench.specimen.gap_m", "1 mm")
    find(page, "bench.channels.add").click()
    find(page, "bench.save").click()
    until(bench_files, "for the file")
    until(lambda: page.draft is not None and page.draft.has_file, "for the page")
    config = load_bench(str(bench_files()[0]))
    assert (config.name, config.generator.resource, config.generator.serial) == ("Ann", FOUND[0].where, "MY1")
    assert (config.card.device, config.card.server) == ("Dev3", "192.0.2.9:31763")
    assert (config.sensor.gain_m_per_v, config.specimen.gap_m) == (5e-4, 1e-3)
    assert [channel.channel for channel in config.channels] == ["ai2"]
    assert (config.environment.port, config.backup.folder) == ("COM7", "/mnt/share/tactors")
    assert comment_of("rest_v", bench_files()[0].read_text("utf-8")) == comment_of("rest_v", TEMPLATE) != ""
    assert not find(page, "bench.save").isEnabled()


def test_a_fault_is_written_below_its_field_and_is_not_saved(window: MainWindow) -> None:
    type_into(window, "bench.amplifier.slope_above", "-3")
    fault = find(window, "bench.amplifier.slope_above.fault")
    assert fault.isVisible()
    assert "-3" in fault.text()
    type_into(window, "bench.name", "other")
    find(window, "bench.save").click()
    assert "correct it first" in find(window, "bench.message").text()
    assert not bench_files()
    type_into(window, "bench.amplifier.slope_above", "500")
    assert not fault.isVisible()
    assert window.tabs.bench.editor.amplifier.plot.layer("characteristic").y[-1] == 1250


def test_every_widget_for_input_has_a_name_and_a_text_for_screen_readers(window: MainWindow) -> None:
    page = window.tabs.bench
    for widget in page.findChildren(QWidget):
        if widget.focusPolicy() & Qt.FocusPolicy.TabFocus and type(widget).__module__.startswith(("app", "PySide6")):
            if widget.objectName().startswith("qt_") or not hasattr(widget, "accessibleName"):
                continue
            if type(widget).__name__ in ("QLineEdit", "QComboBox", "QCheckBox", "QPushButton", "QListWidget"):
                assert widget.objectName().startswith(("bench.", "plot.")), widget
                assert widget.accessibleName() or widget.property("text"), widget.objectName()


def test_the_bench_chosen_last_is_opened_at_the_next_start(
    qt: QApplication, settings: QSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[tuple[str, int]] = []

    def close_at_once(window: MainWindow, _units: object) -> int:
        opened.append((window.tabs._open_bench, window.tabs.currentIndex()))
        if len(opened) == 1:
            window.change_bench("other.toml")
        window._session_closed = True
        end_all(window)
        window.deleteLater()
        return 0

    monkeypatch.setattr(application, "_run_until_closed", close_at_once)

    def start() -> None:
        application.open_window(
            application.OpenedBench(lambda: pytest.fail("nothing connects here"), load_bench("ideal")),
            application.InitialForm(SineDwell(), tmp_path),
            settings=settings,
            make_session=lambda *_: ListeningSession(),
            bench_factory=lambda name: application.OpenedBench(
                lambda: pytest.fail("nothing connects here"), load_bench("ideal"), name=name
            ),
            bench_given=False,
        )

    start()
    assert opened == [("sim", MEASURE), ("other.toml", MEASURE)]
    del opened[:]
    start()
    assert opened[0][0] == "other.toml"


def test_a_start_without_any_bench_shows_the_page_behind_the_welcome(open_stage: OpenStage) -> None:
    window = open_stage().window
    window.central.show_welcome()
    find(window, "welcome.setup").click()
    assert window.tabs.currentIndex() == BENCH
    assert not window.central.is_covered


def test_a_card_that_fails_between_runs_is_told_with_its_reason_and_is_tried_again(
    window: MainWindow,
) -> None:
    until(lambda: window.adapter.feed.reading is not None, "for a reading")
    window.adapter.faults.inject("card-unplugged")
    until(lambda: window.state.problem, "for the failure")
    assert window.state.problem.startswith("There are no live values: ")
    assert find(window, "notices.problem").isVisible()
    until(lambda: not find(window, "bench.card.live").text(), "for the value to go")
    assert [i.lamp for i in window.state.instruments if i.role == "card"] == ["see the message"]
    window.adapter.faults.clear()
    until(lambda: find(window, "bench.card.live").text(), "for live values")
    assert window.state.problem == ""
    until(lambda: {i.lamp for i in window.state.instruments if i.role == "card"} == {"ready"}, "for the lamp")


# -- calibration, wiring check, commissioning ---------------------------------------------------------------------------


def take(window: MainWindow, position: str) -> None:
    page = window.tabs.bench
    type_into(window, "bench.calibration.position", position)
    until(lambda: page.calibration._reading is not None, "for a reading")  # there is none after each restart
    volts = page.calibration._reading.sensor_v
    find(page, "bench.calibration.move").click()
    if position != "0":

        def moved() -> bool:
            reading = page.calibration._reading
            return reading is not None and abs(reading.sensor_v - volts) > 0.5

        until(moved, "for the target to have moved")
    window.adapter.feed.restart_reading()
    until(lambda: (r := window.adapter.feed.reading) is not None and r.blocks == READING_BLOCKS, "for two seconds")
    window.tick()
    find(page, "bench.calibration.take").click()


def test_three_positions_calibrate_the_sensor_and_are_saved(window: MainWindow) -> None:
    page = window.tabs.bench
    find(page, "bench.calibrate").click()
    until(lambda: find(page, "bench.calibration.take").isEnabled(), "for a reading")
    type_into(window, "bench.calibration.uncertainty", "0.5")
    find(page, "bench.calibration.take").click()
    assert "give a value in µm" in find(page, "bench.calibration.message").text()
    for position in ("0", "150", "0.3 mm"):
        take(window, position)
    table = find(page, "bench.calibration.points")
    assert [table.item(at, 0).text() for at in range(3)] == ["0", "150", "300"]
    found = page.calibration.result
    assert found.gain_m_per_v == pytest.approx(1e-4, rel=5e-3)
    assert 0 < found.gain_relative_uncertainty < 0.01
    assert "±" in find(page, "bench.calibration.result").text()
    find(page, "bench.calibration.apply").click()
    assert find(page, "bench.sensor.gain_m_per_v").text().startswith(("100", "99"))  # µm/V
    find(page, "bench.save").click()
    until(bench_files, "for the file")
    until(lambda: page.draft.has_file, "for the page")
    sensor = load_bench(str(bench_files()[0])).sensor
    assert sensor.gain_relative_uncertainty == pytest.approx(found.gain_relative_uncertainty, rel=0.05)
    assert [position for position, _ in sensor.calibration_points] == pytest.approx([0, 150e-6, 300e-6])
    assert sensor.calibrated < sensor.expires


def test_the_wiring_check_ends_in_its_table_on_the_page(window: MainWindow) -> None:
    page = window.tabs.bench
    until(lambda: find(page, "bench.check").isEnabled(), "for the bench")
    window.adapter.faults.inject("sensor-stuck")
    find(page, "bench.check").click()
    until(lambda: window.state.outcome is not None, "for the check")
    table = find(page, "checks.table")
    assert table.isVisible()
    assert table.item(0, 0).text() == "✕ FAIL"
    assert table.item(0, 5).text(), "there is a remedy"
    window.adapter.faults.clear()


def test_the_source_is_commissioned_with_checks_and_traces_and_the_bench_is_connected_again(
    window: MainWindow,
) -> None:
    page, session = window.tabs.bench, window.adapter.session
    until(lambda: find(page, "bench.commission").isEnabled(), "for the bench")
    find(page, "bench.commission").click()
    assert window.state.busy
    until(lambda: find(page, "bench.commission.progress").text().startswith("exercise"), "for an exercise")
    assert find(page, "bench.commission.stop").isVisible()
    until(lambda: find(page, "bench.commission.bar").value() > 0, "for the progress")
    until(lambda: find(page, "bench.commission.table").isVisible(), "for the checks")
    assert not find(page, "bench.commission.bar").isVisible()
    assert "pass" in find(page, "bench.commission.verdict").text()
    until(lambda: not find(page, "bench.commission.traces").pixmap().isNull(), "for the traces")
    until(lambda: window.state.can_run, "for the bench")
    assert window.adapter.session is not session
    identity = next(each.identity for each in window.state.instruments if each.role == "generator")
    assert any(identity in line.text and "pass" in line.text for line in window.state.messages)


def test_stop_ends_a_commissioning_without_a_record(window: MainWindow) -> None:
    page = window.tabs.bench
    until(lambda: find(page, "bench.commission").isEnabled(), "for the bench")
    find(page, "bench.commission").click()
    until(lambda: find(page, "bench.commission.progress").text().startswith("exercise"), "for an exercise")
    press(window, Qt.Key.Key_F12)
    until(lambda: window.state.can_run, "for the bench")
    window.tick()
    assert find(page, "bench.commission.message").text().casefold() == STOPPED
    assert not find(page, "bench.commission.table").isVisible()


def test_closing_during_a_commissioning_waits_until_the_source_is_at_rest(window: MainWindow) -> None:
    page = window.tabs.bench
    until(lambda: find(page, "bench.commission").isEnabled(), "for the bench")
    find(page, "bench.commission").click()
    until(lambda: find(page, "bench.commission.progress").text().startswith("exercise"), "for an exercise")
    job = window.controller.commissioning
    window.close_session(force=True)
    until(lambda: not window.isVisible(), "for the window to close")
    assert job.ended


class AtTheAmplifier:
    """Does what the prompt card says on a simulated bench, answers by Enter, and keeps the words of the sign with the volts."""

    def __init__(self, window: MainWindow, world: SimulatedBench) -> None:
        self.window, self.operator = window, SimulatedOperator(world)
        self.asked: dict[int, str] = {}
        self.shown: set[tuple[str, str]] = set()

    def looks(self) -> None:
        view, prompt = self.window.strip.view, self.window.state.prompt
        assert view is not None
        self.shown.add((sign(self.window), view.measured))
        card = find(self.window, "notices.prompt")
        if prompt is None or prompt.ask_id in self.asked or not (card.isVisible() and card.accepts_input):
            return
        self.operator.show(0, prompt.prompt)
        self.asked[prompt.ask_id] = prompt.prompt.action
        press(self.window, Qt.Key.Key_Return)


@pytest.mark.breaks_the_drive  # high voltage goes at a level
def test_the_interlock_is_measured_after_the_source_with_the_prompts_and_the_volts_of_a_run(
    qt: QApplication, settings: QSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checks = (CheckedOutput(OutputCheck.UNEVEN, 1.0, "1", 0.97, 1.03),)
    passed = Commissioned(checks, MeasuredTimes(0.2, 0.1, 0.1), (), ())
    monkeypatch.setattr(commissioning, "commission_bench", lambda _, switch, *__: switch.disable() or passed)
    monkeypatch.setattr(commissioning_record, "user_data_path", lambda *_, **__: tmp_path)
    truth = simulated(plant_rate_hz=20_000.0, modes=3).simulation_parameters
    world = SimulatedBench(replace(truth, interlock=INTERLOCK), WallClock(1.0))
    with ServedBench(world) as served:
        file = tmp_path / "interlocked.toml"
        file.write_text(
            f"""name = "interlocked"
generator = {{resource = "TCPIP::127.0.0.1::{served.scpi.port}::SOCKET", timeout_s = 1.0}}
card = {{server = "127.0.0.1:{served.card.port}"}}
sensor = {{delay_s = 1e-4}}
watchdog = {{silence_s = 2.0}}
interlock = {{line = "{INTERLOCK.line}", state_line = "{INTERLOCK.state_line}"}}
""",
            "utf-8",
        )
        config, dwell = load_bench(str(file)), SineDwell(frequencies_hz=(100.0,))
        adapter = SessionAdapter(lambda: connect(config))
        with whole_window(adapter, config, dwell, tmp_path, settings, str(file)) as window:
            press(window, Qt.Key.Key_5, Qt.KeyboardModifier.ControlModifier)
            until(lambda: window.tabs.currentIndex() == BENCH and window.tabs.bench.draft is not None, "for the page")
            page, hand = window.tabs.bench, AtTheAmplifier(window, world)
            until(lambda: find(page, "bench.commission").isEnabled(), "for the bench")
            find(page, "bench.commission").click()
            until(lambda: hand.looks() or find(page, "bench.commission.table").isVisible(), "for the checks")
            done = page.commissioning.job.result
            verdict = find(page, "bench.commission.verdict").text()
            until(lambda: window.state.can_run, "for the bench")
            assert not window.adapter.session.bench.high_voltage_refusal
    off, on = DISABLE_HIGH_VOLTAGE.action, ENABLE_HIGH_VOLTAGE.action
    assert list(hand.asked.values()) == [off, on, off]
    found = done.result.checks[-1]
    assert found.check is OutputCheck.INTERLOCK
    assert found.value == pytest.approx(0.6, abs=0.05)
    assert OutputVerdict.PASS in verdict
    assert (word(BenchState.LIVE), "+300 V") in hand.shown
    assert not world.history.high_voltage_on


# -- live view and drives by hand ---------------------------------------------------------------------------------------


def test_the_sensors_tile_shows_the_lasers_place_in_its_range(window: MainWindow) -> None:
    until(lambda: "aim at 50 %" in find(window, "bench.sensor.live-note").text(), "for live volts")
    assert abs(find(window, "bench.sensor.range").value() - 500) < 20
    find(window, "bench.live").click()
    live = window.tabs.bench.live
    until(lambda: live.plot is not None and live.plot.frames > 0, "for the traces")
    window.adapter.faults.inject("sensor-out-of-range")
    until(lambda: find(window, "bench.sensor.live").text() == "out of range", "for the fault")
    window.adapter.faults.clear()


def test_a_level_and_a_tone_by_hand_are_runs_that_end_at_rest(window: MainWindow) -> None:
    find(window, "bench.live").click()
    for name, protocol in (("bench.hand.hold", "voltage-steps"), ("bench.hand.play", "sine-dwell")):
        until(lambda name=name: find(window, name).isEnabled(), "for the bench")
        find(window, name).click()
        assert window.state.busy
        until(lambda: window.state.outcome is not None, "for the end")
        assert window.state.protocol == protocol
        assert window.state.bench_state is BenchState.AT_REST
        assert len(window.state.points) == 1


def test_stop_brings_a_level_held_by_hand_to_rest(window: MainWindow) -> None:
    find(window, "bench.live").click()
    until(lambda: find(window, "bench.hand.hold").isEnabled(), "for the bench")
    type_into(window, "bench.hand.level-s", "3600")
    find(window, "bench.hand.hold").click()
    until(lambda: window.state.drive is not None, "for the drive")
    press(window, Qt.Key.Key_Escape)
    until(lambda: window.state.outcome is not None, "for the end")
    assert window.state.outcome.status.value == "stopped"
    assert window.state.rest.confirmed


def test_a_level_beyond_the_amplifier_is_refused_and_nothing_moves(window: MainWindow) -> None:
    find(window, "bench.live").click()
    until(lambda: find(window, "bench.hand.hold").isEnabled(), "for the bench")
    type_into(window, "bench.hand.level", "7")
    find(window, "bench.hand.hold").click()
    assert "levels_v" in find(window, "bench.hand.message").text()
    assert not window.state.busy


def test_a_commissioning_stopped_before_its_first_message_claims_no_rest(config: BenchConfig) -> None:
    job = CommissioningJob(config, Bench(config))
    job.stop()
    job.start()
    until(lambda: job.ended, "for the job")
    assert "before anything was commanded" in job.error
    assert job.result is None
