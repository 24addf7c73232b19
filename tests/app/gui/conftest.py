"""Main windows for tests: opened with a recording session adapter, closed and deleted afterwards."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

if os.environ.get("QT_QPA_PLATFORM", "offscreen") == "offscreen":  # whose screen has 800 x 800 points
    os.environ["QT_QPA_PLATFORM"] = f"offscreen:configfile={Path(__file__).with_name('screen.json')}"

from PySide6.QtCore import QCoreApplication, QEvent, QSettings, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from app.config.bench_file import BenchConfig, load_bench
from app.gui.application import qt_application
from app.gui.face import install_fonts
from app.gui.shell.heartbeat import FRAME_MS
from app.gui.shell.main_window import InitialForm, MainWindow
from app.gui.widgets import end_all
from app.live.session_link import SessionAdapter
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.main_window import ListeningFrame, ListeningSession, OpenPage, OpenStage, Stage, end


@pytest.fixture(scope="session")
def qt() -> QApplication:
    application = qt_application()
    install_fonts(100)  # of the screen of these tests it would be larger
    return application


@pytest.fixture(scope="session")
def config() -> BenchConfig:
    return load_bench("ideal")


@pytest.fixture
def settings(tmp_path: Path) -> QSettings:
    kept = QSettings(str(tmp_path / "settings.ini"), QSettings.Format.IniFormat)
    kept.setValue("window/text-size", "100")
    return kept


@pytest.fixture
def no_widget_left_behind(qt: QApplication) -> Iterator[None]:
    yield
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    QCoreApplication.processEvents()
    left = [w for w in qt.topLevelWidgets() if type(w).__module__.startswith("app.")]
    assert not left, f"the test left widgets: {left}"


@pytest.fixture
def open_stage(
    qt: QApplication, config: BenchConfig, settings: QSettings, tmp_path: Path, no_widget_left_behind: None
) -> Iterator[OpenStage]:
    """Makes stages and ends them.

    A page is made when a test looks at it, as it is for somebody who is quicker than the window; `ahead` makes all of them
    behind the first one, which costs as much as the window itself.
    """
    stages: list[Stage] = []

    def make(*, ahead: bool = False, **options: Any) -> Stage:
        session = ListeningSession()
        link = SessionAdapter(lambda: pytest.fail("nobody connects here"), lambda *_: session)
        contents = {"protocol": SineDwell(), "folder": tmp_path, "specimen": "T7"}
        form = InitialForm(
            **{name: options.pop(name, value) for name, value in contents.items()},
            autostart=options.pop("autostart", False),
        )
        given = {"settings": settings, "open_bench": "ideal"} | options
        window = MainWindow(link, config, form, **given)
        if not ahead:
            window.tabs.preload_pages = lambda: None  # type: ignore[method-assign]
        window.show()
        window.activateWindow()
        assert QTest.qWaitForWindowActive(window, 30_000)
        stages.append(Stage(window, session))
        return stages[-1]

    yield make
    for stage in stages:
        stage.session.lets_go = True
        if stage.window.isVisible():
            end(stage.window)
        else:
            stage.window.deleteLater()


@pytest.fixture
def open_page(qt: QApplication, no_widget_left_behind: None) -> Iterator[OpenPage]:
    """Shows a page without the window around it, for what needs no key of the window and no other page."""
    shown: list[tuple[ListeningFrame, Any]] = []

    def show(make: Callable[[], Any]) -> Any:
        frame, page = ListeningFrame(), make()
        shown.append((frame, page))
        frame.setCentralWidget(page)
        frame.resize(1280, 640)
        frame.show()
        frame.activateWindow()
        assert QTest.qWaitForWindowActive(frame, 30_000)
        ticks = QTimer(frame, interval=FRAME_MS)
        ticks.timeout.connect(page.tick)
        ticks.start()
        page.activate()
        return page

    yield show
    for frame, page in shown:
        frame.setUpdatesEnabled(False)
        end_all(page)
        frame.close()
        frame.deleteLater()


@pytest.fixture
def stage(open_stage: OpenStage) -> Stage:
    return open_stage()
