"""Barcode scanner at the window: keys with timestamps a few milliseconds apart answer no prompt and trigger no action."""

from collections.abc import Iterator

import pytest
from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLineEdit, QListWidget

from app.gui.shell.page_host import RUNS
from app.gui.widgets.barcode_scanner import BURST_GAP_MS, HOLD_MS, KeyBurstFilter
from protocols.base import ENABLE_HIGH_VOLTAGE, Prompt, PromptShown
from tests.helpers.main_window import Stage, find, until
from tests.helpers.session_events import LIVE, OPENED

ASKED = Prompt("place-weight", "Put 50 g on", {"mass_kg": 0.05}, ("done", "repeat the last", "skip"), hands_on=True)
SCANNED = (
    Qt.Key.Key_S,
    Qt.Key.Key_4,
    Qt.Key.Key_Slash,
    Qt.Key.Key_E,
    Qt.Key.Key_Space,
    Qt.Key.Key_R,
    Qt.Key.Key_Return,
)
WITH_PREFIX = (Qt.Key.Key_Return, *SCANNED)
"""Of a scanner that is set up to send Enter first."""
SCANNER_MS, PERSON_MS = 8, 120
"""Between two keys."""


class Keyboard(QObject):
    """Presses keys at the native window, as a keyboard does, with timestamps of its own."""

    def __init__(self, stage: Stage) -> None:
        super().__init__()
        self._native, self._now_ms = stage.window.windowHandle(), 1_000_000
        self._filter = stage.window.findChild(KeyBurstFilter)
        self._native.installEventFilter(self)  # the last one that is installed is the first one to be called

    def eventFilter(self, _watched: QObject, event: QEvent) -> bool:
        if isinstance(event, QKeyEvent):
            event.setTimestamp(self._now_ms)
        return False

    def scan(self, *keys: Qt.Key) -> None:
        """Type keys as a scanner does; on a busy machine as well, the next one comes before the hold of the first one ends."""
        self._filter._hold_timer.setInterval(60_000)
        self._type(SCANNER_MS, *keys)
        assert self._filter._held is None

    def press(self, *keys: Qt.Key, interval_ms: int = PERSON_MS) -> None:
        """Press keys as a person does, and wait for their actions."""
        self._filter._hold_timer.setInterval(HOLD_MS)
        self._type(interval_ms, *keys)
        until(lambda: self._filter._held is None, "for the action")

    def _type(self, interval_ms: int, *keys: Qt.Key) -> None:
        self._now_ms += 10_000
        for key in keys:
            self._now_ms += interval_ms
            QTest.keyClick(self._native, key)

    def end(self) -> None:
        self._native.removeEventFilter(self)


@pytest.fixture
def keyboard(stage: Stage) -> Iterator[Keyboard]:
    made = Keyboard(stage)
    yield made
    made.end()


def ask(stage: Stage, prompt: Prompt) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.window.adapter.mailbox.show(2, prompt)
    stage.happen(*LIVE, PromptShown(2, prompt))
    until(lambda: stage.window.notices.prompt.accepts_input, "for the guard")


def answer(stage: Stage) -> str | None:
    return stage.window.adapter.mailbox.answer(2)


@pytest.mark.parametrize("prompt", [ENABLE_HIGH_VOLTAGE, ASKED], ids=["enable", "weight"])
@pytest.mark.parametrize("in_field", [False, True], ids=["no field", "field"])
@pytest.mark.parametrize("keys", [SCANNED, WITH_PREFIX], ids=["plain", "prefix"])
def test_a_scan_answers_no_prompt_wherever_the_cursor_is(
    stage: Stage, keyboard: Keyboard, prompt: Prompt, in_field: bool, keys: tuple[Qt.Key, ...]
) -> None:
    ask(stage, prompt)
    stage.window.tabs.select_page(RUNS)
    if in_field:
        find(stage.window, "runs.search").setFocus()
    assert isinstance(QApplication.focusWidget(), QLineEdit) == in_field
    keyboard.scan(*keys)
    assert answer(stage) is None
    assert stage.window.tabs.currentIndex() == RUNS
    assert stage.session.stops == 0


