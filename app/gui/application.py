"""Opens the main window and runs it until it is closed; signals close it like the user."""

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import FrameType

from PySide6.QtCore import QCoreApplication, QEvent, QSettings, QTimer
from PySide6.QtWidgets import QApplication

from app.archive import AfterRun
from app.common import RecentErrors, to_number
from app.config import BenchConfig, ConfigError
from app.gui.face import install_fonts
from app.gui.shell import BENCH, MainWindow, collect_garbage_here
from app.gui.shell import InitialForm as InitialForm
from app.live import Connect, MakeSession, SessionAdapter
from app.remote import PhoneStop
from app.session import UNSAFE_EXIT, Session, SimulationSettings

UNITS_IMPORT_DELAY_MS = 500
DELETION_DELAY_MS, DELETION_PAUSE_MS = 100, 30
"""After which a window is hidden that another one has taken the place of, and between the deletion of two of its pages."""

SWITCH_INTERVAL_S = 1e-3
"""After which a thread that computes in Python lets the window's thread continue; Python's default of 5 ms is waited for several
times between an input and its paint."""

WELCOME_SEEN_KEY = "window/seen"
"""Settings key: this window has been opened before."""

LAST_BENCH_KEY = "bench/last"
"""Settings key: the bench that was chosen last in the window."""


@dataclass(frozen=True, slots=True)
class OpenedBench:
    """A bench that the window opens.

    Args:
        connect: opens it.
        config: the bench file, for names and the amplifier's map.
        simulation: settings of a simulated bench that the operator may change in the window.
        name: path of its file, or name of a simulated bench.
        after_run: command to start after each run.
    """

    connect: Connect
    config: BenchConfig
    simulation: SimulationSettings | None = None
    name: str = "sim"
    after_run: str = ""


BenchFactory = Callable[[str], OpenedBench]


def qt_application() -> QApplication:
    """Return the Qt application of this process, in the same style on every system."""
    present = QApplication.instance()
    if isinstance(present, QApplication):
        return present
    made = QApplication(sys.argv[:1])
    made.setOrganizationName("Tactor Bench")
    made.setApplicationName("Tactor Bench")
    made.setStyle("Fusion")
    install_fonts()
    return made


def open_window(
    bench: OpenedBench,
    form: InitialForm,
    settings: QSettings | None = None,
    make_session: MakeSession = Session,
    bench_factory: BenchFactory | None = None,
    bench_given: bool = True,
) -> int:
    """Show the window until it is closed; return the exit code: 0, 1 the last run failed or there was no bench, 3 UNSAFE.

    A change of the bench opens another window after the first.

    Args:
        bench: the bench to open.
        form: contents of the Measure page.
        settings: where window, folder and specimen are stored; None for the user's own settings.
        make_session: session factory, for tests without a bench.
        bench_factory: function that opens another bench by its file, if the window may change the bench; raises ConfigError.
        bench_given: whether the user has named `bench`; if not, the last chosen bench replaces it, and without one the Bench page
            is shown.
    """
    qt_application()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    kept = QSettings() if settings is None else settings
    with collect_garbage_here():
        # pint reads the units of the form and takes half a second to import: import it neither at a key press nor during the
        # first paint.
        units = threading.Thread(target=to_number, args=("1 V", "V"), name="units")
        newcomer = not form.autostart and not (kept.contains(WELCOME_SEEN_KEY) or kept.contains("window/geometry"))
        kept.setValue(WELCOME_SEEN_KEY, True)
        actions: list[AfterRun | PhoneStop] = []
        recent = RecentErrors()
        shows_benches, problem, starts_demo = False, "", False
        if not bench_given:
            bench, shows_benches, problem = _bench_used_last(bench, kept, bench_factory)
        while True:
            requested: list[OpenedBench] = []

            def change(name: str, requested: list[OpenedBench] = requested) -> None:
                if bench_factory is not None:
                    requested.append(bench_factory(name))
                    kept.setValue(LAST_BENCH_KEY, name)

            phone_stop = PhoneStop()
            adapter = SessionAdapter(bench.connect, make_session, bench.simulation, phone_stop)
            window = MainWindow(adapter, bench.config, form, kept, change, bench.name, recent)
            _show_first(window, shows_benches and not starts_demo, problem, newcomer)
            if starts_demo:
                window.start_demo()
            actions += [_start_actions_after_run(bench, adapter, phone_stop), phone_stop]
            with recent.observe(window.error_occurred.emit):
                code = _run_until_closed(window, units)
            starts_demo = window.demo_requested
            if not requested or code == UNSAFE_EXIT:
                break
            bench, form, newcomer = requested[-1], replace(form, autostart=False), False
            shows_benches, problem = False, ""  # the page that was visible is shown again
        for each in actions:  # only now, when no window is open that would stand still meanwhile
            each.close()
        if units.ident is not None:
            units.join()
    return code


