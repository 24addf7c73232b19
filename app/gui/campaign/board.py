"""Open campaign: header with progress, next step with its actions, list of items, details."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QFrame, QStackedWidget, QWidget

import app.campaign as campaigns  # imports HDF5 when a name is first used: a background thread has done that
from app.gui.campaign.details import ItemDetailsPane
from app.gui.campaign.item_list import CampaignList
from app.gui.plots import LivePane
from app.gui.widgets import (
    ACTIONS,
    ElidedLabel,
    SheetButton,
    StatusLine,
    add_actions,
    column,
    configure,
    make_button,
    make_choice,
    make_label,
    make_progress_bar,
    make_splitter,
    row,
    set_style_kind,
    tooltip,
    update_actions,
)
from app.session import WindowState
from protocols import DEFAULT_PROTOCOL, PROTOCOLS

if TYPE_CHECKING:
    from app.campaign import CampaignEstimates, CampaignSummary, ItemSummary, NextStep


ACTION_BUTTON_LABELS = {
    "accept": ("Accept", "Enter"),
    "reject": ("Reject", ACTIONS["campaign.item.reject"].shortcut),
    "run": ("Run", ACTIONS["run"].shortcut),
    "run without hands": ("Run all measurements without manual steps", ACTIONS["campaign.queue"].shortcut),
    "halt the queue": ("Only this one", ACTIONS["campaign.queue"].shortcut),
}
"""Text and key of the buttons, by action (`app.campaign.presentation.CampaignAction`)."""


STEP_HEIGHT_LINES = 9
MIN_LIVE_WIDTH = 460
MAX_NAME_WIDTH = 220
"""Width of the campaign's name that is never elided; the text of the finished items is elided first."""

DETAILS_DELAY_MS = 30
"""After which the details of another item are made: the list shows first which one was chosen."""


class NextStepPane(QFrame):
    """Shows one step."""

    pressed = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        configure(self, "campaign.step", kind="panel")
        self.heading, self.reason, self.detail = (
            make_label(kind=kind, name=f"campaign.{kind}") for kind in ("step", "step-why", "step-detail")
        )
        self.buttons = {
            action: make_button(
                text, partial(self.pressed.emit, action), name=f"campaign.step.{action}", key=key, visible=False
            )
            for action, (text, key) in ACTION_BUTTON_LABELS.items()
        }
        text = column(self.heading, self.reason, self.detail, None, spacing=4)
        self.setFixedHeight(STEP_HEIGHT_LINES * self.fontMetrics().lineSpacing())  # the list below never moves
        buttons = column(*self.buttons.values(), None, spacing=6)
        row((text, 1), buttons, parent=self, margins=(16, 10, 12, 10), spacing=20)

    def show_step(self, step: NextStep, blocked_reason: str) -> None:
        """Show a step; `blocked_reason` is why no run can begin now, empty if one can."""
        self.heading.setText(step.heading)
        self.reason.setText(step.reason)
        self.detail.setText(step.detail)
        for label in (self.reason, self.detail):
            label.setVisible(bool(label.text()))
            label.setToolTip(label.text())
        for action, button in self.buttons.items():
            button.setVisible(action in step.actions)
            first = bool(step.actions) and action == step.actions[0]
            set_style_kind(button, "go" if first else "")
            runs = action.startswith("run")
            if action == "run":
                button.setText("Run" if first else "Run the next")
            button.setEnabled(not (runs and blocked_reason))
            button.setToolTip(f"Cannot run: {blocked_reason}" if runs and blocked_reason else "")


class CampaignHeader(QWidget):
    """Specimen, progress bar and error message of the open campaign."""

    action_requested = Signal(str)
    """`add`, `new` or `open`."""

    def __init__(self) -> None:
        super().__init__()
        self.name_label = configure(ElidedLabel(), "campaign.name", kind="heading")
        self.progress_label = configure(ElidedLabel(), "campaign.progress")
        self.message_label = configure(StatusLine(), "campaign.message")
        self.bar = make_progress_bar(1000, 10, "campaign.progress-bar")
        buttons = (
            make_button(
                text,
                partial(self.action_requested.emit, action),
                "choice",
                tooltip(f"campaign.{action}"),
                name=f"campaign.{action}",
            )
            for action, text in (("add", "Add …"), ("new", "New …"), ("open", "Open …"))
        )
        self.simulated_label = make_label(
            "SIMULATED",
            "simulated-mark",
            wrap=False,
            name="campaign.simulated",
            toolTip="The results of this campaign come from a simulated bench, independent of the open bench",
        )
        self.sheet_button = SheetButton("campaign")
        self.identify_button = configure(make_choice("Identify …", tooltip("identification")), "campaign.identify")
        line = row(
            self.name_label,
            self.sheet_button,
            self.identify_button,
            self.simulated_label,
            self.progress_label,
            (self.bar, 1),
            *buttons,
            spacing=8,
        )
        column(line, self.message_label, parent=self, spacing=4)

    def show_progress(self, summary: CampaignSummary, running: str, state: WindowState, streamed_s: float) -> None:
        """Show the progress of the campaign and the present run."""
        name = f"Campaign of {summary.specimen}"
        self.name_label.setText(name)
        self.name_label.setMinimumWidth(min(self.name_label.fontMetrics().horizontalAdvance(name) + 2, MAX_NAME_WIDTH))
        self.name_label.setToolTip(str(summary.path))
        self.simulated_label.setVisible(summary.simulated)
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