@pytest.mark.parametrize("keys", [SCANNED, WITH_PREFIX], ids=["plain", "prefix"])
def test_a_scan_presses_no_button_that_has_the_focus(
    stage: Stage, keyboard: Keyboard, keys: tuple[Qt.Key, ...]
) -> None:
    ask(stage, ENABLE_HIGH_VOLTAGE)
    stage.window.notices.prompt.buttons[0].setFocus()
    keyboard.scan(*keys)
    assert answer(stage) is None


def test_enter_opens_what_is_selected_in_a_list_and_a_scan_does_not(stage: Stage, keyboard: Keyboard) -> None:
    stage.happen(OPENED)
    stage.window.tabs.select_page(RUNS)
    names = QListWidget(stage.window.tabs.runs)
    names.addItems(["T1", "T2"])
    names.setCurrentRow(1)
    names.show()
    names.setFocus()
    opened: list[str] = []
    names.itemActivated.connect(lambda item: opened.append(item.text()))
    keyboard.scan(*WITH_PREFIX)
    assert opened == []
    names.setCurrentRow(1)
    keyboard.press(Qt.Key.Key_Return)
    assert opened == ["T2"]


def test_the_keys_of_a_native_window_that_was_replaced_are_filtered(stage: Stage) -> None:
    ask(stage, ENABLE_HIGH_VOLTAGE)
    before = stage.window.windowHandle()
    stage.window.destroy()
    stage.window.create()
    stage.window.windowHandle().setVisible(True)
    assert stage.window.windowHandle() is not before
    keyboard = Keyboard(stage)
    keyboard.scan(*WITH_PREFIX)
    keyboard.end()
    assert answer(stage) is None


@pytest.mark.parametrize(("key", "text"), [(Qt.Key.Key_Return, "done"), (Qt.Key.Key_R, "repeat the last")])
def test_a_person_s_key_answers(stage: Stage, keyboard: Keyboard, key: Qt.Key, text: str) -> None:
    ask(stage, ASKED)
    stage.window.measure_page.setFocus()
    keyboard.press(Qt.Key.Key_Shift, Qt.Key.Key_F8, key)
    assert answer(stage) == text


def test_the_first_key_of_two_that_are_slow_is_not_lost(stage: Stage, keyboard: Keyboard) -> None:
    ask(stage, ASKED)
    stage.window.measure_page.setFocus()
    keyboard.press(Qt.Key.Key_R, Qt.Key.Key_X, interval_ms=BURST_GAP_MS)
    assert answer(stage) == "repeat the last"


@pytest.mark.parametrize("key", [Qt.Key.Key_Escape, Qt.Key.Key_F12])
def test_stop_works_at_once_within_a_scan(stage: Stage, keyboard: Keyboard, key: Qt.Key) -> None:
    ask(stage, ASKED)
    stage.window.measure_page.setFocus()
    keyboard.scan(Qt.Key.Key_R, key)
    assert stage.session.stops == 1
    assert answer(stage) is None


def test_a_scan_is_typed_into_the_field_with_the_cursor(stage: Stage, keyboard: Keyboard) -> None:
    stage.happen(OPENED)
    field = find(stage.window, "measure.specimen")
    field.setFocus()
    field.selectAll()
    keyboard.scan(Qt.Key.Key_M, Qt.Key.Key_1, Qt.Key.Key_1, Qt.Key.Key_Return)
    assert field.text() == "m11"
    assert field.selectedText() == "m11", "Enter has taken the name"


def test_the_key_of_a_page_works_alone_and_not_within_a_scan(stage: Stage, keyboard: Keyboard) -> None:
    stage.happen(OPENED)
    stage.window.tabs.select_page(RUNS)
    focus = QApplication.focusWidget()
    assert not isinstance(focus, QLineEdit)
    keyboard.scan(Qt.Key.Key_Slash, Qt.Key.Key_E)
    assert QApplication.focusWidget() is focus
    keyboard.press(Qt.Key.Key_Slash)
    assert isinstance(QApplication.focusWidget(), QLineEdit), "the search"
