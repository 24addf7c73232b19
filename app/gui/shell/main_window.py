"""Main window: menu line, strip, rail, pages and status line of one session, refreshed by a timer."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QByteArray, QEvent, QSettings, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QKeyEvent, QKeySequence, QPaintEvent, QResizeEvent, QShowEvent
from PySide6.QtWidgets import QApplication, QCheckBox, QGraphicsView, QLineEdit, QMainWindow, QWidget

from app.common import RecentErrors
from app.config import BenchConfig, ConfigError
from app.gui.face import APPEARANCES, MENU_HEIGHT, TEXT_SIZES, px, set_length
from app.gui.remote import RemoteController
from app.gui.shell.heartbeat import Heartbeat
from app.gui.shell.look import FRAME_SIZE, WindowLook
from app.gui.shell.menus import MainMenus
from app.gui.shell.page_host import BENCH, CAMPAIGN, MEASURE, TITLES
from app.gui.shell.page_stack import CentralStack
from app.gui.shell.rail import Rail
from app.gui.shell.tab_order import TabOrder
from app.gui.shell.tabs import MainTabs
from app.gui.status import (
    NOTICE_KEY,
    SOUND_KEY,
    BenchRibbon,
    BenchStrip,
    FaultDrawer,
    LogDrawer,
    Notices,
    Notifier,
    SessionController,
    SimulationControls,
    WindowStatusLine,
    stops_by_escape,
)
from app.gui.widgets import (
    ACTIONS,
    KeyBurstFilter,
    Told,
    actions_of,
    add_actions,
    column,
    configure,
    end_all,
    make_combo,
    row,
    tell,
    update_actions,
)
from app.live import SessionAdapter
from app.session import (
    BenchState,
    LogLine,
    WindowState,
    build_protocol,
    initial_window_state,
    unreported_watchdog_messages,
)
from protocols import DEFAULT_PROTOCOL, PROTOCOLS
from protocols.base import Protocol

if TYPE_CHECKING:
    from app.archive import ProblemFacts
    from app.gui.help import Setting

ERROR_TEXT = "The program made an error. Ctrl+F1 saves a problem report for its developers."

HIDDEN_CONNECT_DELAY_MS = 500
"""A window that is not visible, and so not painted, connects after this time."""

FILES_OF_PLOTS = ("plot.copy-picture", "plot.copy-data", "plot.save-picture", "plot.save-data")

NOTIFICATIONS = (
    (SOUND_KEY, "Sound", "When the operator is needed, a run has ended, or the bench is unsafe"),
    (NOTICE_KEY, "Notices of the desktop", "The same as text, while another window is in front; unsafe always"),
)


@dataclass(frozen=True)
class InitialForm:
    """Initial contents of the Measure page.

    Attributes:
        folder: folder of run files; None for the last used one.
        specimen: name of the specimen; None for the last used one.
        autostart: begin a run as soon as the bench is connected.
    """

    protocol: Protocol
    folder: Path | None = None
    specimen: str | None = None
    autostart: bool = False


class MainWindow(QMainWindow):
    """Shows the state of a session and forwards the operator's commands to it.

    Closing goes to rest first: the window stays responsive until the session has released the bench.
    """

    error_occurred = Signal()
    """The program made an error that nothing handled; emitted from any thread."""

    def __init__(
        self,
        adapter: SessionAdapter,
        config: BenchConfig,
        form: InitialForm,
        settings: QSettings,
        change_bench: Callable[[str], object] | None = None,
        open_bench: str = "sim",
        recent_errors: RecentErrors | None = None,
    ) -> None:
        super().__init__()
        self._open_bench, self._recent_errors = open_bench, recent_errors or RecentErrors()
        self.adapter, self._settings, self._autostart = adapter, settings, form.autostart
        self._change_bench, self.demo_requested = change_bench, False
        self.replaced = False
        """Another window with another bench takes the place of this one, which stays visible until then."""
        self._force_close = self._session_closed = self._connect_started = False
        state = initial_window_state(
            config.amplifier.amplifier_map, config.name, config.simulated, _instrument_names(config)
        )
        self.controller = SessionController(adapter, replace(state, connecting_since_s=time.monotonic()), self)
        self.look = WindowLook(self, settings)
        self.ribbon = BenchRibbon(config.name, config.simulated, adapter.simulation)
        self.strip = BenchStrip(self.controller)
        settable = adapter.simulation
        controls = None if settable is None else SimulationControls(settable, self.controller.change_speed)
        self.faults = FaultDrawer(adapter.faults, self, controls) if config.simulated else None
        self._faults = () if self.faults is None else (self.faults,)
        self.tabs = MainTabs(form.protocol, self.controller, config, settings, open_bench)
        self.measure_page, self.overlay = self.tabs.measure, self.tabs.overlay
        self.central, self.rail = CentralStack(self.tabs), Rail(TITLES)
        self.notices = Notices(self.controller, self, self.central)
        self.log, self.status_line = LogDrawer(), WindowStatusLine()
        self.notifier = Notifier(self, settings)
        self.remote = RemoteController(settings, adapter, self.tabs.subject.describe_next, self)
        self._build(config.name)
        self._restore(form)
        self._show_state()
        self.heartbeat = Heartbeat(self, self.tick, self._is_moving)
        adapter.on_event = self.heartbeat.wake
        QTimer.singleShot(HIDDEN_CONNECT_DELAY_MS, self, self._start_connecting)

    # -- commands ---------------------------------------------------------------------------------------

    def start_run(self) -> None:
        """Start the campaign's next item if its page is visible, else a run of the form, if one can begin."""
        self.central.show_pages()
        if self.tabs.currentIndex() == CAMPAIGN:
            self.tabs.campaign.run()
        elif (protocol := self.measure_page.run_panel.protocol) is not None and self.measure_page.run_panel.can_start:
            self.tabs.start_run(protocol)
        else:
            # A key that does nothing looks like a broken program.
            self.tabs.show_message(
                f"Not started: {self.state.blocked_reason or 'the form has a fault, which is marked'}."
            )

    def escape(self) -> None:
        """Stop from arming until rest is measured; otherwise close what lies on top, or go one step back."""
        if self.state.busy or stops_by_escape(self.state.bench_state):
            self.controller.stop()
        else:
            self.central.go_back()

    def toggle_log(self) -> None:
        """Open the log, or close it."""
        if self.log.isHidden():
            self.status_line.acknowledge()
            self.log.open(self.log.view)
        else:
            self.log.dismiss()

    def start_demo(self) -> None:
        """Run a sine dwell on the simulated bench with hints for first-time users."""
        if not self.state.simulated:
            self.demo_requested = True
            self.change_bench("sim")
            return
        self.central.show_pages()
        self.tabs.setCurrentIndex(MEASURE)
        self.measure_page.run_panel.set_protocol(build_protocol(PROTOCOLS[DEFAULT_PROTOCOL], {}))
        self.central.hint.start()
        self._autostart = True

    def change_bench(self, name: str) -> None:
        """Release this bench and open another: a bench file, or the simulated one."""
        if self.state.busy or self._change_bench is None:
            problem = "A run is in progress: wait for its end, or stop it, first." if self.state.busy else ""
        else:
            try:
                self._change_bench(name)
            except ConfigError as error:
                problem = str(error)
            else:
                self.replaced = True
                self.close_session()
                return
        self.central.welcome.message_label.show_message(problem, is_error=True)
        if BENCH in self.tabs.created_pages:
            self.tabs.bench.show_message(problem)

    def close_session(self, force: bool = False) -> None:
        """Go to rest, release the bench and close. `force` closes even with an unacknowledged unsafe message."""
        self._force_close = self._force_close or force
        self.controller.close()
        self.notices.show_closing()

    # -- events --------------------------------------------------------------------------------------------------

    def tick(self) -> None:
        """Process the events since the last tick and refresh moving displays."""
        self.controller.process_events()
        view = self.state
        self.remote.beat()
        self.tabs.set_active_file(getattr(self.adapter.session, "path", None) if view.busy else None)
        self.notices.tick()
        self.strip.tick()
        if self.strip.view is not None:
            self.status_line.show_answers(self.strip.view.instruments)
        self.ribbon.tick()
        self.tabs.tick()
        if self._autostart and view.can_run:
            self._autostart = False
            self.start_run()
        if self.controller.closing and self.controller.released:
            self._close_if_acknowledged()

    def _is_moving(self) -> bool:
        """Whether every frame is drawn: in a run, and until the bench is connected."""
        return self.state.busy or self.controller.closing or self.state.bench_state is BenchState.CONNECTING

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        if not self._connect_started:
            QTimer.singleShot(0, self, self._start_connecting)  # when everything is painted

    def _start_connecting(self) -> None:
        """Connect and compute the model curve, after the first paint; an invisible window connects as well."""
        if not self._connect_started and not self.controller.closing:
            self._connect_started = True
            self.measure_page.start_model_curve()
            self.adapter.session.start()
            folder = self.tabs.folder
            self.tabs.run_in_background(lambda: self.adapter.publish(unreported_watchdog_messages(folder)))
            self.tabs.preload_pages()  # while the bench connects, so that no page has to be waited for

    def _problem_facts(self) -> "tuple[ProblemFacts, RecentErrors]":
        from app.archive import ProblemFacts  # imports HDF5, which a background thread has loaded

        settings, outcome = self._settings, self.state.outcome
        values = {key: settings.value(key) for key in settings.allKeys()}
        facts = ProblemFacts(
            log=[
                f"{line.time.isoformat(timespec='seconds')} {line.severity}: {line.text}"
                for line in self.state.messages
            ],
            settings={key: str(value) for key, value in values.items() if not isinstance(value, QByteArray)},
            bench=self._open_bench,
            run=Path(outcome.path) if outcome is not None and outcome.path else None,
            folder=self.tabs.folder,
        )
        return facts, self._recent_errors

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._key_bursts.watch()
        self.heartbeat.watch()
        if self.focusWidget() is None:  # otherwise the ribbon, the first in the order of Tab, would take the keyboard
            self.central.setFocus()

    def closeEvent(self, event: QCloseEvent) -> None:
        if self._session_closed:
            self._save()
            end_all(self)
            if self.replaced:
                event.ignore()
                QApplication.exit()
            else:
                event.accept()
            return
        event.ignore()
        if self.controller.closing:
            return
        if self.state.busy or self.state.unsafe:
            self.notices.ask_to_close(self.state)
        else:
            self.close_session()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Apply the keys that copy and save a plot, which no focused plot has taken, to the largest visible one."""
        keys = QKeySequence(event.keyCombination())
        wanted = [name for name in FILES_OF_PLOTS if keys in map(QKeySequence, ACTIONS[name].shortcuts)]
        if not wanted:
            super().keyPressEvent(event)
            return
        plots = [plot for plot in self.findChildren(QGraphicsView) if plot.isVisible()]
        plots.sort(key=lambda plot: -plot.width() * plot.height())
        found = [action for plot in plots for info, action in actions_of([plot]) if info.id in wanted]
        if found:
            found[0].trigger()
        else:
            tell(self, "There is no plot on this page")

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.rail.fit()

    def event(self, event: QEvent) -> bool:
        if isinstance(event, Told):
            line = LogLine(datetime.now().astimezone(), event.severity, event.text)
            self.status_line.show_line(line, event.undo)
            return True
        return super().event(event)

    def _close_if_acknowledged(self) -> None:
        """Close after the session has ended, unless the operator must first acknowledge that rest is not confirmed."""
        if self.state.unsafe and not self._force_close:
            self.notices.show_unsafe_exit()
            return
        self._session_closed = True
        self.close()

    def _show_state(self) -> None:
        update_actions(self, self.state)
        for sign in (self.strip, self.notices, self.status_line, self.log):
            sign.set_state(self.state)
        for part in (self.central, self.tabs, self.notifier, self.remote, *self._faults):
            part.set_state(self.state)

    @property
    def state(self) -> WindowState:
        """The displayed window state."""
        return self.controller.state

    # -- building ------------------------------------------------------------------------------------------------------

    def _build(self, bench: str) -> None:
        self.setWindowTitle(f"Tactor Bench – {bench}")
        for overlay in (*self._faults, self.log):
            self.central.add_overlay(overlay)
        self.menus = MainMenus(self, self.central, self.look.set_appearance)
        menu_line, content = QWidget(), TabOrder()
        row(self.menus.bar, (self.ribbon, 1), parent=menu_line, spacing=0)
        set_length(menu_line, height=MENU_HEIGHT)
        body = row(self.rail, (self.central, 1), spacing=0)
        column(menu_line, self.strip, (body, 1), self.status_line, parent=content, spacing=0)
        self.setCentralWidget(content)
        self.rail.chosen.connect(self.central.select_page)
        self.rail.help_requested.connect(self.central.show_shortcuts)
        self.tabs.page_selected.connect(self.rail.select)
        self.rail.select(self.tabs.currentIndex())
        self.look.text_size_changed.connect(self.rail.fit)
        for drawer in self._faults:
            drawer.faults_changed.connect(self.ribbon.show_faults)
            self.ribbon.clicked.connect(drawer.toggle)
        self.status_line.log_requested.connect(self.toggle_log)
        self._key_bursts = KeyBurstFilter(self)
        self.controller.changed.connect(self._show_state)
        self.notices.close_confirmed.connect(self.close_session)
        self.measure_page.run_panel.run_pressed.connect(self.start_run)
        self.measure_page.live_pane.repeat_requested.connect(self.tabs.repeat_entries)
        self.central.welcome.demo_requested.connect(self.start_demo)
        self.central.bench_chosen.connect(self.change_bench)
        self.tabs.bench_chosen.connect(self.change_bench)
        self.central.palette_entries, self.central.settings = self.menus.palette_entries, partial(_make_settings, self)
        self.central.problem_facts = self._problem_facts
        self.error_occurred.connect(lambda: self.tabs.show_message(ERROR_TEXT))
        add_actions(
            self,
            {
                "escape": self.escape,
                "stop": self.controller.stop,
                "run": self.start_run,
                "pause": self.controller.toggle_pause,
                "log": self.toggle_log,
            },
        )

    def _restore(self, form: InitialForm) -> None:
        geometry = self._settings.value("window/geometry")
        if not (isinstance(geometry, QByteArray) and self.restoreGeometry(geometry)):
            self.resize(px(1280), px(720))
        self.resize(self.size().boundedTo(self.screen().availableSize() - FRAME_SIZE))
        self.central.tutorial.resume(str(self._settings.value("help/tutorial", "")))
        # Show the Measure page if a protocol was given or is started.
        requested = self._autostart or self.measure_page.run_panel.protocol != build_protocol(
            PROTOCOLS[DEFAULT_PROTOCOL], {}
        )
        self.tabs.restore_state(form.folder, form.specimen, requested)

    def _save(self) -> None:
        self._settings.setValue("window/geometry", self.saveGeometry())
        self._settings.setValue("help/tutorial", self.central.tutorial.position)
        self.tabs.save_state()
        self._settings.sync()


def _instrument_names(config: BenchConfig) -> dict[str, str]:
    """Return the instruments' names in the bench file, by role."""
    generator, card = config.generator, config.card
    return {
        "generator": generator.resource or generator.driver,
        "amplifier": config.amplifier.name,
        "card": card.device,
        "sensor": config.sensor.name,
    }