class CampaignBoard(QWidget):
    """Shows an open campaign; emits the operator's actions as signals."""

    action_requested = Signal(str, str)
    """Action (a `CampaignAction` or a key of `details.BUTTONS`) and name of the item ("": none)."""
    review_requested = Signal()
    """The details show another run, which is to be read."""

    def __init__(self, live: LivePane) -> None:
        super().__init__()
        self.summary: CampaignSummary | None = None
        self.step: NextStep | None = None
        self._estimates: CampaignEstimates | None = None
        self._busy = False
        self.header, self.step_pane = CampaignHeader(), NextStepPane()
        self.item_list, self._details, self.live_pane = CampaignList(), ItemDetailsPane(), live
        self.setFocusProxy(self.item_list)
        self._details_outdated = False
        self._details_timer = QTimer(self, singleShot=True, interval=DETAILS_DELAY_MS)
        self._details_timer.timeout.connect(self._show_details)
        self.side_stack = QStackedWidget()
        self.side_stack.addWidget(self._details)
        self.side_stack.addWidget(self.live_pane)
        columns = make_splitter("campaign/columns", (self.item_list, 0), (self.side_stack, 1), sizes=[320, 800])
        self.live_pane.setObjectName("campaign/rows")
        self.live_pane.setMinimumWidth(MIN_LIVE_WIDTH)
        column(self.header, self.step_pane, (columns, 1), parent=self, margins=(0, 4, 0, 0), spacing=8)
        self.item_list.selected_item_changed.connect(self._show_details_later)
        self.item_list.enter_pressed.connect(lambda: self._request_action("accept"))
        self._details.pressed.connect(self._request_action)
        self._details.run_selected.connect(lambda _: self.review_requested.emit())
        self.step_pane.pressed.connect(self._on_step_action)
        add_actions(
            self,
            {
                f"campaign.item.{action}": partial(self._request_action, action)
                for action in ("run", "skip", "repeat", "accept", "reject", "open", "explore")
            }
            | {
                "campaign.item.up": partial(self.item_list.move_selected, -1),
                "campaign.item.down": partial(self.item_list.move_selected, 1),
            },
        )

    def hasHeightForWidth(self) -> bool:
        """Return False: the texts have a fixed height, and the page scrolls only where its least size has no room."""
        return False

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
        self.step_pane.show_step(self.step, "" if state.busy else state.blocked_reason or _other_kind(summary, state))
        self.item_list.show_summary(summary, running)
        follows = about in ("", self.item_list.selected_item)  # another item that was chosen stays chosen
        if self.step.item_name and self.step.item_name != about and follows:
            self.item_list.select_item(self.step.item_name)
        row = summary.item(running)
        self.live_pane.set_state(
            state, PROTOCOLS.get("" if row is None else row.state.item.protocol, PROTOCOLS[DEFAULT_PROTOCOL])
        )
        self.side_stack.setCurrentWidget(self.live_pane if state.busy else self._details)
        update_actions(self, state)
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
    def details(self) -> ItemDetailsPane:
        """The details of the selected item, brought up to date."""
        if self._details_outdated:
            self._show_details()
        return self._details

    def _show_details_later(self) -> None:
        """Show the details once the list is painted; during a run, when the live plots no longer cover them."""
        self._details_outdated = True
        if self.side_stack.currentWidget() is self._details:
            self._details_timer.start()

    def _show_details(self) -> None:
        self._details_outdated = False
        self._details_timer.stop()
        if self.summary is not None:
            asked = self.step.actions if self.step and self.step.item_name == self.item_list.selected_item else ()
            for action in ("accept", "reject"):  # once in the window: above, where the step asks for it
                self._details.buttons[action].setVisible(action not in asked)
            self._details.show_item(self.selected_item, self._estimates, self.summary.specimen, self._busy)
            self.review_requested.emit()

    def _request_action(self, action: str) -> None:
        self.action_requested.emit(action, self.item_list.selected_item)

    def _on_step_action(self, action: str) -> None:
        """Request an action of the step: accept and reject concern its item, run the next one."""
        about = self.step.item_name if self.step is not None and action in ("accept", "reject") else ""
        self.action_requested.emit(action, about)
