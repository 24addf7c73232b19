"""Notices above the pages: closing, operator prompts, failures and verdicts; and over them: the unsafe state."""

import time
from collections.abc import Callable

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QPushButton, QWidget

from app.common import Severity, outcome_severity
from app.gui.status.notice import Notice
from app.gui.status.prompt import PromptNotice
from app.gui.status.session_controller import SessionController
from app.gui.widgets import (
    ACTIONS,
    FittedScrollArea,
    add_action,
    add_actions,
    column,
    make_button,
    shortcut_label,
)
from app.session import WindowState
from drivers import MANUAL_SHUTDOWN_INSTRUCTIONS
from protocols.base import PromptShown

INPUT_GUARD_S = 0.4
"""Enter is ignored for this long after a question appeared: it was meant for something else."""

RUN_ACTIVE_TEXT = "A run is in progress. Go to rest first, then close?"
UNSAFE_TEXT = "Rest was not confirmed and the message has not been acknowledged. Close all the same?"
CLOSING_TEXT = "Closing: the bench goes to rest and releases its instruments …"


def _button(name: str, text: str, on_click: Callable[[], object], action: str = "acknowledge") -> QPushButton:
    return make_button(shortcut_label(text, action), on_click, name=name)


class NoticeArea(FittedScrollArea):
    """Hidden while there is no message; `unsafe` is placed over the page, so that it does not move it.

    Args:
        controller: executes the operator's answers.
        parent: in which the shortcuts work.
    """

    close_confirmed = Signal()

    def __init__(self, controller: SessionController, parent: QWidget) -> None:
        content = QWidget()
        super().__init__(content, parent)
        self._controller = controller
        self.unsafe = Notice(
            "notices.unsafe", "unsafe", "danger", _button("unsafe.acknowledge", "Acknowledge", controller.acknowledge)
        )
        self.closing = Notice(
            "notices.closing",
            "prompt",
            "question",
            make_button("Go to rest and close   (Enter)", self.close_confirmed.emit, name="closing.confirm"),
            _button("closing.cancel", "Keep the window", self.cancel_closing),
        )
        self.prompt = PromptNotice(self._on_answer, controller.stop)
        self.problem = Notice(
            "notices.problem",
            "trouble",
            "cross",
            _button("problem.reconnect", "Connect again", controller.reconnect, "reconnect"),
            _button("problem.dismiss", "Dismiss", controller.acknowledge),
        )
        self.verdict = Notice(
            "notices.verdict", "caution", "question", _button("verdict.dismiss", "Dismiss", controller.acknowledge)
        )
        self._notices = (self.unsafe, self.closing, self.prompt, self.problem, self.verdict)
        column(*self._notices[1:], parent=content, margins=(10, 0, 10, 0), spacing=6)
        self._shown_at_s, self._no_bench = 0.0, False
        self._answer_action = add_action(parent, ACTIONS["answer"], self._on_enter)
        add_actions(parent, {"acknowledge": self._on_dismiss, "reconnect": self._on_reconnect})
        self._update_visibility()

    def set_state(self, view: WindowState) -> None:
        """Show the messages of a window state."""
        self._no_bench = not view.connected and bool(view.problem)
        # Instructions first and large; measured values and causes below.
        todo = MANUAL_SHUTDOWN_INSTRUCTIONS if view.unsafe.startswith(MANUAL_SHUTDOWN_INSTRUCTIONS) else view.unsafe
        self.unsafe.show_message(todo, view.unsafe.removeprefix(todo).lstrip(". "))
        self.problem.show_message(f"{view.problem[:1].upper()}{view.problem[1:]}")
        self.problem.buttons[0].setVisible(self._no_bench)
        heading, *details = view.verdict_message.split("\n")
        self.verdict.show_message(heading, "\n".join(details))
        if view.outcome is not None:
            failed = outcome_severity(view.outcome.verdict.outcome) is Severity.ERROR
            self.verdict.set_style(*(("trouble", "cross") if failed else ("caution", "question")))
        self._update_visibility()

    def show_prompt(self, prompt: PromptShown | None, pending_id: int | None, laser_um: float | None = None) -> None:
        """Show a prompt if this window must answer it, and not a simulated operator."""
        if self.prompt.show_prompt(prompt if prompt is not None and pending_id == prompt.ask_id else None):
            self._shown_at_s = time.monotonic()
            self._update_visibility()
        self.prompt.show_laser(laser_um)

    @property
    def accepts_input(self) -> bool:
        """Whether a question has been visible long enough to be read."""
        return time.monotonic() - self._shown_at_s >= INPUT_GUARD_S

    def ask_to_close(self, view: WindowState) -> None:
        """Ask once whether to close the window."""
        if self.closing.isHidden():
            self.closing.show_message(RUN_ACTIVE_TEXT if view.busy else UNSAFE_TEXT)
            self.closing.buttons[0].setText("Go to rest and close   (Enter)" if view.busy else "Close   (Enter)")
            self._shown_at_s = time.monotonic()
        self._update_visibility()

    def show_closing(self) -> None:
        """Show that the window closes as soon as the bench is at rest."""
        self.closing.show_message(CLOSING_TEXT)
        for button in self.closing.buttons:
            button.hide()
        self._update_visibility()

    def cancel_closing(self) -> None:
        """Hide the question whether to close."""
        self.closing.show_message("")
        self._update_visibility()

    def show_unsafe_exit(self) -> None:
        """Request the acknowledgement that closes the window without confirmed rest."""
        self.closing.show_message("")
        self.unsafe.buttons[0].setText(shortcut_label("Acknowledge and close", "acknowledge"))
        self._update_visibility()

    def _update_visibility(self) -> None:
        self.setVisible(not all(notice.isHidden() for notice in self._notices[1:]))
        self._answer_action.setEnabled(self._awaits_answer(self.closing) or self._awaits_answer(self.prompt))

    def _awaits_answer(self, notice: Notice) -> bool:
        return not notice.isHidden() and bool(notice.buttons) and not notice.buttons[0].isHidden()

    def _on_enter(self) -> None:
        if not self.accepts_input:
            return
        if self._awaits_answer(self.closing):
            self.close_confirmed.emit()
        elif self._awaits_answer(self.prompt):
            self.prompt.buttons[0].click()

    def _on_answer(self, choice: str) -> None:
        if self.accepts_input:
            self._controller.answer_prompt(choice)

    def _on_dismiss(self) -> None:
        if self._awaits_answer(self.closing):
            self.cancel_closing()
        elif not (self.unsafe.isHidden() and self.problem.isHidden() and self.verdict.isHidden()):
            self._controller.acknowledge()

    def _on_reconnect(self) -> None:
        self._controller.reconnect()
