"""Background worker that processes only the newest request: a slider moves on while its last curve is computed."""

import threading
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

Q = TypeVar("Q")
A = TypeVar("A")


class LatestOnlyWorker(Generic[Q, A]):
    """Computes results in its own thread, started with the first request; a superseded request is skipped or left unfinished.

    Args:
        compute: yields one or several results, the first as soon as possible.
        on_result: called in the worker thread with the request and each result, or the exception that ended it.
        pause_s: pause between two results in which a window can paint the first: two threads that both compute delay
            each other by several milliseconds at every switch. A new request ends the pause.
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

    def submit(self, request: Q) -> None:
        """Request a computation; returns at once."""
        with self._wake:
            self._next = request
            if self._thread.ident is None and not self._closing:
                self._thread.start()
            self._wake.notify()

    def close(self) -> None:
        """Stop the thread; a result still being computed is dropped."""
        with self._wake:
            self._closing = True
            self._wake.notify()
        if self._thread.ident is not None:
            self._thread.join()

    def _superseded(self) -> bool:
        """Pause, then return whether further results of this request are not needed any more."""
        with self._wake:
            if self._pause_s > 0 and self._next is None and not self._closing:
                self._wake.wait(self._pause_s)
            return self._closing or self._next is not None

    def _deliver(self, request: Q, result: A | Exception) -> None:
        with self._wake:
            if self._closing:
                return
        self._on_result(request, result)

    def _work(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._closing or self._next is not None)
                request, self._next = self._next, None
                if request is None or self._closing:
                    return
            try:
                for result in self._compute(request):
                    self._deliver(request, result)
                    if self._superseded():
                        break
            except Exception as error:  # noqa: BLE001 - any error of the model is displayed, and the next request still works
                self._deliver(request, error)
