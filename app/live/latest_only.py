"""Work beside the window of which only the newest matters: a slider moves on while its last curve is computed."""

import threading
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

Q = TypeVar("Q")
A = TypeVar("A")


class LatestOnlyWorker(Generic[Q, A]):
    """Answers questions in a thread of its own; a question that was overtaken is not begun, or is left unfinished.

    Args:
        compute: yields one or several answers, the first as soon as it can.
        told: hears each answer, or the error that ended it, with the question; called in the thread.
        rest_s: how long it rests between two answers, so that a window can paint the one before: two threads that both
            compute hold each other up by several milliseconds at every turn. A new question ends the rest.
    """

    def __init__(
        self,
        compute: Callable[[Q], Iterator[A]],
        on_result: Callable[[Q, A | Exception], None],
        name: str,
        pause_s: float = 0.0,
    ) -> None:
        self._compute, self._on_result, self._pause_s = compute, on_result, pause_s
        self._wake = threading.Condition()
        self._next: Q | None = None
        self._closing = False
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def submit(self, request: Q) -> None:
        """Want an answer; returns at once."""
        with self._wake:
            self._next = request
            self._wake.notify()

    def close(self) -> None:
        """End the thread; what is being computed is not told any more."""
        with self._wake:
            self._closing = True
            self._wake.notify()
        self._thread.join()

    def _is_closed(self) -> bool:
        with self._wake:
            return self._closing

    def _superseded(self) -> bool:
        """Whether what follows is of no use any more; asked after a rest."""
        with self._wake:
            if self._pause_s > 0 and self._next is None and not self._closing:
                self._wake.wait(self._pause_s)
            return self._closing or self._next is not None

    def _work(self) -> None:
        while True:
            with self._wake:
                while self._next is None and not self._closing:
                    self._wake.wait()
                question, self._next = self._next, None
            if question is None or self._is_closed():
                return
            try:
                for answer in self._compute(question):
                    if self._is_closed():
                        return
                    self._on_result(question, answer)
                    if self._superseded():
                        break
            except Exception as error:  # noqa: BLE001 - whatever the model cannot do is shown, and the next slider still works
                if not self._is_closed():
                    self._on_result(question, error)
