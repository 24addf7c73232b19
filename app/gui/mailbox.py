"""Prompts that the window answers: the runner polls in the bench thread, the window replies by id. No Qt."""

import threading

from protocols.steps import Prompt


class MailboxOperator:
    """Holds one prompt and its answer (protocols.operator.Operator); a new prompt throws away whatever was there."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: int | None = None
        self._answer: tuple[int, str] | None = None

    @property
    def waiting(self) -> int | None:
        """The id of the prompt that this operator must answer, None where nothing is asked of it."""
        with self._lock:
            return self._waiting

    def show(self, ask_id: int, _prompt: Prompt) -> None:
        with self._lock:
            self._waiting, self._answer = ask_id, None

    def answer(self, ask_id: int) -> str | None:
        with self._lock:
            if self._answer is None or self._answer[0] != ask_id:
                return None
            words = self._answer[1]
            self._waiting, self._answer = None, None
            return words

    def reply(self, ask_id: int, words: str = "done") -> bool:
        """Answer a prompt; whether it was still waiting."""
        with self._lock:
            if self._waiting != ask_id or self._answer is not None:
                return False
            self._answer = (ask_id, words)
            return True

    def forget(self) -> None:
        """The run is over; nothing is asked any more."""
        with self._lock:
            self._waiting, self._answer = None, None
