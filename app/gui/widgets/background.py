"""Work that takes a while, done beside the window; what comes of it is brought back into the window's thread."""

from collections.abc import Callable
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from typing import Any

from PySide6.QtCore import QObject, Signal


class BackgroundWorker(QObject):
    """Does one thing after another in a thread of its own.

    `failed` of a job hears what it raised; without it the error is raised in the window's thread.
    """

    _done = Signal(object, object)

    def __init__(self, name: str, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._pool = ThreadPoolExecutor(1, thread_name_prefix=name)
        self.closed = False
        self.pending = 0
        """Jobs that are not back yet."""
        self._done.connect(self._deliver)

    def submit(
        self,
        work: Callable[[], Any],
        on_result: Callable[[Any], object] = lambda _: None,
        on_error: Callable[[Exception], object] | None = None,
    ) -> None:
        """Do `work` beside the window, then tell `then`, in the window's thread, what came of it."""
        if self.closed:
            return
        self.pending += 1
        future = self._pool.submit(work)
        future.add_done_callback(lambda done: None if self.closed else self._done.emit((on_result, on_error), done))

    def close(self) -> None:
        """Finish what has begun, leave the rest, tell nobody."""
        self.closed = True
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _deliver(self, callbacks: tuple[Any, Any], done: Future[Any]) -> None:
        self.pending -= 1
        then, failed = callbacks
        try:
            answer = done.result()
        except CancelledError:
            return
        except Exception as error:
            if failed is None:
                raise
            failed(error)
            return
        then(answer)
