"""Deadlines: the longest time of every call that leaves the process, and threads whose calls can be given up."""

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable, Iterator
from enum import Enum
from typing import Any, TypeVar

T = TypeVar("T")


class Deadline(Enum):
    """Longest times of calls. docs/make_reference.py prints them into docs/reference/deadlines.md.

    Attributes:
        calls: what is called.
        seconds: real time, beyond what the call itself was told to wait for.
        then: what follows when it has passed, where that is not an error of the call like any other.
    """

    CARD_SERVER = (
        "the card at a gRPC device server, or a LabJack: each call",
        4.0,
        "every further call on this connection fails at once; the next task connects anew",
    )
    CARD_BLOCK = "the card: a block of samples, beyond its duration", 5.0
    CARD_OUTPUT = "the card: writing samples of a drive", 5.0
    CARD_DRIVER = (
        "the card: calls of NI's driver in this computer, which cannot be broken off, with the waits between them",
        20.0,
        "the run is given up, and its thread is left behind",
    )
    SOURCE_SETUP = (
        "the source, with high voltage off: its driver's set-up or self-test at arming",
        120.0,
        "the run is given up, and its thread is left behind",
    )
    SOURCE_OPENING = (
        "VISA and serial ports: looking up the address, connecting",
        5.0,
        "the thread of the call is left behind",
    )
    SOURCE_CALL = (
        "VISA and serial ports: a message or a reply, beyond `timeout_s` and the time of its bytes on a serial line",
        3.0,
        "the thread of the call is left behind; the next attempt connects anew",
    )
    DISK = (
        "the run file: opening, appending, finishing",
        10.0,
        "the run ends *failed* at measured rest; the thread of the call is left behind, and the next start repairs the file",
    )
    ANALYSIS = "the analysis of a recording, beyond its duration", 120.0, "the run ends *failed* at measured rest"
    WAY_TO_REST = (
        "the way to rest: repeating what failed over new connections, under the warning that the specimen may be live",
        5.0,
        "the run is UNSAFE",
    )
    RUN_THREAD = (
        "the thread of a live run: a sign of life, beyond the silence that is allowed at that moment",
        15.0,
        "the run is given up: the watchdog, or else a new connection, brings the source to rest, and the run is UNSAFE",
    )
    BENCH_OPENING = "a bench: opening all of its instruments", 120.0, "it is given up; nothing was driven"
    STOP_ANSWER = (
        "Ctrl-C, and Stop: a sign of life",
        1.5,
        "the terminal and the window say for what the program waits; before arming, Ctrl-C ends it",
    )
    EARLY_STOP = "Stop in the window before arming: a sign of life", 10.0, "the bench is given up; nothing was driven"
    STOPPED_RUN = "a stopped run: computing and storing its result", 60.0, "the run is given up"
    BENCH_CLOSING = "a bench: closing it; the program: its end after UNSAFE", 15.0, "the process ends all the same"
    WATCHDOG_START = "the watchdog: its start", 15.0, "the bench does not go live"
    WATCHDOG_ATTEMPT = "the watchdog: its first attempt at bringing the source to rest", 40.0, "the program acts, too"
    WATCHDOG_REQUEST = "the watchdog: bringing the source to rest at the program's request", 12.0
    INSTRUMENT_LOCK = "the lock of an instrument, while the watchdog of a dead program has it", 10.0
    CHILD_EXIT = "a child process: its end after its standard input was closed", 5.0, "it is killed"
    SIMULATED_BENCH = "the process of a simulated bench: its start, and each reply", 20.0
    SUSPEND_INHIBITOR = (
        "the process that keeps the computer from suspending: its start and its end",
        3.0,
        "it is killed",
    )
    NOTES_LOCK = "the lock of a run's notes or of an audit trail", 30.0
    RUN_INDEX = "the lock of the index of a folder", 10.0
    AFTER_RUN = "the command of `--after-run`", 600.0, "it is killed"
    MAT_READER = "the process that reads a MATLAB file", 120.0, "it is killed"
    SIGNATURE = "`ssh-keygen`, which may ask for a passphrase: signing a report", 120.0, "it is killed"
    WEB_REQUEST = "web pages: a request, from its connection to its last byte", 5.0, "the connection is closed"
    WEB_ANSWER = (
        "web pages: a request and its answer, such as a download",
        120.0,
        "the connection is closed, and what is computed for it is given up",
    )

    def __init__(self, calls: str, seconds: float, then: str = "") -> None:
        self.calls, self.seconds, self.then = calls, seconds, then


