"""Open campaign: header with progress, list of the items, result of the selected one, and the decision about it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtCore import QTimer, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QStackedWidget, QWidget

import app.campaign as campaigns  # imports HDF5 when a name is first used: a background thread has done that
from app.gui.campaign.decision import OF_ITEM, DecisionPane
from app.gui.campaign.item_list import CampaignList
from app.gui.campaign.result_pane import ResultPane
from app.gui.face import CLASS_S, class_of, px, set_length
from app.gui.plots import LivePane
from app.gui.widgets import (
    ElidedLabel,
    LowPane,
    Menu,
    SheetButton,
    StatusLine,
    add_actions,
    column,
    configure,
    give_menu,
    make_button,
    make_label,
    make_panel,
    make_progress_bar,
    row,
    update_actions,
)
from app.session import WindowState
from protocols import DEFAULT_PROTOCOL, PROTOCOLS

if TYPE_CHECKING:
    from app.campaign import CampaignEstimates, CampaignSummary, ItemSummary, NextStep, ResultReview


BAR_WIDTH, MAX_NAME_WIDTH = 200, 220
"""Widths of the bar, and of the campaign's name that is never elided; the text of the finished items is elided first."""

DETAILS_DELAY_MS = 30
"""After which the details of another item are made: the list shows first which one was chosen."""

ITEM_ACTIONS = ("run", "skip", "repeat", "accept", "reject", "open", "explore")
CAMPAIGN_ACTIONS = (
    "campaign.add",
    "campaign.new",
    "campaign.open",
    "",
    "campaign.undo",
    "campaign.redo",
    "",
    "identification",
)


class CampaignHeader(QWidget):
    """Name, progress and error message of the open campaign, the sheet of its specimen, and a menu of its actions."""

    def __init__(self, fill_menu: Callable[[Menu], object]) -> None:
        super().__init__()
        self.name_label = configure(ElidedLabel(), "campaign.name", kind="heading")
        self.progress_label = configure(ElidedLabel(), "campaign.progress", kind="note")
        self.message_label = configure(StatusLine(), "campaign.message")
        self.bar = make_progress_bar(1000, 8, "campaign.progress-bar")
        set_length(self.bar, width=BAR_WIDTH)
        self.simulated_label = make_label(
            "SIMULATED", "simulated-mark", wrap=False, name="campaign.simulated",
            toolTip="The results of this campaign come from a simulated bench; the open bench is real",
        )  # fmt: skip
        self.sheet_button = SheetButton("campaign")
        tip = "Actions of the campaign and of the selected item"
        self.menu_button = make_button(
            "…", None, "choice", tip, "campaign.menu", accessibleName="actions of the campaign"
        )
        self.menu = give_menu(self.menu_button, fill_menu)
        line = row(
            self.name_label, self.bar, (self.progress_label, 1), self.simulated_label, self.sheet_button, self.menu_button,
            spacing=12,
        )  # fmt: skip
        column(line, self.message_label, parent=self, spacing=4)

    def show_progress(self, summary: CampaignSummary, running: str, state: WindowState, streamed_s: float) -> None:
        """Show the progress of the campaign and the present run."""
        name = f"Campaign of {summary.specimen}"
        self.name_label.setText(name)
        self.name_label.setMinimumWidth(min(self.name_label.fontMetrics().horizontalAdvance(name) + 2, MAX_NAME_WIDTH))
        self.name_label.setToolTip(str(summary.path))
        self.simulated_label.setVisible(summary.simulated and not state.simulated)  # else the ribbon has it
        progress = state.progress if running and state.busy else None
        left_s, answered = (0.0, 0) if progress is None else (progress.remaining_at(streamed_s), state.answered)
        self.progress_label.setText(campaigns.format_progress(summary, running, left_s, answered))
        self.progress_label.setToolTip(self.progress_label.text())
        share = progress.fraction_at(streamed_s) if progress is not None else 0.0
        self.bar.setValue(round(1000 * (summary.done_count + share) / max(summary.total_count, 1)))


def _other_kind(summary: CampaignSummary, state: WindowState) -> str:
    """Return why the open bench cannot measure this campaign: one is simulated, the other real; empty if both agree."""
    if summary.simulated is state.simulated:
        return ""
    kinds = ("real", "simulated")
    return f"the campaign is {kinds[summary.simulated]}, the open bench is {kinds[state.simulated]}"


