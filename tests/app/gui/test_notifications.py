"""Notifications, the web page's setting, and texts that a barcode scanner types."""

import hashlib
import http.client
import json
import wave
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QMainWindow

from app.gui.remote.controller import NETWORK, OFF, THIS_COMPUTER
from app.gui.remote.setting import RemoteSetting, qr_pixmap
from app.gui.status.notifier import NOTICE_KEY, PROMPT_DELAY_MS, SOUND_KEY, TONES, Notifier, tone_wave
from app.gui.widgets.actions import ACTIONS
from app.remote import Snapshot, snapshot_record
from app.session import initial_window_state, reduce
from app.session.state import TimedEvent
from model import AmplifierMap
from protocols.base import DriveReadbackChanged, Prompt, PromptAnswered, PromptShown, StopOffered
from tests.app.laboratory.test_remote import NOW
from tests.helpers.main_window import OpenStage, Stage, find, until
from tests.helpers.messages import assert_names
from tests.helpers.session_events import LIVE, LOST, OPENED, STOPPED

ASKED = PromptShown(7, Prompt("place-weight", "Put 200 g on the centre."))


class Announced:
    """A notifier that records what it plays and shows."""

    def __init__(self, window: QMainWindow, settings: QSettings) -> None:
        self.sounds: list[str] = []
        self.notices: list[str] = []
        self.notifier = Notifier(window, settings, self.sounds.append, lambda title, _: self.notices.append(title))
        self.view = initial_window_state(AmplifierMap(), "bench", True, {})
        self.notifier.set_state(self.view)

    def happen(self, *events: Any) -> None:
        for event in events:
            self.view = reduce(self.view, TimedEvent(event, NOW))
            self.notifier.set_state(self.view)


@pytest.fixture
def announced(qt: Any, settings: QSettings) -> Any:
    window = QMainWindow()
    yield Announced(window, settings)
    window.deleteLater()


def test_end_prompt_and_unsafe_are_announced_once(announced: Announced) -> None:
    announced.happen(OPENED, *LIVE, *STOPPED)
    assert announced.sounds == ["done"]
    announced.happen(*LIVE, ASKED)
    until(lambda: len(announced.sounds) > 1, f"for {PROMPT_DELAY_MS} ms")
    announced.happen(PromptAnswered(7, "done"), *LOST)
    assert announced.sounds == ["done", "prompt", "unsafe"]
    assert announced.notices[1] == "SIMULATED: Operator needed"
    assert announced.notices[2].startswith("SIMULATED: UNSAFE")
    assert len(announced.notices) == 3


def test_a_drive_that_is_lost_is_announced_once(announced: Announced) -> None:
    announced.happen(OPENED, *LIVE, DriveReadbackChanged(True, 0.0, 0.0), DriveReadbackChanged(True, 0.0, 0.0))
    assert announced.sounds == ["unsafe"]
    assert_names(announced.notices[0], "DRIVE", "LOST")


def test_a_prompt_that_is_answered_at_once_is_not_announced(announced: Announced) -> None:
    announced.happen(*LIVE, ASKED)
    assert announced.notifier._prompt_timer.isActive()
    announced.happen(PromptAnswered(7, "done"))
    assert not announced.notifier._prompt_timer.isActive()


def test_sound_and_notice_can_be_switched_off(announced: Announced) -> None:
    announced.notifier.switch(SOUND_KEY, False)
    announced.happen(*LIVE, *STOPPED)
    assert announced.sounds == []
    assert len(announced.notices) == 1
    announced.notifier.switch(SOUND_KEY, True)
    announced.notifier.switch(NOTICE_KEY, False)
    announced.happen(*LIVE, *LOST)
    assert announced.sounds == ["unsafe"]
    assert len(announced.notices) == 1


@pytest.mark.parametrize("kind", TONES)
def test_tones_are_audible_and_do_not_clip(kind: str) -> None:
    with wave.open(BytesIO(tone_wave(TONES[kind]))) as file:
        samples = memoryview(file.readframes(file.getnframes())).cast("h")
    assert 5000 < max(map(abs, samples)) < 20_000
    assert abs(samples[0]) + abs(samples[-1]) < 1000
    assert 0.2 < len(samples) / 22_050 < 2.0


