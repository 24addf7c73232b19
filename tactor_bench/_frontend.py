"""Terminal and notebook as front ends of a run: progress, prompts, interrupts."""

import _thread
import contextlib
import queue
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from types import FrameType
from typing import Any

from app.common import Severity, format_duration
from app.services import (
    KEY_HELP,
    STILL_ON,
    ConsoleObserver,
    ConsoleOperator,
    StderrConsole,
    answer_instructions,
    can_poll_keyboard,
    handling_stop_signals,
    match_answer,
    operator_reachable,
)
from app.session import BenchOpened, Session, SessionEvent, describe_event
from protocols.base import (
    BlockDiscarded,
    BlockStored,
    Operator,
    ProgressUpdated,
    Prompt,
    PromptAnswered,
    PromptShown,
    RunEnded,
    ShutdownStarted,
)

POLL_S = 0.1
"""Length of the pieces of a wait: an endless wait would keep Python from handling a signal."""


class FrontEnd(ABC):
    """Shows the events of a session and prompts the operator.

    Attributes:
        operator: operator of a bench without its own.
        stopped_by: signal that stopped the present run, None without one.
        failure: reason why the front end stopped the present run, empty if it did not.
    """

    operator: Operator

    def __init__(self, *, progress: bool) -> None:
        self._progress = progress
        self.stopped_by: int | None = None
        self.failure = ""
        self._session: Session | None = None
        self._real = False
        self._signalled = False

    def observe(self, event: SessionEvent) -> None:
        """Receive an event, in the session's thread."""
        if isinstance(event, BenchOpened):
            self._real = not event.simulated

    @property
    def operator_reachable(self) -> bool:
        """Whether prompts can be answered by this front end."""
        return True

    @abstractmethod
    def showing(self) -> AbstractContextManager[None]:
        """Show a run and read the keyboard, within the block."""

    @abstractmethod
    def wait(self, done: threading.Event) -> None:
        """Wait in the calling thread for the end of an operation, and show its events."""

    @contextmanager
    def running(self, session: Session) -> Iterator[None]:
        """Show a run; Ctrl-C, an interrupted kernel and SIGTERM stop it.

        Rest comes first, so a second interrupt changes nothing.
        """
        self.stopped_by, self.failure, self._session = None, "", session
        with self._signals(), self.showing():
            yield

    @contextmanager
    def _signals(self) -> Iterator[None]:
        if threading.current_thread() is not threading.main_thread():  # Python hands signals to the main thread only
            yield
            return
        with handling_stop_signals(self._stop):
            self._signalled = True
            try:
                yield
            finally:
                self._signalled = False

    def _stop(self, number: int, _frame: FrameType | None) -> None:
        self.stopped_by = number
        if self._session is not None:
            self._session.stop()

    def _lines(self, event: SessionEvent) -> list[str]:
        """Return the displayed lines of an event; without progress only lines for the operator."""
        message = describe_event(event)
        shown = message is not None and (
            self._progress or message[0] is Severity.ERROR or isinstance(event, PromptShown)
        )
        lines = [message[1]] if message is not None and shown else []
        return [STILL_ON, *lines] if isinstance(event, RunEnded) and self._real else lines


class TerminalFrontEnd(FrontEnd):
    """Progress on standard error and prompts on standard input, like `tactor-bench run`."""

    def __init__(self, *, progress: bool) -> None:
        super().__init__(progress=progress)
        self.operator: ConsoleOperator = ConsoleOperator()
        self._shown: Callable[[SessionEvent], None] = self._observer()

    @property
    def operator_reachable(self) -> bool:
        return operator_reachable()

    def observe(self, event: SessionEvent) -> None:
        super().observe(event)
        self._shown(event)
        self.operator(event)

    @contextmanager
    def showing(self) -> Iterator[None]:
        self._shown = observer = self._observer(KEY_HELP if can_poll_keyboard() else "")
        live = observer if isinstance(observer, ConsoleObserver) else contextlib.nullcontext()
        try:
            with live, self.operator.listening(self._session) if self._session else contextlib.nullcontext():
                yield
        finally:
            self._shown = self._observer()

    def wait(self, done: threading.Event) -> None:
        while not done.wait(POLL_S):
            pass

    def _observer(self, keys: str = "") -> Callable[[SessionEvent], None]:
        return ConsoleObserver(StderrConsole(), keys, not self._real) if self._progress else self._filtered

    def _filtered(self, event: SessionEvent) -> None:
        for line in self._lines(event):
            sys.stderr.write(f"{line}\n")