class CampaignBoard(LowPane):
    """Shows an open campaign; emits the operator's actions as signals."""

    action_requested = Signal(str, str)
    """Action (a `CampaignAction` or one of `ITEM_ACTIONS`) and name of the item ("": none)."""
    review_requested = Signal()
    """Another run is to be shown, and read for that."""

    def __init__(self, live: LivePane) -> None:
        super().__init__()
        self.summary: CampaignSummary | None = None
        self.step: NextStep | None = None
        self._estimates: CampaignEstimates | None = None
        self._busy, self._blocked = False, ""
        self.header, self.decision = CampaignHeader(self._fill_menu), DecisionPane()
        self.item_list, self._details, self.live_pane = CampaignList(), ResultPane(), live
        self.setFocusProxy(self.item_list)
        self._details_outdated = False
        self._details_timer = QTimer(self, singleShot=True, interval=DETAILS_DELAY_MS)
        self._details_timer.timeout.connect(self._show_details)
        self.side_stack = QStackedWidget()
        self.side_stack.addWidget(self._details)
        self.side_stack.addWidget(self.live_pane)
        self.live_pane.setObjectName("campaign/rows")
        shown = make_panel(self.side_stack, margins=(1, 1, 1, 1))
        columns = row(self.item_list, (shown, 1), self.decision, spacing=8)
        column(self.header, (columns, 1), parent=self, margins=(0, 4, 0, 0), spacing=8)
        self.item_list.selected_item_changed.connect(self._show_details_later)
        self.item_list.enter_pressed.connect(lambda: self._request_action("accept"))
        self._details.run_selected.connect(lambda _: self._show_details())
        self.decision.pressed.connect(self._request_action)
        moves = {"campaign.item.up": -1, "campaign.item.down": 1}
        add_actions(
            self,
            {f"campaign.item.{action}": partial(self._request_of_item, action) for action in ITEM_ACTIONS}
            | {name: partial(self.item_list.move_selected, by) for name, by in moves.items()},
        )

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """Give the columns the widths of the window's class; the smallest has no room for the decision beside live plots."""
        grid = class_of(self)
        self.item_list.setFixedWidth(px(grid.items))
        self.decision.setFixedWidth(px(grid.decision))
        self.decision.setVisible(not (self._busy and grid is CLASS_S))

    def show_summary(
        self,
        summary: CampaignSummary,
        estimates: CampaignEstimates | None,
        state: WindowState,
        running: str,
        queue: bool,
    ) -> None:
        """Show a campaign with its next step and present run."""
        about = self.step.item_name if self.step is not None else ""
        self.summary, self._estimates, self._busy = summary, estimates, state.busy
        self.step = campaigns.next_step(summary, running, state.busy, queue)
        self._blocked = "" if state.busy else state.blocked_reason or _other_kind(summary, state)
        self.item_list.show_summary(summary, running)
        follows = about in ("", self.item_list.selected_item)  # another item that was chosen stays chosen
        if self.step.item_name and self.step.item_name != about and follows:
            self.item_list.select_item(self.step.item_name)
        row = summary.item(running)
        self.live_pane.set_state(
            state, PROTOCOLS.get("" if row is None else row.state.item.protocol, PROTOCOLS[DEFAULT_PROTOCOL])
        )
        self.side_stack.setCurrentWidget(self.live_pane if state.busy else self._details)
        self._fit()
        update_actions(self, state)
        self._show_decision()
        self._show_details_later()

    @property
    def selected_item(self) -> ItemSummary | None:
        return self.summary.item(self.item_list.selected_item) if self.summary is not None else None

    def run_to_accept(self, row: ItemSummary) -> str:
        """Return the run to accept: the visible run of the selected item, or the new result of another."""
        seen = self.details.reviewed_path if self.item_list.selected_item == row.name else None
        state = row.state
        if seen is not None and not (state.accepted and seen == state.run):
            return seen.name
        reviewed = state.reviewed_run
        return reviewed.name if state.awaits_acceptance and reviewed is not None else ""

    @property
    def details(self) -> ResultPane:
        """The result of the selected item, brought up to date."""
        if self._details_outdated:
            self._show_details()
        return self._details

    def show_review(self, review: ResultReview) -> None:
        """Show a run that was read, unless another one has been chosen meanwhile."""
        if review.run.path == self.details.reviewed_path:
            self.details.show_review(review)
            self.decision.show_review(review)
            self._show_decision()

    def _show_details_later(self) -> None:
        """Show the details once the list is painted; during a run, when the live plots no longer cover them."""
        self._details_outdated = True
        if self.side_stack.currentWidget() is self._details:
            self._details_timer.start()

    def _show_details(self) -> None:
        self._details_outdated = False
        self._details_timer.stop()
        if self.summary is not None:
            self._details.show_item(self.selected_item, self._estimates, self.summary.specimen)
            if not self._details.is_read:
                self.decision.show_reading()
            self._show_decision()
            self.review_requested.emit()

    def _show_decision(self) -> None:
        if self.step is not None:
            shown, has_result = self._details, self._details.reviewed_path is not None
            pressed = self.window().focusWidget()
            self.decision.show_step(
                self.step, self.selected_item, shown.allowed_actions, has_result, self._blocked, self._busy
            )
            if pressed in self.decision.buttons.values() and not (pressed.isVisible() and pressed.isEnabled()):
                self.setFocus()  # a hidden button gives the keyboard to the first control of the window

    def _fill_menu(self, menu: Menu) -> None:
        """Fill the menu with the actions allowed on the selected item and those of the campaign."""
        allowed = () if self._busy else self.details.allowed_actions
        menu.add_named(self, [f"campaign.item.{each}" for each in ITEM_ACTIONS if each in allowed])
        menu.addSeparator()
        menu.add_named(self.window(), CAMPAIGN_ACTIONS)

    def _request_action(self, action: str) -> None:
        """Request an action of the decision: on the selected item, or on the next one."""
        self.action_requested.emit(action, self.item_list.selected_item if action in OF_ITEM else "")

    def _request_of_item(self, action: str) -> None:
        """Request an action on the selected item."""
        self.action_requested.emit(action, self.item_list.selected_item)