class OverdueError(Exception):
    """A call did not return within its deadline; its thread was left behind."""


class AbandonableThread(threading.Thread):
    """A thread that can be given up: nobody waits for it any more."""

    given_up = False


class CallThread(AbandonableThread):
    """Makes the calls of one connection or file one after the other, so that a caller can give one up that does not return.

    The thread begins with its connection: where memory is short, a call must not need a new one.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name=name, daemon=True)
        self._calls: queue.SimpleQueue[tuple[Callable[[], Any], queue.SimpleQueue[Any]] | None] = queue.SimpleQueue()
        self._ended = False
        self.start()

    def run(self) -> None:
        while not self.given_up and (call := self._calls.get()) is not None:
            action, outcome = call
            try:
                outcome.put((action(), None))
            except BaseException as error:  # noqa: BLE001 - it is raised in the caller
                outcome.put((None, error))
            del action, outcome, call  # else they live until the next call

    def call(
        self,
        action: Callable[[], T],
        seconds: float,
        meanwhile: Callable[[], object] = lambda: None,
        every_s: float = math.inf,
    ) -> T:
        """Return the result of `action`, or raise its exception, in this thread; call `meanwhile` at short intervals.

        Raises:
            OverdueError: it did not return within `seconds`, or an earlier call did not.
        """
        if self._ended or threading.current_thread() is self:
            return action()
        if self.given_up:
            raise OverdueError(f"an earlier call of '{self.name}' has not returned")
        outcome: queue.SimpleQueue[tuple[T, BaseException | None]] = queue.SimpleQueue()
        self._calls.put((action, outcome))
        until_s = time.monotonic() + seconds
        while True:
            try:
                value, error = outcome.get(timeout=max(min(until_s - time.monotonic(), every_s), 0.0))
                break
            except queue.Empty:
                if time.monotonic() >= until_s:
                    self.given_up = True
                    raise OverdueError(f"a call has not returned within {seconds:.3g} s") from None
            meanwhile()
        if error is not None:
            try:
                raise error
            finally:
                del error  # its traceback refers to this frame
        return value

    def end(self) -> None:
        """End the thread after the calls that were made; further ones are made by their callers."""
        self._ended = not self.given_up
        self._calls.put(None)


def threads_left_behind() -> list[str]:
    """Return the names of the threads that were given up and have not ended. Python would wait for them at its end."""
    return [
        thread.name for thread in threading.enumerate() if isinstance(thread, AbandonableThread) and thread.given_up
    ]


_IN_PROGRESS: dict[int, dict[Deadline, float]] = {}
"""Calls that cannot be broken off, by the thread that makes them: which, and since when."""


@contextlib.contextmanager
def in_progress(deadline: Deadline) -> Iterator[None]:
    """Note that this thread makes calls that only `overdue` of another thread notices; an outer one of the same kind counts."""
    calls = _IN_PROGRESS.setdefault(threading.get_ident(), {})
    if deadline in calls:
        yield
        return
    calls[deadline] = time.monotonic()
    try:
        yield
    finally:
        del calls[deadline]
        if not calls:
            del _IN_PROGRESS[threading.get_ident()]


def overdue(thread: threading.Thread) -> tuple[Deadline, float]:
    """Return which calls of a thread are longest beyond their deadline, and for how many seconds; negative if none is."""
    now_s, calls = time.monotonic(), dict(_IN_PROGRESS.get(thread.ident or 0, {}))
    late = [(deadline, now_s - since_s - deadline.seconds) for deadline, since_s in calls.items()]
    return max(late, key=lambda each: each[1], default=(Deadline.CARD_DRIVER, -math.inf))