class NotebookFrontEnd(FrontEnd):
    """A line per message and one line of progress under the cell, prompts by `input()`: all in the kernel's main thread.

    The session's thread only puts into a queue, which `wait` empties.
    """

    def __init__(self, *, progress: bool) -> None:
        super().__init__(progress=progress)
        self.operator: Operator = self
        self._queue: queue.SimpleQueue[SessionEvent | tuple[int, Prompt]] = queue.SimpleQueue()
        self._answers: dict[int, str] = {}
        self._waiting: int | None = None
        self._reading = False
        self._withdrawn = False
        self._bar: Any = None

    def show(self, ask_id: int, prompt: Prompt) -> None:
        """Queue a prompt; in the session's thread."""
        self._waiting = ask_id
        self._queue.put((ask_id, prompt))

    def answer(self, ask_id: int) -> str | None:
        """Return the answer, or None before it was given; called in the session's thread."""
        return self._answers.pop(ask_id, None)

    def observe(self, event: SessionEvent) -> None:
        super().observe(event)
        if isinstance(event, BlockStored | BlockDiscarded):
            return
        self._queue.put(event)
        if isinstance(event, PromptAnswered | RunEnded) and self._waiting is not None:
            self._waiting = None
            if self._reading and self._signalled:  # the laser answered: `input()` ends as by an interrupt
                self._withdrawn = True
                _thread.interrupt_main()

    @contextmanager
    def showing(self) -> Iterator[None]:
        self._bar = None
        try:
            yield
        finally:
            self._show_queued()

    def wait(self, done: threading.Event) -> None:
        while not done.is_set():
            with contextlib.suppress(queue.Empty):
                self._take(self._queue.get(timeout=POLL_S))
        self._show_queued()

    def _show_queued(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                self._take(self._queue.get_nowait())

    def _take(self, item: "SessionEvent | tuple[int, Prompt]") -> None:
        if isinstance(item, tuple):
            self._ask(*item)
            return
        if self._progress and isinstance(item, ProgressUpdated | ShutdownStarted | RunEnded):
            self._show_progress(item)
        if isinstance(item, PromptShown) and self._real:  # `_ask` shows it; a simulated bench has its own operator
            return
        for line in self._lines(item):
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()

    def _show_progress(self, event: ProgressUpdated | ShutdownStarted | RunEnded) -> None:
        line = str(event.verdict.outcome) if isinstance(event, RunEnded) else "going to rest"
        if isinstance(event, ProgressUpdated):
            left = f", {format_duration(event.left_s)} left" if event.done < event.entries else ""
            line = f"{event.done} of {event.entries} points{left}: {event.label}"
        from IPython.display import display

        bundle = {"text/plain": line}
        if self._bar is None:
            self._bar = display(bundle, raw=True, display_id=True)
        else:
            self._bar.update(bundle, raw=True)

    def _ask(self, ask_id: int, prompt: Prompt) -> None:
        """Ask until the prompt is answered by typing, by the laser, or by the end of the run."""
        label = f"{prompt.text} ({answer_instructions(prompt)}; interrupting the kernel stops the run) "
        while self._waiting == ask_id and self.stopped_by is None:
            try:
                typed = self._input(label)
            except KeyboardInterrupt:
                continue
            except (EOFError, RuntimeError) as error:  # IPython raises its own error if input is impossible
                self.failure = (
                    f"no operator can answer in this notebook ({error}), so the run was stopped: {prompt.text}"
                )
                if self._session is not None:
                    self._session.stop()
                return
            meant = match_answer(prompt, typed.strip())
            if meant is not None and self._waiting == ask_id:
                self._waiting = None
                self._answers[ask_id] = meant
            elif self._waiting == ask_id:
                label = f"That is not an answer. {label.removeprefix('That is not an answer. ')}"

    def _input(self, text: str) -> str:
        self._reading = True
        try:
            return input(text)
        finally:
            self._reading = False

    def _stop(self, number: int, frame: FrameType | None) -> None:
        if self._withdrawn:
            self._withdrawn = False
        else:
            super()._stop(number, frame)
        if self._reading:
            raise KeyboardInterrupt


def front_end(*, progress: bool) -> FrontEnd:
    """Return the front end of this process: a notebook if a kernel runs it, else the terminal."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return (NotebookFrontEnd if hasattr(shell, "kernel") else TerminalFrontEnd)(progress=progress)
