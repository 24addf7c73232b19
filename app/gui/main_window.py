"""The main window: bench bar, notices and pages over one session; a timer carries what happened onto the screen."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QByteArray, QSettings, Qt, QTimer
from PySide6.QtGui import QCloseEvent, QGuiApplication, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QApplication, QMainWindow, QVBoxLayout, QWidget

from app.config.bench_file import BenchConfig, ConfigError
from app.gui.bench.fault_panel import FaultPanel
from app.gui.bench.notices import Notices
from app.gui.bench.status_bar import BenchBar
from app.gui.main_window_stack import Room
from app.gui.session_controller import Helm
from app.gui.tabs import CAMPAIGN, MEASURE, Book
from app.gui.widgets.shortcuts import bind
from app.gui.widgets.theme import Theme, sheet, system_theme
from app.live.session_link import Link
from app.session.session import watchdog_notes
from app.session.state import View, opening
from protocols.base.protocol import Protocol
from protocols.measurements.sine_dwell import SineDwell

if TYPE_CHECKING:
    from app.campaign.queue import Order
    from app.gui.campaign.page import CampaignPage
    from app.gui.explore.page import ExplorePage
    from app.gui.runs.page import RunsPage

FRAME_MS = 16
UNSEEN_MS = 500
"""After this long a window that was not painted, because nobody sees it, connects all the same."""


class MainWindow(QMainWindow):
    """Shows what a session tells and carries the operator's wishes to it.

    Closing goes to rest first: the window stays, alive, until the session has let go of the bench.
    """

    def __init__(
        self,
        link: Link,
        config: BenchConfig,
        protocol: Protocol,
        folder: Path | None,
        specimen: str | None,
        settings: QSettings,
        autostart: bool = False,
        change_bench: Callable[[str], object] | None = None,
    ) -> None:
        super().__init__()
        self.link, self._settings, self._autostart = link, settings, autostart
        self._change_bench, self.trying = change_bench, False
        self._at_once = self._gone = self._opened = False
        self.helm = Helm(link, opening(config.amplifier.map, config.name, config.simulated, _names(config)), self)
        self.theme = system_theme()
        self.bar = BenchBar(self.theme)
        self.notices = Notices(self)
        self.faults = FaultPanel(link.faults, self) if config.simulated else None
        self.pages = Book(protocol, link, config, settings, self.theme)
        self.measure, self.overlay = self.pages.measure, self.pages.overlay
        self.room = Room(self.pages)
        self._build(config.name)
        self._connect_keys()
        self._restore(folder, specimen)
        self.set_theme(self.theme)
        self._show()
        QGuiApplication.styleHints().colorSchemeChanged.connect(self._follow_system)
        self._timer = QTimer(self, interval=FRAME_MS, timerType=Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self.tick)
        self._timer.start()
        QTimer.singleShot(UNSEEN_MS, self, self._open)

    # -- what the operator wants ---------------------------------------------------------------------------------------

    def run(self) -> None:
        """Begin what the campaign has next where that is seen, else a run with what the form says, if it may begin."""
        self.room.uncover()
        if self.pages.currentIndex() == CAMPAIGN:
            self.campaign.run()
        elif (protocol := self.measure.panel.protocol) is not None and self.measure.panel.ready:
            self.helm.run(protocol, self.pages.folder, self.pages.specimen)

    def carry_out(self, order: "Order") -> None:
        """Begin a run of the campaign, if it may still begin."""
        if self.helm.ready:
            self.helm.carry_out(order, self.campaign.begun(order))

    def escape(self) -> None:
        """Stop, always; where nothing runs the page seen goes a step back besides."""
        idle = not self.view.busy
        self.helm.stop()
        if idle and not (self.faults is not None and self.faults.close_list()):
            self.room.back()

    def try_it(self) -> None:
        """A sine dwell on the simulated bench, from its first volt to its file, with a line that says what is seen."""
        if not self.view.simulated:
            self.trying = True
            self.change_bench("sim")
            return
        self.room.uncover()
        self.pages.setCurrentIndex(MEASURE)
        self.measure.panel.fill(SineDwell())
        self.room.hint.begin()
        self._autostart = True

    def change_bench(self, name: str) -> None:
        """Let go of this bench and open another: a bench file, or the simulated one."""
        if self.view.busy or self._change_bench is None:
            self.room.first.say("A run is going on: let it end, or stop it, first." if self.view.busy else "")
            return
        try:
            self._change_bench(name)
        except ConfigError as error:
            self.room.first.say(str(error))
            return
        self.leave()

    def leave(self, at_once: bool = False) -> None:
        """Go to rest, let go of the bench, close. `at_once` closes even over an unsafe sentence nobody has read."""
        self._at_once = self._at_once or at_once
        self.helm.leave()
        self.notices.leaving()

    # -- what happens --------------------------------------------------------------------------------------------------

    def tick(self) -> None:
        """Carry what happened since the last tick onto the screen."""
        self.helm.hear()
        view = self.view
        self.pages.writing(getattr(self.link.session, "path", None) if view.busy else None)
        # The runner asks after it has told.
        self.notices.show_prompt(view.prompt, self.link.mailbox.waiting, self.link.feed.latest_um)
        if view.busy:
            self.bar.show_progress(self.link.feed.streamed_s)
        self.pages.refresh()
        if self._autostart and view.can_run:
            self._autostart = False
            self.run()
        if self.helm.leaving and self.link.session.close(0.0):
            self._leave_if_read()

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        if not self._opened:
            QTimer.singleShot(0, self, self._open)  # when everything is painted

    def _open(self) -> None:
        """Connect, and compute the curve. Either would hold up the first paint; a window nobody sees connects as well."""
        if not self._opened and not self.helm.leaving:
            self._opened = True
            self.measure.begin()
            self.link.session.start()
            folder = self.pages.folder
            self.pages.beside(lambda: self.link.tell(watchdog_notes(folder)))
            self.pages.make_ahead()  # while the bench connects, so that looking at one is no wait

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.theme = theme
        QApplication.setPalette(theme.palette())
        self.setStyleSheet(sheet(theme))
        self.bar.set_theme(theme)
        self.pages.set_theme(theme)

    def closeEvent(self, event: QCloseEvent) -> None:
        if self._gone:
            self._timer.stop()
            self._save()
            self.pages.end()
            if self.faults is not None:
                self.faults.end()
            event.accept()
            return
        event.ignore()
        if self.helm.leaving:
            return
        if self.view.busy or self.view.unsafe:
            self.notices.ask_to_close(self.view)
        else:
            self.leave()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.bar.set_size(self.size())
        if (outer := self.bar.parentWidget()) is not None and (layout := outer.layout()) is not None:
            layout.activate()  # at once: what is below shall not stand in the signs for a frame

    def _leave_if_read(self) -> None:
        """The session has ended: close, unless a person must first read that the bench is not at rest."""
        if self.view.unsafe and not self._at_once:
            self.notices.left_unsafe()
            return
        self._gone = True
        self.close()

    def _show(self) -> None:
        self.bar.show_view(self.view)
        self.notices.show_view(self.view)
        self.notices.show_prompt(self.view.prompt, self.link.mailbox.waiting)
        self.room.hint.show_view(self.view)
        self.pages.show_view(self.view)
        if self.faults is not None:
            self.faults.show_view(self.view)

    @property
    def view(self) -> View:
        """What is shown."""
        return self.helm.view

    @property
    def campaign(self) -> "CampaignPage":
        """The page about the measurements of one specimen, made by now."""
        return self.pages.campaign

    @property
    def explore(self) -> "ExplorePage":
        """The page about the model, made by now."""
        return self.pages.explore

    @property
    def runs(self) -> "RunsPage":
        """The page about the runs of the folder, made by now."""
        return self.pages.runs

    # -- building ------------------------------------------------------------------------------------------------------

    def _build(self, bench: str) -> None:
        self.setWindowTitle(f"Tactor Bench – {bench}")
        centre = QWidget()
        layout = QVBoxLayout(centre)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(6)
        layout.addWidget(self.bar)
        if self.faults is not None:
            layout.addWidget(self.faults)
            self.pages.setCornerWidget(self.faults.corner)
        layout.addWidget(self.notices)
        layout.addWidget(self.room, 1)
        self.setCentralWidget(centre)
        self.helm.changed.connect(self._show)
        self.bar.stop_pressed.connect(self.helm.stop)
        self.bar.pause_pressed.connect(self.helm.pause)
        self.measure.panel.run_pressed.connect(self.run)
        self.measure.again_pressed.connect(lambda entries: self.helm.measure_again(entries, self.pages.folder))
        self.pages.ordered.connect(self.carry_out)
        self.room.try_pressed.connect(self.try_it)
        self.room.bench_chosen.connect(self.change_bench)
        for wish, do in (
            (self.notices.answered, self.helm.answer),
            (self.notices.stop_pressed, self.helm.stop),
            (self.notices.acknowledged, self.helm.acknowledge),
            (self.notices.connect_pressed, self.helm.connect_again),
            (self.notices.leave_pressed, self.leave),
            (self.notices.stay_pressed, self.notices.stay),
        ):
            wish.connect(do)

    def _connect_keys(self) -> None:
        bind(self, "Stop: go to rest and end the run; else a step back", self.escape, Qt.Key.Key_Escape)
        bind(self, "Stop: go to rest and end the run", self.helm.stop, Qt.Key.Key_F12)
        bind(self, "Run what the page shows", self.run, Qt.Key.Key_F5, "Ctrl+R")
        bind(self, "Pause at rest, or go on", self.helm.pause, Qt.Key.Key_F8)

    def _restore(self, folder: Path | None, specimen: str | None) -> None:
        geometry = self._settings.value("window/geometry")
        if not (isinstance(geometry, QByteArray) and self.restoreGeometry(geometry)):
            self.resize(1280, 720)
        # Who asks for a protocol, or starts one, wants to see it.
        asked = self._autostart or self.measure.panel.protocol != SineDwell()
        self.pages.restore(folder, specimen, asked)

    def _save(self) -> None:
        self._settings.setValue("window/geometry", self.saveGeometry())
        self.pages.save()
        self._settings.sync()

    def _follow_system(self, *_: object) -> None:
        self.set_theme(system_theme())


def _names(config: BenchConfig) -> dict[str, str]:
    """Instruments by role, as the bench file names them."""
    generator, card = config.generator, config.card
    return {
        "generator": generator.resource or generator.driver,
        "amplifier": config.amplifier.name,
        "card": card.device,
        "sensor": config.sensor.name,
    }
