"""Background thread of a widget: runs jobs one after the other and delivers their results in the GUI thread; its end with the window."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from PySide6.QtCore import QObject, Signal


class _Ending(QObject):
    def __init__(self, parent: QObject, end: Callable[[], object]) -> None:
        super().__init__(parent)
        self.end = end


def at_end(parent: QObject, end: Callable[[], object]) -> None:
    """Call a function when the window that an object is in is closed."""
    _Ending(parent, end)


def end_all(window: QObject) -> None:
    """Stop the background work of a window or page that is closed; files that are being written are finished."""
    for each in window.findChildren(_Ending):
        each.end()


class BackgroundWorker(QObject):
    """Runs jobs one after the other in its own thread.

    A job that takes long is given an `app.common.progress.Progress`, through which it reports and is cancelled. `end_all` closes
    the worker.

    Args:
        name: of the thread.
        parent: in the window whose end closes the worker.
        cancel: cancels the jobs when the worker is closed.
    """

    _done = Signal(object, object)

    def __init__(self, name: str, parent: QObject, cancel: Callable[[], object] = lambda: None) -> None:
        super().__init__(parent)
        self._pool, self._cancel = ThreadPoolExecutor(1, thread_name_prefix=name), cancel
        self._latest: dict[str, Future[Any]] = {}
        self.closed = False
        self.pending = 0
        """Number of jobs whose results are not delivered yet."""
        self._done.connect(self._deliver)
        at_end(self, self.close)

    def submit(
        self,
        work: Callable[[], Any],
        on_result: Callable[[Any], object] = lambda _: None,
        on_error: Callable[[Exception], object] | None = None,
        latest_only: str = "",
    ) -> None:
        """Run a job in the background, then call `on_result` with its result in the GUI thread.

        Args:
            work: the job.
            on_result: called with the result of the job.
            on_error: called with the exception of the job; without it the exception is raised in the GUI thread.
            latest_only: name of a kind of job of which only the newest counts: an earlier pending job is dropped, and the result
                of a running one is not delivered.
        """
        if self.closed:
            return
        self.pending += 1
        future = self._pool.submit(work)
        if latest_only:
            if (overtaken := self._latest.get(latest_only)) is not None:
                overtaken.cancel()
            self._latest[latest_only] = future

        callbacks = (on_result, on_error, latest_only)
        future.add_done_callback(lambda done: None if self.closed else self._done.emit(callbacks, done))

    def close(self) -> None:
        """Wait for the job that has begun and drop the others; no result is delivered any more."""
        self.closed = True
        self._cancel()
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _deliver(self, callbacks: tuple[Any, Any, str], done: Future[Any]) -> None:
        on_result, on_error, latest_only = callbacks
        self.pending -= 1
        if done.cancelled() or (latest_only and self._latest[latest_only] is not done):
            return
        error = done.exception()
        if error is None:
            on_result(done.result())
        elif on_error is None or not isinstance(error, Exception):
            raise error
        else:
            on_error(error)
