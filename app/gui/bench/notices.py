"""What must be read or answered, above the pages: unsafe, closing, a prompt, a failure. Enter answers what is asked."""

import time

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QShortcut
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.gui.bench.notice import Choice, Notice
from app.gui.bench.prompt import PromptNotice
from app.gui.widgets.shortcuts import bind
from app.session.state import View
from drivers.bench.bench import BY_HAND
from protocols.base.events import Asked

GUARD_S = 0.4
"""An Enter this soon after a question appeared was meant for something else."""

MID_RUN = "A run is going on. Go to rest first, then close?"
UNSAFE_STILL = "Rest was not confirmed and the message has not been acknowledged. Close all the same?"
CLOSING = "Closing: the bench goes to rest and lets go of its instruments …"


class Notices(QWidget):
    """Hidden while there is nothing to say."""

    answered = Signal(str)
    stop_pressed = Signal()
    acknowledged = Signal()
    connect_pressed = Signal()
    leave_pressed = Signal()
    stay_pressed = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.unsafe = Notice((Choice("Acknowledge   (Ctrl+K)", self.acknowledged.emit),), "unsafe", "danger", self)
        self.closing = Notice(
            (
                Choice("Go to rest and close   (Enter)", self.leave_pressed.emit),
                Choice("Keep the window   (Ctrl+K)", self.stay_pressed.emit),
            ),
            "prompt",
            "question",
            self,
        )
        self.prompt = PromptNotice(self)
        self.prompt.chosen.connect(self._answer)
        self.prompt.stopped.connect(self.stop_pressed)
        self.trouble = Notice(
            (
                Choice("Connect again   (F6)", self.connect_pressed.emit),
                Choice("Dismiss   (Ctrl+K)", self.acknowledged.emit),
            ),
            "trouble",
            "cross",
            self,
        )
        layout = QVBoxLayout(self)
        layout.setContentsMargins(10, 0, 10, 0)
        layout.setSpacing(6)
        for notice in (self.unsafe, self.closing, self.prompt, self.trouble):
            layout.addWidget(notice)
        self._since_s = 0.0
        self._no_bench = False
        self._keys: list[QShortcut] = []
        self._keys += bind(
            parent, "Answer what is asked above the pages", self._enter, Qt.Key.Key_Return, Qt.Key.Key_Enter
        )
        bind(parent, "Acknowledge or dismiss a message", self._read, "Ctrl+K")
        bind(parent, "Connect to the bench again", self._connect, Qt.Key.Key_F6)
        self._arrange()

    def show_view(self, view: View) -> None:
        """Show what a view has to say."""
        self._no_bench = not view.connected and bool(view.trouble)
        # What to do comes first and large; what was measured and why it came to this can be read afterwards.
        todo = BY_HAND if view.unsafe.startswith(BY_HAND) else view.unsafe
        self.unsafe.say(todo, view.unsafe.removeprefix(todo).lstrip(". "))
        self.trouble.say(f"{view.trouble[:1].upper()}{view.trouble[1:]}")
        self.trouble.buttons[0].setVisible(self._no_bench)
        self._arrange()

    def show_prompt(self, prompt: Asked | None, waiting: int | None, laser_um: float | None = None) -> None:
        """Show a prompt, if it is this window that must answer it and not a simulated operator."""
        asked = prompt if prompt is not None and waiting == prompt.ask_id else None
        if self.prompt.ask(asked):
            self._since_s = time.monotonic()
            self._arrange()
        self.prompt.show_laser(laser_um)

    @property
    def patient(self) -> bool:
        """Whether a question has stood long enough to be read."""
        return time.monotonic() - self._since_s >= GUARD_S

    def ask_to_close(self, view: View) -> None:
        """Ask once whether the window shall close."""
        if self.closing.isHidden():
            self.closing.say(MID_RUN if view.busy else UNSAFE_STILL)
            self.closing.buttons[0].setText("Go to rest and close   (Enter)" if view.busy else "Close   (Enter)")
            self._since_s = time.monotonic()
        self._arrange()

    def leaving(self) -> None:
        """Nothing more is asked: the window closes when the bench is at rest."""
        self.closing.say(CLOSING)
        for button in self.closing.buttons:
            button.hide()
        self._arrange()

    def stay(self) -> None:
        """The window is not closed after all."""
        self.closing.say("")
        self._arrange()

    def left_unsafe(self) -> None:
        """The session has ended and rest was not confirmed: the window closes when that has been read."""
        self.closing.say("")
        self.unsafe.buttons[0].setText("Acknowledge and close   (Ctrl+K)")
        self._arrange()

    def _arrange(self) -> None:
        shown = [n for n in (self.unsafe, self.closing, self.prompt, self.trouble) if not n.isHidden()]
        self.setVisible(bool(shown))
        for key in self._keys:
            key.setEnabled(self._asks(self.closing) or self._asks(self.prompt))

    def _asks(self, notice: Notice) -> bool:
        return not notice.isHidden() and bool(notice.buttons) and not notice.buttons[0].isHidden()

    def _enter(self) -> None:
        if not self.patient:
            return
        if self._asks(self.closing):
            self.leave_pressed.emit()
        elif self._asks(self.prompt):
            self.prompt.buttons[0].click()

    def _answer(self, words: str) -> None:
        if self.patient:
            self.answered.emit(words)

    def _read(self) -> None:
        if self._asks(self.closing):
            self.stay_pressed.emit()
        elif not (self.unsafe.isHidden() and self.trouble.isHidden()):
            self.acknowledged.emit()

    def _connect(self) -> None:
        if self._no_bench:
            self.connect_pressed.emit()
