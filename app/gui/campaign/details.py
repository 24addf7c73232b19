"""Details of the selected campaign item, its actions, and the specimen's estimates."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QTabWidget, QWidget

import app.campaign as campaigns  # imports HDF5 when a name is first used: a background thread has done that
from app.gui.campaign.review_pane import ReviewPane
from app.gui.widgets import (
    SELECTABLE,
    Item,
    WrappedRow,
    column,
    configure,
    make_button,
    make_label,
    make_scroll_area,
    name_button,
)

if TYPE_CHECKING:
    from app.campaign import CampaignEstimates, ItemSummary, ResultReview

BUTTONS = {
    "accept": "Accept",
    "reject": "Reject",
    "repeat": "Repeat",
    "open": "Open",
    "explore": "Explore",
    "run": "Run this",
    "skip": "Skip",
}
"""Text of the button of each action on an item (`campaign.item.…` in the registry of actions)."""


class ItemDetailsPane(QWidget):
    """Shows one item: the result under review with its plot, or its state as text; its actions below."""

    pressed = Signal(str)
    run_selected = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.review_pane = ReviewPane()
        self.review_pane.run_selected.connect(self._select_run)
        self.heading_label = make_label(kind="running", wrap=False, name="campaign.item")
        self.buttons = {
            action: make_button(text, partial(self.pressed.emit, action), "choice", name=f"campaign.item.{action}")
            for action, text in BUTTONS.items()
        }
        for action, button in self.buttons.items():
            name_button(button, f"campaign.item.{action}", BUTTONS[action])
        self.details_area = make_scroll_area(horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.tabs = configure(
            QTabWidget(), "campaign.item.tabs", documentMode=True, accessibleName="result and details"
        )
        self.tabs.addTab(self.review_pane, "Result")
        self.details_area.setAccessibleName("details")
        self.tabs.addTab(self.details_area, "Details")
        self.tabs.setCornerWidget(self.heading_label)
        buttons = WrappedRow(*self.buttons.values(), spacing=4)
        column((self.tabs, 1), buttons, parent=self, margins=(10, 0, 0, 0), spacing=6)
        self._shown_state: object = None
        self._item: ItemSummary | None = None
        self._selected_run = ""
        self._busy, self._turns_to_result = False, True

    @property
    def reviewed_path(self) -> Path | None:
        """The run under review: the selected run, or else the candidate or valid run."""
        if self._item is None or not self._item.state.results or self._item.state.run is None:
            return None
        reviewed = self._item.state.reviewed_run
        if self._selected_run:
            return self._item.state.run.parent / self._selected_run
        names = [run.name for run in self._item.state.results]
        return reviewed if reviewed is not None and reviewed.name in names else None

    @property
    def earlier_path(self) -> Path | None:
        """The result for comparison with the reviewed one: the valid one, or else the previous one."""
        path = self.reviewed_path
        if path is None or self._item is None:
            return None
        state = self._item.state
        if state.run is not None and state.run != path:
            return state.run
        names = [run.name for run in state.results if run.name not in state.item.rejected]
        at = names.index(path.name) if path.name in names else 0
        return path.parent / names[at - 1] if at > 0 else None

    def show_review(self, review: ResultReview) -> None:
        if review.run.path == self.reviewed_path:
            self.review_pane.show_review(review)
            self.tabs.setTabEnabled(0, True)
            if self._turns_to_result:
                self._turns_to_result = False
                self.tabs.setCurrentIndex(0)

    def _select_run(self, name: str) -> None:
        self._selected_run = name
        self.review_pane.show_reading(name)
        self._update_buttons()
        self.run_selected.emit(name)

    def show_item(
        self, item: ItemSummary | None, estimates: CampaignEstimates | None, specimen: str, busy: bool
    ) -> None:
        """Show an item and enable its actions."""
        if (item, estimates, specimen, busy) == self._shown_state:
            return
        self._shown_state = (item, estimates, specimen, busy)
        if (
            item is None
            or self._item is None
            or item.state.results != self._item.state.results
            or item.name != self._item.name
        ):
            self._selected_run = ""
            self._turns_to_result = True
        self._item = item
        if (path := self.reviewed_path) is None:
            self.tabs.setTabEnabled(0, False)
            self.tabs.setCurrentIndex(1)
        elif item is not None:
            self.review_pane.show_runs(item, path.name)
            self.review_pane.show_reading(path.name)
        self.heading_label.setText(f"{item.name}: {item.state.title}" if item is not None else "")
        self._busy = busy
        self._update_buttons()
        if item is not None:
            skipped = item.state.status == "skipped"
            name_button(self.buttons["skip"], "campaign.item.skip", "Take in" if skipped else BUTTONS["skip"])
            self._show_details(item, estimates, specimen)

    def _update_buttons(self) -> None:
        allowed = _allowed_actions(self._item) if self._item is not None else set()
        if self._selected_run and self._item is not None and self._item.state.run is not None:
            counts = self._item.state.run.name == self._selected_run and self._item.state.accepted
            allowed = (allowed - {"accept"}) | (set() if counts else {"accept"})
        for action, button in self.buttons.items():
            button.setEnabled(action in allowed and (not self._busy or action in ("open", "explore")))

    def _show_details(self, item: ItemSummary, estimates: CampaignEstimates | None, specimen: str) -> None:
        content, sections = QWidget(autoFillBackground=False), list[Item]()
        for section in campaigns.item_details(item, estimates, specimen):
            lines = make_label("\n".join(section.lines), textInteractionFlags=SELECTABLE)
            sections += [make_label(section.heading, "caption", wrap=False), lines, 8]
        column(*sections, None, parent=content, margins=(0, 0, 8, 0), spacing=2)
        self.details_area.setWidget(content)  # deletes the previous content


def _allowed_actions(item: ItemSummary) -> set[str]:
    """Return the actions that an item allows."""
    state = item.state
    allowed = {"skip"} if state.status != "running" else set()
    if state.next_action not in ("", "wait"):
        allowed.add("run")
    if state.run is None:
        return allowed
    return allowed | {"repeat", "reject", "open", "explore"} | ({"accept"} if state.awaits_acceptance else set())
