"""The Campaign page: begin or open a campaign, carry it through, and see each run while it goes on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QSettings, Signal
from PySide6.QtWidgets import QSizePolicy, QStackedWidget

from app.gui.campaign.board import CampaignBoard
from app.gui.campaign.controller import CampaignDesk
from app.gui.campaign.start import CampaignStart
from app.gui.plots.live_pane import LivePane
from app.gui.widgets.file_dialog import ask_for_files
from app.gui.widgets.shortcuts import HERE, bind
from app.gui.widgets.theme import Theme
from app.live.feed import LiveFeed
from app.live.overlay import Overlay, Question, question_of
from app.session.state import View
from model.parameter_spec import ParameterError
from protocols.base.events import Status

if TYPE_CHECKING:
    from app.campaign.queue import Conductor, Order


class CampaignPage(QStackedWidget):
    """One page of the window: where a campaign is begun or opened, and in its place the one that is open.

    Args:
        desk: the open campaign, and all that touches its files.
        where: folder and specimen of the Measure page, for a new campaign.
    """

    title = "Campaign"
    open_asked = Signal(object)
    """Path of a run that shall be opened on the Runs page."""

    def __init__(
        self, desk: CampaignDesk, feed: LiveFeed, overlay: Overlay, where: Callable[[], tuple[Path, str]], theme: Theme
    ) -> None:
        super().__init__()
        self.desk, self._where, self._feed = desk, where, feed
        self._overlay = Overlay(amplifier=overlay.amplifier)
        self._question: Question | None = None
        self._view: View | None = None
        self._busy = False
        self._offered: Path | None = None
        self._shown: Path | None = None
        self.start = CampaignStart()
        self.board = CampaignBoard(LivePane(feed, overlay.amplifier, theme), theme)
        for part in (self.start, self.board):
            part.setSizePolicy(
                QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored
            )  # the Measure page tells the least
            self.addWidget(part)
        self._connect()

    # -- what the window does with a page ------------------------------------------------------------------------------

    def show_view(self, view: View) -> None:
        """A run that ended is news, whoever began it."""
        ended, connected = self._busy and not view.busy, self._view is None or self._view.connected
        self._view, self._busy = view, view.busy
        if ended:
            self.desk.ended(view.outcome is not None and view.outcome.status is Status.COMPLETED)
        elif view.connected and not connected:
            self.desk.look()  # now there is a bench to rehearse with
        self._show()

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.board.set_theme(theme)

    def enter(self) -> None:
        """Take the keyboard."""
        self._come(self.start if self.currentIndex() == 0 else self.board)

    def refresh(self) -> None:
        """Called at every tick while the page is seen."""
        folder, _ = self._where()
        if folder != self._offered:
            self._offered = folder
            self.desk.offer(folder)
        if not self._busy:
            return
        if self.desk.sheet is not None and self._view is not None:
            self.board.head.show_progress(self.desk.sheet, self.desk.running, self._view, self._feed.streamed_s)
        self.board.live.refresh()
        if self._question is None:
            return
        self._overlay.ask(self._question)
        try:
            curve = self._overlay.ready()
        except ParameterError:  # the model cannot answer this: there is no curve, and nothing else
            return
        if curve is not None:
            self.board.live.show_curve(curve)

    def end(self) -> None:
        """End what works beside the window."""
        self.desk.end()
        self._overlay.close()

    def save(self, settings: QSettings) -> None:
        """Remember which campaigns were open."""
        settings.setValue("campaign/recent", [str(path) for path in self.desk.recent])
        settings.setValue("campaign/open", str(self.desk.recent[0]) if self.desk.sheet is not None else "")

    def restore(self, settings: QSettings) -> None:
        """Open the campaign that was open."""
        kept = settings.value("campaign/recent", [])
        self.desk.recent = [Path(str(path)) for path in (kept if isinstance(kept, list) else [kept]) if path]
        if path := str(settings.value("campaign/open", "")):
            self.desk.open(Path(path))

    def back(self) -> None:
        """From beginning another one to the one that is open."""
        if self.desk.sheet is not None:
            self._come(self.board)

    # -- what a person wants -------------------------------------------------------------------------------------------

    def run(self, name: str = "", hands_free: bool = False) -> None:
        """Begin what comes next, or the item that is named; `hands_free` goes on with what needs no hands."""
        view = self._view
        if self.currentWidget() is self.board and view is not None:
            self._say("")
            if view.why_not:
                self._say(f"No run can begin: {view.why_not}.")
            else:
                self.desk.run(name, hands_free, view.simulated)

    def begun(self, order: Order) -> Conductor:
        """An order is about to be carried out: show what belongs to it; the conductor that gives it to the session."""
        self._question = question_of(order.protocol, order.folder, order.specimen)
        return self.desk.begun(order)

    def act(self, what: str, name: str = "") -> None:
        """Do one of the things that buttons and keys stand for, with an item; without one, with what comes next."""
        row = self.desk.sheet.row(name) if self.desk.sheet is not None else None
        self._say("")
        match what:
            case "run":
                self.run(name)
            case "run without hands":
                self.run(hands_free=True)
            case "halt the queue":
                self.desk.halt()
            case "open" if row is not None and row.line.run is not None:
                self.open_asked.emit(row.line.run)
            case _ if row is None or self._busy:
                return
            case "skip":
                why = "" if row.line.standing == "skipped" else "skipped"
                self.desk.change(lambda campaign: campaign.skip(row.name, why))
            case "accept" if row.pending:
                self.desk.change(lambda campaign: campaign.accept(row.name))
            case "repeat" | "reject" if row.line.run is not None:
                self.desk.change(lambda campaign: getattr(campaign, what)(row.name))

    def open(self, path: Path) -> None:
        """Open a campaign's file."""
        if self.desk.sheet is not None and path.absolute() == self.desk.sheet.path.absolute():
            self.back()
        elif not self._busy:
            self._say("")
            self.desk.open(path)

    def begin(self, specimen: str) -> None:
        """Begin a campaign beside the runs of the Measure page."""
        if self._view is not None and not self._busy:
            self._say("")
            self.desk.new(self._where()[0], specimen, self._view.simulated)

    # -- inside --------------------------------------------------------------------------------------------------------

    def _show(self) -> None:
        view, sheet = self._view, self.desk.sheet
        if view is None:
            return
        folder, specimen = self._where()
        self.start.offer(self.desk.offered, folder, specimen, view.simulated)
        if sheet is not None:
            self.board.show_sheet(sheet, self.desk.known, view, self.desk.running, self.desk.queue)
            self.board.head.show_progress(sheet, self.desk.running, view, self._feed.streamed_s)

    def _changed(self) -> None:
        """The desk has news."""
        self._show()
        sheet = self.desk.sheet
        if sheet is not None and sheet.path != self._shown:
            self._shown = sheet.path
            self._come(self.board)

    def _come(self, part: CampaignBoard | CampaignStart) -> None:
        """Show one of the two, and give it the keyboard where this page has it."""
        self.setCurrentWidget(part)
        if self.isVisible():
            (self.board.list if part is self.board else self.start.specimen).setFocus()

    def _say(self, words: str) -> None:
        self.board.head.say(words)
        self.start.say(words)

    def _another(self) -> None:
        if not self._busy:
            self.desk.offer(self._where()[0])
            self._come(self.start)

    def _browse(self) -> None:
        folder, _ = self._where()
        ask_for_files(
            self, "Open a campaign", lambda paths: self.open(paths[0]), "Campaigns (*.campaign.json)", str(folder)
        )

    def _queue(self) -> None:
        self.act("halt the queue" if self._busy else "run without hands")

    def _connect(self) -> None:
        self.desk.changed.connect(self._changed)
        self.desk.said.connect(self._say)
        self.start.begun.connect(self.begin)
        self.start.opened.connect(self.open)
        self.start.browse_pressed.connect(self._browse)
        self.board.head.another_pressed.connect(self._another)
        self.board.head.open_pressed.connect(self._browse)
        self.board.wanted.connect(self.act)
        self.board.moved.connect(lambda name, before: self.desk.change(lambda campaign: campaign.move(name, before)))
        for words, do, keys in (
            ("Run what needs no hands, one after the other; or end with the present one", self._queue, ("Ctrl+F5",)),
            ("Undo", lambda: self.desk.change(lambda campaign: campaign.undo()), ("Ctrl+Z",)),
            ("Redo", lambda: self.desk.change(lambda campaign: campaign.redo()), ("Ctrl+Shift+Z", "Ctrl+Y")),
            ("Begin another campaign", self._another, ("Ctrl+N",)),
            ("Open a campaign", self._browse, ("Ctrl+O",)),
        ):
            bind(self, words, do, *keys, context=HERE)
