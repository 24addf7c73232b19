"""Right column of an open campaign: the next step, or the result under review with its comparisons, and the buttons."""

from __future__ import annotations

from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame

from app.common import SEVERITY_SYMBOLS, Severity, sentence_case, typeset
from app.gui.face import set_length
from app.gui.results import ResultCard, rich_table
from app.gui.widgets import (
    ACTIONS,
    SELECTABLE,
    UPRIGHT,
    column,
    configure,
    make_button,
    make_label,
    make_scroll_area,
    row,
    set_style_kind,
    set_tone,
    show_text,
    tooltip,
)

if TYPE_CHECKING:
    from app.campaign import ItemSummary, NextStep, ResultReview

BUTTONS = {
    "accept": ("Accept", "Enter"),
    "run": ("Run", ACTIONS["run"].shortcut),
    "run without hands": ("Run all without manual steps", ACTIONS["campaign.queue"].shortcut),
    "halt the queue": ("Only this one", ACTIONS["campaign.queue"].shortcut),
    "reject": ("Reject", ACTIONS["campaign.item.reject"].shortcut),
    "repeat": ("Repeat", ACTIONS["campaign.item.repeat"].shortcut),
}
"""Text and key of the buttons, by action of the step (`CampaignAction`) or on the selected item."""

OF_ITEM = ("accept", "reject", "repeat")
"""Those on the selected item."""

COMPARED = {
    "before": "Before, and the change",
    "paper": "Paper's model, and the deviation",
    "others": "Other specimens",
}
"""Headings of the comparisons, by field of a `ReviewRow`."""
SEVERITIES = (Severity.ERROR, Severity.WARNING, Severity.SUCCESS)


class DecisionPane(QFrame):
    """The buttons stay in view below what scrolls."""

    pressed = Signal(str)
    """A key of `BUTTONS`."""

    def __init__(self) -> None:
        super().__init__()
        configure(self, "campaign.decision", kind="panel")
        self.heading, self.reason, self.detail = (
            make_label(kind=kind, name=f"campaign.{kind}") for kind in ("step", "step-why", "step-detail")
        )
        self.card = ResultCard("review", ("report",))
        set_style_kind(self.card, "")
        self.quality_label = make_label(name="campaign.quality", visible=False)
        rich: dict[str, Any] = {"textFormat": Qt.TextFormat.RichText, "textInteractionFlags": SELECTABLE}
        self.compared_label = make_label(name="campaign.compared", visible=False, **rich)
        self.buttons = {
            action: make_button(text, partial(self.pressed.emit, action), name=f"campaign.step.{action}", key=key)
            for action, (text, key) in BUTTONS.items()
        }
        for action in OF_ITEM:
            self.buttons[action].setToolTip(tooltip(f"campaign.item.{action}"))
        for action in ("accept", "run"):
            set_style_kind(self.buttons[action], "go")
            set_length(self.buttons[action], height=44)
        area = make_scroll_area(
            column(self.heading, self.reason, self.detail, margins=(12, 6, 12, 0), spacing=8),
            self.card,
            column(self.quality_label, self.compared_label, margins=(12, 0, 12, 0), spacing=8),
            None,
            **UPRIGHT,
        )
        *main, reject, repeat = self.buttons.values()
        beside = row((reject, 1), (repeat, 1), spacing=8)
        column((area, 1), column(*main, beside, margins=(12, 8, 12, 12), spacing=8), parent=self, margins=(1, 4, 1, 0))

    def show_step(
        self, step: NextStep, item: ItemSummary | None, allowed: set[str], has_result: bool, blocked: str, busy: bool
    ) -> None:
        """Show the next step, or the selected item where its result is under review.

        Args:
            step: of the campaign.
            item: the selected one.
            allowed: actions on the item.
            has_result: whether a result of the item is under review.
            blocked: why no run can begin now; empty if one can.
            busy: whether a run is in progress.
        """
        has_result = has_result and not busy
        self.heading.setText(step.heading)
        self.reason.setText(step.reason)
        self.detail.setText(step.detail)
        is_told = not has_result or step.item_name not in ("", "" if item is None else item.name)
        self.heading.setVisible(is_told and bool(step.heading))
        for label in (self.reason, self.detail):
            label.setVisible(is_told and not has_result and bool(label.text()))
        self.card.setVisible(has_result)
        for label in (self.quality_label, self.compared_label):
            label.setVisible(has_result and bool(label.text()))
        accepts = "accept" in allowed and not busy
        for action, button in self.buttons.items():
            on_item = action in OF_ITEM
            is_offered = (action in allowed and not busy) if on_item else action in step.actions and not accepts
            button.setVisible(is_offered)
            button.setEnabled(is_offered and (on_item or not (blocked and action.startswith("run"))))
            if action.startswith("run"):
                button.setToolTip(f"Cannot run: {blocked}" if blocked else "")

    def show_reading(self) -> None:
        """Show that a run is being read, and hide the result of the run before."""
        self.card.show_reading()
        for label in (self.quality_label, self.compared_label):
            show_text(label, "")

    def show_review(self, review: ResultReview) -> None:
        """Show a result beside its limits, the result before, the paper's model and other specimens."""
        self.card.show_summary(review.run.result)
        marks = [f"{SEVERITY_SYMBOLS[each.severity]} {each.text}" for each in review.indicators]
        show_text(self.quality_label, typeset(", ".join(marks)))
        found = {each.severity for each in review.indicators}
        set_tone(self.quality_label, next((each for each in SEVERITIES if each in found), Severity.INFO))
        failed = [each for each in review.rows if not each.passed]
        text = "".join(f"<p>✕ {escape(sentence_case(f'{each.name}: {each.remedy}'))}</p>" for each in failed)
        for field, head in COMPARED.items():
            values = [(sentence_case(each.name), getattr(each, field)) for each in review.rows]
            text += rich_table([(name, value) for name, value in values if value], (head, ""))
        show_text(self.compared_label, typeset(text))