def test_the_web_page_is_off_until_it_is_chosen_and_shows_the_window(stage: Stage) -> None:
    remote = stage.window.remote
    assert remote.mode == OFF
    assert remote.server is None
    stage.window.central.show_settings("web page")
    setting: RemoteSetting = stage.window.findChild(RemoteSetting)
    remote._settings.setValue("remote/port", 0)
    setting.mode.setCurrentIndex(setting.mode.findData(THIS_COMPUTER))
    until(lambda: remote.url, "for the server")
    assert setting.address.text() == remote.url == f"http://127.0.0.1:{remote.server.port}/"
    stage.happen(OPENED, *LIVE)
    connection = http.client.HTTPConnection("127.0.0.1", remote.server.port, timeout=60)
    connection.request("GET", "/state.json")
    record = json.loads(connection.getresponse().read())
    connection.close()
    assert record["state"] == "live"
    assert record["voltage"] == stage.window.controller.strip().measured
    assert record["specimen"] == "T7"
    assert record["age_s"] < 60
    setting.mode.setCurrentIndex(setting.mode.findData(NETWORK))
    until(lambda: "#" in remote.url, "for the token")
    first = remote.url
    assert setting.code.isVisible()
    setting.renew_button.click()
    until(lambda: remote.url != first and "#" in remote.url, "for another token")
    setting.mode.setCurrentIndex(setting.mode.findData(OFF))
    until(lambda: not remote.url)
    assert remote.server.port == 0
    stage.happen(*STOPPED)


def test_the_stop_of_an_unattended_run_is_shown_until_its_end_and_in_no_log(stage: Stage) -> None:
    secret = "c" * 22
    stage.window.central.show_settings("web page")
    setting: RemoteSetting = stage.window.findChild(RemoteSetting)
    stage.happen(OPENED, *LIVE)
    assert not setting.stop_code.isVisible()
    stage.happen(StopOffered(f"http://192.0.2.1:8464/#{secret}"))
    until(setting.stop_code.isVisible, "for the address")
    assert secret in setting.stop_address.text()
    assert not any(secret in line.text for line in stage.window.state.messages)
    assert secret not in json.dumps(snapshot_record(Snapshot(stage.window.state)))
    stage.happen(*STOPPED)
    until(lambda: not setting.stop_code.isVisible(), "for the end")
    assert secret not in setting.stop_address.text()


def test_the_code_of_an_address_is_black_on_white_with_a_quiet_zone(qt: Any) -> None:
    image = qr_pixmap("http://192.0.2.1:8462/#abcdefghijklmnopqrstuv").toImage()
    colors = {image.pixelColor(x, y).name() for x in range(0, image.width(), 5) for y in range(0, image.height(), 5)}
    assert colors == {"#000000", "#ffffff"}
    assert all(image.pixelColor(x, 19).name() == "#ffffff" for x in range(image.width()))
    assert image.pixelColor(21, 21).name() == "#000000"  # of the finder pattern


def test_a_scanned_label_names_the_specimen_and_starts_nothing(stage: Stage, tmp_path: Path) -> None:
    sheet = tmp_path / "M4.specimen.toml"
    sheet.write_text('specimen = "M4"\n')
    digest = hashlib.sha256(sheet.read_bytes()).hexdigest()[:12]
    stage.happen(OPENED)
    field, toast = stage.window.measure_page.run_panel.specimen_edit, stage.window.status_line.label
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, f"M4 #{digest}")
    QTest.keyClick(field, Qt.Key.Key_Return)
    assert field.text() == "M4"
    until(lambda: "is unchanged since the label was printed" in toast.text(), "for the comparison")
    QTest.keyClicks(field, f"M4 #{'0' * 12}")  # replaces the name
    QTest.keyClick(field, Qt.Key.Key_Enter)
    assert field.text() == "M4"
    until(lambda: "has changed since the label was printed" in toast.text())
    stage.window.tick()
    assert stage.session.runs == []


def test_one_key_saves_a_problem_report(stage: Stage, tmp_path: Path) -> None:
    stage.happen(OPENED, *LIVE, *STOPPED)
    stage.window.remote._settings.setValue("remote/token", "secret-secret-secret")
    stage.press(Qt.Key.Key_F1, Qt.KeyboardModifier.ControlModifier)
    page = stage.window.central.problem_page
    assert page.isVisible()
    assert "without points and results" in find(page, "problem.contents").text()
    assert "operator's name" in find(page, "problem.left-out").text()
    page.comment_edit.setPlainText("it did not arm")
    page.save(tmp_path / "report.zip")
    until(lambda: page.message_label.text().startswith("Saved"), "for the report")
    with zipfile.ZipFile(tmp_path / "report.zip") as report:
        assert report.read("comment.txt") == b"it did not arm"
        assert b"Stopped by the operator" in report.read("log.txt")
        assert b"secret-secret-secret" not in b"".join(map(report.read, report.namelist()))
    stage.press(Qt.Key.Key_F1, Qt.KeyboardModifier.ControlModifier)
    assert not stage.window.central.is_covered
    stage.window.error_occurred.emit()
    assert ACTIONS["problem"].shortcut in stage.window.status_line.label.text()


def test_the_settings_are_kept(open_stage: OpenStage, settings: QSettings) -> None:
    stage = open_stage()
    stage.window.central.show_settings("sound")
    box = find(stage.window, "settings.notify/sound")
    assert box.isChecked()
    box.click()
    assert not stage.window.notifier.is_on(SOUND_KEY)
    assert not Notifier(stage.window, settings).is_on(SOUND_KEY)
