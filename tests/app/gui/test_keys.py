"""Shortcut sheet generated from the shortcuts; welcome page that leads to a first run."""

from pathlib import Path

import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtGui import QAction
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from app.config.bench_file import BenchConfig, ConfigError
from app.gui.shell.page_host import CAMPAIGN, MEASURE, TITLES
from app.gui.widgets.actions import ACTIONS, GLOBAL_GROUP, ActionInfo, shortcuts_by_group
from app.gui.widgets.file_dialog import Mode, choose_files
from protocols.base import Outcome, Prompt, PromptShown, RunEnded, RunStatus, Verdict
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.main_window import ListeningSession, OpenStage, Stage, find, until
from tests.helpers.messages import assert_names
from tests.helpers.session_events import AT_REST, LIVE, OPENED

CTRL = Qt.KeyboardModifier.ControlModifier
TAB_ORDER = ["bench.new", "bench.browse", "bench.connect", "bench.name", "bench.scan"]
"""Controls of the head of the bench page, in the order in which they are seen."""

ASKED = Prompt("place-weight", "Put 50 g on", {"mass_kg": 0.05}, ("done", "repeat the last"), hands_on=True)


def titles_of_pages(stage: Stage) -> list[str]:
    """Make every page and those of the specimen, and return their titles."""
    tabs = stage.window.tabs
    for at in range(tabs.count()):
        tabs.page(at)
    return [
        *TITLES,
        stage.window.central.specimen_page.title,
        stage.window.central.identification_page.title,
    ]


def test_every_shortcut_of_the_window_is_on_the_sheet(stage: Stage) -> None:
    stage.happen(OPENED)
    pages = titles_of_pages(stage)
    stage.window.adapter.mailbox.show(2, ASKED)
    stage.happen(*LIVE, PromptShown(2, ASKED))
    told = {
        (line.text, key)
        for lines in shortcuts_by_group(stage.window, pages).values()
        for line in lines
        for key in line.shortcuts
    }
    every = {
        (action.text(), key.toString())
        for action in stage.window.findChildren(QAction)
        if isinstance(action.data(), ActionInfo)
        for key in action.shortcuts()
    }
    assert told == every
    assert all(words for words, _ in every)
    assert set(ACTIONS) <= {action.objectName() for action in stage.window.findChildren(QAction)}
    assert ("Answer: repeat the last", "R") in every
    assert {"F5", "F8", "Esc", "Ctrl+2", "Alt+Up", "Ctrl+Shift+C", "/"} <= {key for _, key in every}


@pytest.mark.deep
def test_shortcut_sheet_lists_page_keys_is_searchable_and_closes_on_escape(stage: Stage) -> None:
    room = stage.window.central
    stage.press(Qt.Key.Key_2, CTRL)
    stage.press(Qt.Key.Key_F1)
    assert room.is_covered
    assert {title for title, _ in room.shortcut_sheet.rows} == {GLOBAL_GROUP, "Campaign"}
    QTest.keyClicks(room.shortcut_sheet.search, "?")
    assert room.is_covered, "a question mark can be searched for"
    room.shortcut_sheet.search.clear()
    QTest.keyClicks(room.shortcut_sheet.search, "move up")
    assert [line.shortcuts for _, line in room.shortcut_sheet.rows] == [("Alt+Up",)]
    stage.press(Qt.Key.Key_Escape)
    assert not room.is_covered
    assert stage.window.tabs.campaign.start_pane.specimen_edit.hasFocus(), "the keyboard is where it was"
    stage.press(Qt.Key.Key_4, CTRL)
    stage.press(Qt.Key.Key_Question)
    assert {title for title, _ in room.shortcut_sheet.rows} == {GLOBAL_GROUP, "Runs"}
    stage.press(Qt.Key.Key_F1)
    assert not room.is_covered


def test_no_key_means_two_things_at_once(stage: Stage) -> None:
    """Qt would do neither."""
    pages = titles_of_pages(stage)
    groups = shortcuts_by_group(stage.window, pages)
    everywhere = [key for line in groups.pop(GLOBAL_GROUP) for key in line.shortcuts]
    assert len(everywhere) == len(set(everywhere))
    for title, lines in groups.items():
        keys = [key for line in lines for key in line.shortcuts]
        assert not set(keys) & set(everywhere), title
        assert len(keys) == len(set(keys)), title