def _make_settings(window: MainWindow) -> "list[Setting]":
    """Return the settings of a window for its settings page; folder and specimen are not changed during a run."""
    from app.gui.help import Setting
    from app.gui.remote import DESCRIPTION, RemoteSetting

    panel, notifier = window.measure_page.run_panel, window.notifier
    choices = ((text, name) for name, text in APPEARANCES.items())
    appearance = make_combo("settings.appearance", "", choices)
    appearance.setCurrentIndex(max(appearance.findData(window.look.appearance), 0))
    appearance.currentIndexChanged.connect(lambda _: window.look.set_appearance(appearance.currentData()))
    sizes = ((f"{name} %" if name.isdigit() else "by the screen", name) for name in TEXT_SIZES)
    text_size = make_combo("settings.text-size", "", sizes)
    text_size.setCurrentIndex(max(text_size.findData(window.look.text_size), 0))
    text_size.currentIndexChanged.connect(lambda _: window.look.set_text_size(text_size.currentData()))
    fields = []
    for name, edit in (("folder", panel.folder_edit), ("specimen", panel.specimen_edit)):
        copy = configure(QLineEdit(edit.text()), f"settings.{name}")
        copy.editingFinished.connect(lambda copy=copy, edit=edit: window.state.busy or edit.setText(copy.text()))
        edit.textChanged.connect(copy.setText)
        fields.append(copy)
    notifications = []
    for key, title, about in NOTIFICATIONS:
        box = configure(QCheckBox("on"), f"settings.{key}", checked=notifier.is_on(key))
        box.toggled.connect(lambda on, key=key: notifier.switch(key, on))
        notifications.append(Setting(title, box, about))
    return [
        Setting("Appearance", appearance, "Light colours, dark colours, or the system's"),
        Setting("Text size", text_size, "Of texts, heights and spacing; never larger than the screen can hold"),
        Setting("Folder for run files", fields[0], "Where runs are written, and which runs are listed"),
        Setting("Specimen", fields[1], "Name that is written into new runs"),
        *notifications,
        Setting("Web page", RemoteSetting(window.remote), DESCRIPTION),
    ]
