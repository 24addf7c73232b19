"""Campaign page: creates or opens a campaign, runs its items and shows each run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QSettings, Signal
from PySide6.QtWidgets import QSizePolicy, QStackedWidget, QWidget

from app.gui.campaign.add_item import AddItemPane
from app.gui.campaign.board import CampaignBoard
from app.gui.campaign.controller import CampaignController
from app.gui.campaign.start import CampaignStart
from app.gui.plots import LivePane
from app.gui.widgets import add_actions, at_end, choose_file, tell
from app.live import CurveRequest, LiveFeed, Overlay, curve_request_for, curve_request_of
from app.session import WindowState

if TYPE_CHECKING:
    from app.campaign import CampaignItem, CampaignRunner, ItemSummary, ResultReview
    from protocols.runner import RunRequest


class CampaignPage(QStackedWidget):
    """The start pane, or in its place the open campaign.

    Args:
        controller: opens and modifies the campaign.
        location: folder and specimen of the Measure page, for a new campaign.
    """

    title = "Campaign"
    run_open_requested = Signal(object)
    """Path of a run to open on the Runs page."""
    explore_requested = Signal(object)
    """Path of a run to overlay on the model."""

    def __init__(
        self, controller: CampaignController, feed: LiveFeed, overlay: Overlay, location: Callable[[], tuple[Path, str]]
    ) -> None:
        super().__init__()
        self.controller, self._location, self._feed = controller, location, feed
        self._overlay = Overlay(overlay.amplifier, overlay.cache)
        at_end(self, self._overlay.close)
        self._request: CurveRequest | None = None
        self._state: WindowState | None = None
        self._busy = False
        self._searched_folder: Path | None = None
        self._shown_path: Path | None = None
        self._review_request: CurveRequest | None = None
        self._reviewed: tuple[Path, Path | None] | None = None
        self.start_pane = CampaignStart(self._choose_campaign_file)
        self.board = CampaignBoard(LivePane(feed, overlay.amplifier))
        self.add_pane: AddItemPane | None = None
        """Made when it is needed."""
        self._added = ""
        """Name of the item that was added and is to be selected."""
        for part in (self.start_pane, self.board):
            self.addWidget(part)
        self._connect_signals()

    # -- interface to the main window ----------------------------------------------------------------------------------

    def set_state(self, view: WindowState) -> None:
        """Show a window state; refresh after any run ends."""
        ended, connected = self._busy and not view.busy, self._state is None or self._state.connected
        self._state, self._busy = view, view.busy
        if ended:
            self._show_message("")  # such as that a run was in progress
            self.controller.run_ended(view.outcome is not None and view.outcome.verdict.outcome.has_result)
        elif view.connected and not connected:
            self.controller.refresh()  # now there is a bench to rehearse with
        self._show_campaign()

    def activate(self) -> None:
        self._show_part(self.currentWidget() or self.board)

    def tick(self) -> None:
        """Refresh values that change between events; called at every tick while the page is visible."""
        folder, _ = self._location()
        if folder != self._searched_folder:
            self._searched_folder = folder
            self.controller.find_campaigns(folder)
        request = self._request if self._busy else self._review_request
        if self._busy:
            if self.controller.summary is not None and self._state is not None:
                self.board.header.show_progress(
                    self.controller.summary, self.controller.running_item, self._state, self._feed.streamed_s
                )
            self.board.live_pane.tick()
        if request is None:
            return
        self._overlay.submit(request)
        if (curve := self._overlay.result()) is not None:
            (self.board.live_pane if self._busy else self.board.details.plots).show_model_curve(curve)

    def save_state(self, settings: QSettings) -> None:
        """Store the recent campaigns and the open one."""
        settings.setValue("campaign/recent", [str(path) for path in self.controller.recent])
        settings.setValue(
            "campaign/open", str(self.controller.recent[0]) if self.controller.summary is not None else ""
        )

    def restore_state(self, settings: QSettings) -> None:
        """Restore the recent campaigns and reopen the open one."""
        kept = settings.value("campaign/recent", [])
        self.controller.recent = [Path(str(path)) for path in (kept if isinstance(kept, list) else [kept]) if path]
        if path := str(settings.value("campaign/open", "")):
            self.controller.open(Path(path))

    def set_active_file(self, path: Path | None) -> None:
        self.controller.active_file = path

    def go_back(self) -> None:
        """Return from another pane to the open campaign."""
        if self.controller.summary is not None:
            self._show_part(self.board)

    # -- commands -------------------------------------------------------------------------------------------

    def run(self, name: str = "", hands_free: bool = False) -> None:
        """Start the next item or the named one; `hands_free` continues with items that need no operator."""
        view = self._state
        if self.currentWidget() is self.board and view is not None:
            self._show_message("")
            if view.blocked_reason:
                self._show_message(f"No run can begin: {view.blocked_reason}.")
            else:
                self.controller.run(name, hands_free, view.simulated)

    def accept_run(self, request: RunRequest) -> CampaignRunner:
        """Show the model curve of a run about to start, and return the runner that submits it."""
        self._request = curve_request_for(request.protocol, request.folder, request.specimen)
        return self.controller.accept_run(request)

    def perform_action(self, action: str, item_name: str = "") -> None:
        """Perform the action of a button or shortcut on an item; without one, on the next item."""
        row = self.controller.summary.item(item_name) if self.controller.summary is not None else None
        self._show_message("")
        match action:
            case "run":
                self.run(item_name)
            case "run without hands":
                self.run(hands_free=True)
            case "halt the queue":
                self.controller.halt_queue()
            case "open" | "explore" if row is not None and row.state.run is not None:
                signal = self.run_open_requested if action == "open" else self.explore_requested
                signal.emit(self.board.details.reviewed_path or row.state.run)
            case _ if row is not None and not self._busy:
                self._change_item(action, row)

    def _change_item(self, action: str, row: ItemSummary) -> None:
        """Skip, accept, repeat or reject an item, if its state allows that."""
        name, state, modify = row.name, row.state, self.controller.modify
        match action:
            case "skip":
                why = "" if state.status == "skipped" else "skipped"
                modify(lambda plan: plan.skip(name, why), f"{name} is {why or 'included again'}")
            case "accept" if run := self.board.run_to_accept(row):
                modify(lambda plan: plan.accept(name, run), f"{name} is accepted")
            case "repeat" if state.run is not None:
                kept = "; its result counts until a new one is accepted" if state.estimates else ""
                modify(lambda plan: plan.repeat(name), f"{name} is to be measured again{kept}")
            case "reject" if state.run is not None:
                rejected = state.reviewed_run.name if state.reviewed_run else "the run"
                modify(lambda plan: plan.reject(name), f"{name}: {rejected} is rejected")

    def _read_review(self) -> None:
        """Read the run under review unless it is shown or being read."""
        path, before = self.board.details.reviewed_path, self.board.details.earlier_path
        if path is None or self._reviewed == (path, before):
            return
        self._reviewed = (path, before)
        self.controller.review(path, before)

    def _show_review(self, review: ResultReview) -> None:
        self.board.show_review(review)
        self._review_request = curve_request_of(review.run)

    def open(self, path: Path) -> None:
        if self.controller.summary is not None and path.absolute() == self.controller.summary.path.absolute():
            self.go_back()
        elif not self._busy:
            self._show_message("")
            self.controller.open(path)

    def create_campaign(self, specimen: str) -> None:
        """Create a campaign in the folder of the Measure page."""
        if self._state is not None and not self._busy:
            self._show_message("")
            self.controller.create(self._location()[0], specimen, self._state.simulated)

    # -- inside --------------------------------------------------------------------------------------------------------

    def _show_campaign(self) -> None:
        view, sheet = self._state, self.controller.summary
        if view is None:
            return
        folder, specimen = self._location()
        self.start_pane.show_campaigns(self.controller.available, folder, specimen, view.simulated)
        if sheet is not None:
            self.board.show_summary(
                sheet, self.controller.estimates, view, self.controller.running_item, self.controller.queue_active
            )
            self.board.header.show_progress(sheet, self.controller.running_item, view, self._feed.streamed_s)

    def _on_campaign_changed(self) -> None:
        """Show the campaign again, and turn to it when another one was opened."""
        self._show_campaign()
        sheet = self.controller.summary
        if self._added in self.board.item_list.names:
            self.board.item_list.select_item(self._added)
            self._added = ""
        if sheet is not None and sheet.path != self._shown_path:
            self._shown_path = sheet.path
            self._show_part(self.board)

    def _show_part(self, part: QWidget) -> None:
        """Show one of the panes, whose least size alone counts, and give it the focus if this page is visible."""
        for pane in filter(None, (self.start_pane, self.board, self.add_pane)):
            policy = QSizePolicy.Policy.Preferred if pane is part else QSizePolicy.Policy.Ignored
            pane.setSizePolicy(policy, policy)
        self.setCurrentWidget(part)
        if self.isVisible():
            part.setFocus()

    def _show_add(self) -> None:
        """Show the fields of a new item of the open campaign."""
        if self.controller.summary is None or self._busy:
            return
        if self.add_pane is None:
            self.add_pane = AddItemPane()
            self.addWidget(self.add_pane)
            self.add_pane.add_requested.connect(self._add_item)
            self.add_pane.closed.connect(self.go_back)
        self.add_pane.begin([row.name for row in self.controller.summary.items])
        self._show_part(self.add_pane)

    def _add_item(self, item: CampaignItem) -> None:
        self._show_message("")
        self.go_back()
        self._added = item.name
        self.controller.modify(lambda campaign: campaign.add(item), f"{item.name} is added")

    def _show_message(self, text: str) -> None:
        for pane in (self.board.header, self.start_pane):
            pane.message_label.show_message(text, is_error=True)

    def _choose_campaign_file(self) -> None:
        folder, _ = self._location()
        choose_file(self, "Open a campaign", self.open, "Campaigns (*.campaign.json)", str(folder))

    def _connect_signals(self) -> None:
        self.controller.changed.connect(self._on_campaign_changed)
        self.controller.message.connect(self._show_message)
        # Everything but an undo can be undone.
        self.controller.modified.connect(
            lambda text: tell(self, text, None if text in ("Undone", "Done again") else self.controller.undo)
        )
        self.controller.reviewed.connect(self._show_review)
        self.board.review_requested.connect(self._read_review)
        self.start_pane.create_requested.connect(self.create_campaign)
        self.start_pane.open_requested.connect(self.open)

        def show_start() -> None:
            if not self._busy:
                self.controller.find_campaigns(self._location()[0])
                self._show_part(self.start_pane)

        self.board.action_requested.connect(self.perform_action)
        self.board.item_list.item_moved.connect(
            lambda name, before: self.controller.modify(
                lambda campaign: campaign.move(name, before), f"{name} is moved"
            )
        )
        add_actions(
            self,
            {
                "campaign.queue": lambda: self.perform_action("halt the queue" if self._busy else "run without hands"),
                "campaign.add": self._show_add,
                "campaign.new": show_start,
                "campaign.open": self._choose_campaign_file,
                "campaign.undo": self.controller.undo,
                "campaign.redo": lambda: self.controller.undo(forward=True),
            },
        )