@pytest.mark.deep
def test_a_page_s_key_takes_the_keyboard_there_also_where_the_page_is_seen(stage: Stage) -> None:
    find(stage.window, "measure.specimen").setFocus()
    stage.press(Qt.Key.Key_1, CTRL)
    assert stage.window.measure_page.hasFocus()


@pytest.mark.parametrize(
    ("page", "from_here", "to_there"),
    [
        (
            Qt.Key.Key_1,
            "measure.protocol",
            ["form.frequencies_hz", "measure.specimen", "measure.operator", "measure.run"],
        ),
        (Qt.Key.Key_4, "runs.since", ["runs.table", "status.log"]),
        (Qt.Key.Key_5, "bench.new", ["bench.browse", "bench.connect", "bench.name", "bench.generator.resource"]),
    ],
)
def test_tab_follows_what_is_seen(stage: Stage, page: Qt.Key, from_here: str, to_there: list[str]) -> None:
    stage.happen(OPENED)
    stage.press(page, CTRL)
    controls = [find(stage.window, each) for each in (from_here, *to_there)]
    until(lambda: all(each.isVisible() and each.isEnabled() for each in controls))
    find(stage.window, from_here).setFocus()
    reached = list[str]()
    while "status.log" not in reached:
        focused = QApplication.focusWidget()
        assert focused is not None
        QTest.keyClick(focused, Qt.Key.Key_Tab)
        reached.append(stage.window.focusWidget().objectName())
    assert [each for each in reached if each in to_there] == to_there
    assert "status.stop" not in reached
    QTest.keyClick(stage.window.focusWidget(), Qt.Key.Key_Backtab)
    assert stage.window.focusWidget().objectName() == reached[-2]


def test_stop_is_in_reach_while_a_file_is_asked_for(stage: Stage, tmp_path: Path) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE)
    taken: list[list[Path]] = []
    dialog = choose_files(stage.window.tabs, "A folder", taken.append, start=str(tmp_path), mode=Mode.Directory)
    until(dialog.isActiveWindow, "for the dialog")
    assert not dialog.isModal()
    QTest.keyClick(dialog, Qt.Key.Key_F12)
    assert stage.session.stops == 1
    dialog.accept()
    assert taken == [[tmp_path]]


def test_escape_stops_first_and_closes_nothing_while_a_run_goes_on(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE)
    stage.press(Qt.Key.Key_F1)
    stage.press(Qt.Key.Key_Escape)
    assert stage.session.stops == 1
    assert stage.window.central.is_covered


def test_a_newcomer_is_led_to_a_finished_run_by_one_key(stage: Stage, tmp_path: Path) -> None:
    window = stage.window
    find(window, "measure.protocol").setCurrentIndex(1)
    window.tabs.setCurrentIndex(CAMPAIGN)
    window.central.show_welcome()
    assert str(tmp_path) in find(window, "welcome.about").text()
    assert find(window, "welcome.demo").hasFocus()
    QTest.keyClick(find(window, "welcome.demo"), Qt.Key.Key_Return)
    assert not window.central.is_covered
    assert window.tabs.currentIndex() == MEASURE
    assert "connecting" in find(window, "hint.text").text()
    stage.happen(OPENED)
    window.tick()
    assert stage.session.runs == [(SineDwell(), tmp_path, "T7")]
    stage.happen(*LIVE)
    assert_names(find(window, "hint.text").text(), ACTIONS["escape"].shortcut, "stops")
    stage.happen(AT_REST, RunEnded(RunStatus.COMPLETED, "all points measured", "run.h5", verdict=Verdict(Outcome.GOOD)))
    assert "Ctrl+4" in find(window, "hint.text").text()
    assert window.central.hint.isVisible()


@pytest.mark.deep
def test_a_bench_file_that_cannot_be_read_is_told_beside_the_button(open_stage: OpenStage) -> None:
    def refuse(name: str) -> None:
        raise ConfigError(f"{name}: line 3: give a card")

    stage = open_stage(change_bench=refuse)
    stage.window.central.show_welcome()
    stage.window.change_bench("mine.toml")
    assert find(stage.window, "welcome.message").text() == "mine.toml: line 3: give a card"
    assert find(stage.window, "welcome.message").isVisible()
    assert not stage.session.closed