def _show_first(window: MainWindow, shows_benches: bool, problem: str, newcomer: bool) -> None:
    """Show the page of benches, why a bench cannot be opened, or the welcome page."""
    if shows_benches:
        window.tabs.show_page_later(BENCH)  # it takes as long to make as everything else that is painted first
    if problem:
        window.tabs.bench.show_message(problem)
    if newcomer:
        window.central.show_welcome()


def _bench_used_last(
    bench: OpenedBench, kept: QSettings, bench_factory: BenchFactory | None
) -> tuple[OpenedBench, bool, str]:
    """Return the bench used last or else `bench`, whether the Bench page is shown, and why the last one cannot be opened."""
    last = str(kept.value(LAST_BENCH_KEY, ""))
    if not last or bench_factory is None:
        return bench, False, ""
    try:
        return bench_factory(last), False, ""
    except ConfigError as error:
        return bench, True, f"The bench used last cannot be opened. {error}"


def _start_actions_after_run(bench: OpenedBench, adapter: SessionAdapter, phone_stop: PhoneStop) -> AfterRun:
    """Copy run files and start the command after each run of a session; tell the page of a stop from a phone of the end."""
    adapter.events.subscribe(phone_stop.observe)
    after_run = AfterRun(lambda message: adapter.publish([message]), bench.config, bench.after_run)
    adapter.events.subscribe(after_run.observe)
    return after_run


def _run_until_closed(window: MainWindow, units: threading.Thread) -> int:
    app = qt_application()
    replaced = _replaced_windows(window)
    if not replaced:
        window.show()
    else:  # in a turn of the event loop of its own, as is the deletion of each page: together they would stop all input for long
        QTimer.singleShot(0, window, window.show)
    for each in replaced:  # once this one is painted: nothing flickers, and it comes sooner
        QTimer.singleShot(DELETION_DELAY_MS, each, each.hide)
        for at, part in enumerate((*each.tabs.release_pages(), each), 1):
            QTimer.singleShot(DELETION_DELAY_MS + at * DELETION_PAUSE_MS, part, part.deleteLater)
    if units.ident is None:
        QTimer.singleShot(UNITS_IMPORT_DELAY_MS, window, units.start)
        # Objects of the window live until the end: a garbage collection over them would delay a frame.
        QTimer.singleShot(UNITS_IMPORT_DELAY_MS, window, gc.freeze)
    with _close_on_signal(window):
        app.exec()
    view = window.state
    left = _replaced_windows(window)
    if not window.replaced or view.exit_code == UNSAFE_EXIT:
        left.append(window)
    for each in left:
        each.deleteLater()
        QCoreApplication.sendPostedEvents(each, QEvent.Type.DeferredDelete)
    if view.exit_code == UNSAFE_EXIT and view.outcome is not None:
        sys.stderr.write(f"{view.outcome.reason}\n")
    return view.exit_code


def _replaced_windows(present: MainWindow) -> list[MainWindow]:
    """Return the windows that have been replaced and are not deleted yet."""
    windows = [widget for widget in qt_application().topLevelWidgets() if isinstance(widget, MainWindow)]
    return [window for window in windows if window.replaced and window is not present]


@contextmanager
def _close_on_signal(window: MainWindow) -> Iterator[None]:
    """Go to rest and close on Ctrl-C, SIGTERM and SIGHUP. The window's timer lets Python handle them."""

    def close(_number: int, _frame: FrameType | None) -> None:
        window.close_session(force=True)

    numbers = [signal.SIGINT, signal.SIGTERM] + ([signal.SIGHUP] if os.name == "posix" else [])
    before = {number: signal.signal(number, close) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
