"""Notices over the page: operator prompts, the unsafe state, failures, and the question whether to close."""

import math
import time

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QWidget

from app.common import sentence_case, typeset
from app.gui.status.message_card import MessageCard
from app.gui.status.prompt_card import INPUT_GUARD_S, PromptCard
from app.gui.status.session_controller import SessionController
from app.gui.status.unsafe_card import UnsafeCard
from app.gui.widgets import ACTIONS, OverlayHost, add_action, add_actions, make_button
from app.session import KNOWN_S, WindowState

RUN_ACTIVE_TEXT = "A run is in progress. Go to rest first, then close?"
UNSAFE_TEXT = "Rest was not confirmed and the message has not been acknowledged. Close all the same?"
CLOSING_TEXT = "Closing: the bench goes to rest and releases its instruments …"


class Notices(QObject):
    """Shows the cards of a window state, and takes their answers.

    Args:
        controller: executes the operator's answers.
        window: in which the shortcuts work.
        host: over whose page the cards lie.
    """

    close_confirmed = Signal()

    def __init__(self, controller: SessionController, window: QWidget, host: OverlayHost) -> None:
        super().__init__(window)
        self._controller, self._asked_at_s, self._replaced_at_s = controller, 0.0, 0.0
        self.unsafe = UnsafeCard(controller.state.amplifier, controller.acknowledge, controller.reconnect)
        self.closing = MessageCard(
            "notices.closing",
            "question",
            "amber_text",
            make_button("Go to rest and close", self._on_close_confirmed, "go", name="closing.confirm", key="Enter"),
            make_button("Keep the window", self.cancel_closing, "main", name="closing.cancel", key="F4"),
        )
        self.prompt = PromptCard(controller.answer_prompt)
        self.problem = MessageCard(
            "notices.problem",
            "danger",
            "red_line",
            make_button("Connect again", controller.reconnect, "go", name="problem.reconnect", key="F6"),
            make_button("Dismiss", controller.acknowledge, "main", name="problem.dismiss", key="F4"),
        )
        for card in (self.problem, self.unsafe, self.closing, self.prompt):
            host.add_overlay(card)
        self.problem.closed.connect(controller.acknowledge)
        self.closing.closed.connect(self.cancel_closing)
        self._answer_action = add_action(window, ACTIONS["answer"], self._on_enter)
        add_actions(window, {"acknowledge": self._on_dismiss, "reconnect": controller.reconnect})
        self._update_answer()

    def set_state(self, view: WindowState) -> None:
        if view.unsafe and self.unsafe.isHidden() and not self.problem.isHidden():
            self._replaced_at_s = time.monotonic()  # F4 that was meant for the problem does not answer the unsafe card
        self.unsafe.show_state(view)
        self.problem.show_message("" if view.unsafe else typeset(sentence_case(view.problem)))
        self.problem.buttons[0].setVisible(not view.connected and bool(view.problem))
        self._show_prompt(view)
        self._update_answer()

    def tick(self) -> None:
        """Show a prompt that is to be answered now, and the volts on the card of the unsafe state, where they are known."""
        self._show_prompt(self._controller.state)
        if self.unsafe.isHidden():
            return
        card = self._controller.adapter.observation.card
        age_s = math.inf if card is None else card.age_s(time.monotonic())
        self.unsafe.show_volts(card.drive_v if card is not None and age_s <= KNOWN_S else None, age_s)

    def _show_prompt(self, view: WindowState) -> None:
        """Show the prompt if this window must answer it, and not a simulated operator."""
        adapter, prompt = self._controller.adapter, view.prompt
        # The operator's prompt id is set only after the event was emitted.
        shown = prompt if prompt is not None and adapter.mailbox.pending_id == prompt.ask_id else None
        note, then, progress = "", "", view.progress
        if progress is not None and progress.label and progress.entries:  # not before the first entry
            note = f"Point {min(progress.done + 1, progress.entries)} of {progress.entries}, {progress.label}"
            then = progress.then
        if self.prompt.show_prompt(shown, note, view.simulated, then):
            self._update_answer()
        self.prompt.show_laser(adapter.feed.latest_um)

    def ask_to_close(self, view: WindowState) -> None:
        """Ask once whether to close the window."""
        if self.closing.isHidden():
            self.closing.show_message(RUN_ACTIVE_TEXT if view.busy else UNSAFE_TEXT)
            self.closing.buttons[0].setText("Go to rest and close" if view.busy else "Close")
            self._asked_at_s = time.monotonic()
        self._update_answer()

    def show_closing(self) -> None:
        """Show that the window closes as soon as the bench is at rest."""
        self.closing.show_message(CLOSING_TEXT)
        for button in self.closing.buttons:
            button.hide()
        self._update_answer()

    def cancel_closing(self) -> None:
        self.closing.show_message("")
        self._update_answer()

    def show_unsafe_exit(self) -> None:
        """Request the acknowledgement that closes the window without confirmed rest."""
        self.closing.show_message("")
        self.unsafe.buttons[0].setText("I have switched it off: close")
        self._update_answer()

    def _update_answer(self) -> None:
        self._answer_action.setEnabled(self._awaits_answer(self.closing) or self._awaits_answer(self.prompt))

    @staticmethod
    def _awaits_answer(card: MessageCard | PromptCard) -> bool:
        return not card.isHidden() and bool(card.buttons) and not card.buttons[0].isHidden()

    def _on_close_confirmed(self) -> None:
        if time.monotonic() - self._asked_at_s >= INPUT_GUARD_S:
            self.close_confirmed.emit()

    def _on_enter(self) -> None:
        if self._awaits_answer(self.closing):
            self._on_close_confirmed()
        elif self._awaits_answer(self.prompt):
            self.prompt.buttons[0].click()

    def _on_dismiss(self) -> None:
        if self._awaits_answer(self.closing):
            self.cancel_closing()
        elif self.unsafe.isHidden() and self.problem.isHidden():
            return
        elif time.monotonic() - self._replaced_at_s >= INPUT_GUARD_S:
            self._controller.acknowledge()