@pytest.mark.deep
def test_the_first_page_is_shown_once_and_another_bench_can_be_opened_from_it(
    qt: QApplication, config: BenchConfig, settings: QSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from app.gui import application
    from app.gui.shell.main_window import MainWindow

    seen: list[tuple[str, bool]] = []
    led: list[str] = []
    opened: list[str] = []
    other = config.model_copy(update={"name": "the other bench"})

    def look(app: QApplication) -> int:
        (window,) = [w for w in app.topLevelWidgets() if isinstance(w, MainWindow) and not w.replaced]
        until(window.isVisible, "for the window")
        seen.append((window.windowTitle(), window.central.is_covered))
        led.extend([window.windowTitle()] * window.central.hint.isVisible())
        if len(seen) == 1:
            window.change_bench("other.toml")
            until(lambda: window._session_closed, "for the session to close")
            assert window.isVisible(), "it is seen until the other window is painted"
        else:
            until(lambda: [w for w in app.topLevelWidgets() if isinstance(w, MainWindow)] == [window], "for one window")
            window.close_session()
            until(lambda: not window.isVisible(), "for the window to close")
        return 0

    monkeypatch.setattr(application.QApplication, "exec", look)

    def bench(name: str) -> application.OpenedBench:
        opened.append(name)
        return application.OpenedBench(lambda: pytest.fail("nobody connects here"), other)

    def show() -> None:
        application.open_window(
            application.OpenedBench(lambda: pytest.fail("nobody connects here"), config),
            application.InitialForm(SineDwell(), tmp_path),
            settings=settings,
            make_session=lambda *_: ListeningSession(),
            bench_factory=bench,
        )

    show()
    assert opened == ["other.toml"]
    assert seen == [("Tactor Bench – ideal simulated bench", True), ("Tactor Bench – the other bench", False)]
    assert not led
    show()
    assert seen[2] == ("Tactor Bench – ideal simulated bench", False)


@pytest.mark.deep
def test_who_tries_it_over_a_real_bench_is_led_over_the_simulated_one(
    qt: QApplication, config: BenchConfig, settings: QSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from app.gui import application
    from app.gui.shell.main_window import MainWindow

    real = config.model_copy(update={"name": "the real bench", "simulation": None})
    assert not real.simulated
    led: list[tuple[str, bool]] = []

    def look(app: QApplication) -> int:
        (window,) = [w for w in app.topLevelWidgets() if isinstance(w, MainWindow) and not w.replaced]
        until(window.isVisible, "for the window")
        led.append((window.windowTitle(), window.central.hint.isVisible()))
        if len(led) == 1:
            find(window, "welcome.demo").click()
            until(lambda: window._session_closed, "for the session to close")
        else:
            window.close_session()
            until(lambda: not window.isVisible(), "for the window to close")
        return 0

    monkeypatch.setattr(application.QApplication, "exec", look)
    application.open_window(
        application.OpenedBench(lambda: pytest.fail("nobody connects here"), real),
        application.InitialForm(SineDwell(), tmp_path),
        settings=settings,
        make_session=lambda *_: ListeningSession(),
        bench_factory=lambda name: application.OpenedBench(lambda: pytest.fail("nobody connects here"), config),
    )
    assert led == [("Tactor Bench – the real bench", False), ("Tactor Bench – ideal simulated bench", True)]


def test_arrow_keys_choose_a_bench_and_tab_leads_on_through_its_page(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.press(Qt.Key.Key_5, CTRL)
    page = stage.window.tabs.bench
    until(lambda: page.draft is not None and page.benches.isVisible(), "for the bench")
    for _ in range(20):
        QApplication.processEvents()
    page.benches.buttons["ideal"].setFocus()

    def press(key: Qt.Key) -> str:
        """Press a key where the keyboard is, and return where it is then."""
        QTest.keyClick(stage.window.focusWidget(), key)
        return stage.window.focusWidget().objectName()

    assert list(page.benches.buttons) == ["sim", "ideal"]
    for key, name in ((Qt.Key.Key_Left, "sim"), (Qt.Key.Key_Right, "ideal")):
        assert press(key) == f"bench.show.{name}"
        until(lambda name=name: page.draft.name == name, f"for {name}")
    reached = [press(Qt.Key.Key_Tab) for _ in range(13)]
    assert reached[0] == TAB_ORDER[0]  # the choice of benches is one stop
    assert [each for each in reached if each in TAB_ORDER] == TAB_ORDER
    assert press(Qt.Key.Key_Backtab) == reached[-2]
