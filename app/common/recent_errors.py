"""Recent log records and uncaught errors of this process, for a problem report."""

import logging
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from types import TracebackType

MAX_RECORDS, MAX_ERRORS = 1000, 20


class _RecentRecords(logging.Handler):
    def __init__(self, records: deque[str]) -> None:
        super().__init__(logging.INFO)
        self._records = records
        self.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(threadName)s %(name)s: %(message)s"))

    def emit(self, record: logging.LogRecord) -> None:
        self._records.append(self.format(record))


class RecentErrors:
    """The last log records and uncaught errors of this process."""

    def __init__(self) -> None:
        self.records: deque[str] = deque(maxlen=MAX_RECORDS)
        self.errors: deque[str] = deque(maxlen=MAX_ERRORS)

    @contextmanager
    def observe(self, on_error: Callable[[], object]) -> Iterator[None]:
        """Note log records and uncaught errors of all threads until the end, and call `on_error` after each of the latter."""
        handler, hook, thread_hook = _RecentRecords(self.records), sys.excepthook, threading.excepthook

        def note(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
            self.note(error.with_traceback(trace))
            hook(kind, error, trace)
            on_error()

        def note_of_thread(arguments: threading.ExceptHookArgs) -> None:
            if arguments.exc_value is not None:
                self.note(arguments.exc_value, arguments.thread.name if arguments.thread is not None else "")
            thread_hook(arguments)
            on_error()

        logging.getLogger().addHandler(handler)
        sys.excepthook, threading.excepthook = note, note_of_thread
        try:
            yield
        finally:
            sys.excepthook, threading.excepthook = hook, thread_hook
            logging.getLogger().removeHandler(handler)

    def note(self, error: BaseException, thread: str = "main") -> None:
        """Note an error."""
        lines = "".join(traceback.format_exception(error))
        self.errors.append(f"{datetime.now(UTC).isoformat(timespec='seconds')} in thread {thread}\n{lines}")
