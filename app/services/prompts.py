"""Input during a run: answers to prompts, pause and resume by the keyboard, and signals that stop it."""

import contextlib
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from types import FrameType
from typing import Any

from app.common import UsageError, print_message
from app.config import BenchConfig
from app.session import Session
from protocols.base import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE, Prompt, PromptAnswered, Protocol, RunEnded

CONFIRMATION_WORDS = {ENABLE_HIGH_VOLTAGE.action: "on"}
"""Prompts of one choice that Enter alone does not answer, and the word that does: leaning on a key must not enable high
voltage."""

PAUSE_KEY = "p"
KEY_HELP = "p and Enter pauses, Ctrl-C stops the run"
POLL_PERIOD_S = 0.1
MAX_PROMPTS_NAMED = 4
"""Prompts that a rejection names; it counts the others."""


class ConsoleOperator:
    """Answers prompts from a terminal: Enter, a word (`CONFIRMATION_WORDS`), or the beginning of one of several choices.

    Only input typed after a prompt answers it; earlier input is discarded. Input is read in a thread, so that the card is
    emptied meanwhile. While `listening`, input without a pending prompt pauses and resumes the run.
    """

    def __init__(self) -> None:
        self._answers: dict[int, str] = {}
        self._pending: tuple[int, Prompt] | None = None
        self._listening = False
        self._run: Session | None = None
        self._terminal_gone = False
        self._input_lock = threading.Lock()
        """Held while a line is read and handled, and while a prompt is shown: no line falls between the two."""

    def __call__(self, event: Any) -> None:
        """Clear the pending prompt when the laser answered it or its run has ended (observer of events)."""
        if isinstance(event, PromptAnswered | RunEnded):
            self._pending = None

    @property
    def unreachable_reason(self) -> str:
        """Reason why prompts cannot be answered; empty at a terminal."""
        if self._terminal_gone:
            return "the terminal has been closed"
        return "" if operator_reachable() else "standard input is not a terminal"

    def show(self, ask_id: int, prompt: Prompt) -> None:
        if self._terminal_gone and self._run is not None:
            self._run.stop()
            return
        with self._input_lock:
            _discard_type_ahead()
            _print(f"{answer_instructions(prompt)}; Ctrl-C stops the run")
            self._pending = ask_id, prompt
        if not self._listening:
            threading.Thread(
                target=self._read_answer, args=(ask_id, prompt), name=f"prompt-{ask_id}", daemon=True
            ).start()

    def answer(self, ask_id: int) -> str | None:
        return self._answers.pop(ask_id, None)

    @contextlib.contextmanager
    def listening(self, run: Session) -> Iterator[None]:
        """Allow the operator at this terminal to pause the run."""
        self._run = run
        if not can_poll_keyboard():
            yield
            return
        over = threading.Event()
        thread = threading.Thread(target=self._listen, args=(run, over), name="keyboard")
        self._listening = True
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
            self._listening = False

    def _listen(self, run: Session, ended: threading.Event) -> None:
        keyboard = sys.stdin.fileno()
        while not ended.is_set():
            # Polled, not read: a background process that reads its terminal is stopped by the system.
            if not select.select([keyboard], [], [], POLL_PERIOD_S)[0]:
                continue
            if not _in_foreground(keyboard):
                ended.wait(POLL_PERIOD_S)
                continue
            with self._input_lock:
                if not select.select([keyboard], [], [], 0)[0]:  # discarded meanwhile
                    continue
                try:
                    typed = os.read(keyboard, 4096)
                except OSError:
                    typed = b""
                if not typed:
                    self._terminal_gone = True
                    if self._pending is not None:  # it can no longer be answered
                        run.stop()
                    return
                for line in typed.decode(errors="replace").splitlines():
                    self._handle_line(line.strip(), run)

    def _handle_line(self, typed: str, run: Session) -> None:
        if self._pending is not None:
            ask_id, prompt = self._pending
            self._take(ask_id, prompt, match_answer(prompt, typed) if typed.casefold() != PAUSE_KEY else None)
        elif run.pause_requested and typed.casefold() in ("", PAUSE_KEY):
            run.resume()
        elif typed.casefold() == PAUSE_KEY:
            _print("the run goes to rest and pauses there; Enter resumes it, Ctrl-C stops it")
            run.pause()
        elif typed:
            _print(f"no prompt is open; {KEY_HELP}")

    def _take(self, ask_id: int, prompt: Prompt, meant: str | None) -> bool:
        """Accept the meant answer, or explain how to answer; return whether there was an answer."""
        if meant is None:
            _print(f"that is not an answer: {answer_instructions(prompt)}; Ctrl-C stops the run")
            return False
        self._pending = None
        self._answers[ask_id] = meant
        return True

    def _read_answer(self, ask_id: int, prompt: Prompt) -> None:
        while line := sys.stdin.readline():
            if self._take(ask_id, prompt, match_answer(prompt, line.strip())):
                return
        _print(f"standard input has ended, so nobody can answer '{prompt.text}': the run is stopped")
        if self._run is not None:
            self._run.stop()


def _print(text: str) -> None:
    with contextlib.suppress(OSError):  # the terminal is closed: the run continues
        print_message(f"  {text}")


def can_poll_keyboard() -> bool:
    """Return whether keys can be polled: at a terminal, and not on Windows."""
    try:
        return os.name != "nt" and sys.stdin.isatty() and sys.stdin.fileno() >= 0
    except (AttributeError, OSError, ValueError):
        return False


def operator_reachable() -> bool:
    """Return whether prompts can be answered: standard input is a terminal."""
    try:
        return sys.stdin.isatty()
    except (AttributeError, ValueError):  # no standard input, or a closed one
        return False


def refuse_without_operator(config: BenchConfig, protocol: Protocol, prepare: Sequence[Prompt] = ()) -> None:
    """Raise UsageError that names the prompts of a run on a real bench."""
    texts = [prompt.text for prompt in prompts_of_run(protocol, config.amplifier.rest_v, prepare)]
    named = "; ".join(f"'{text}'" for text in texts[:MAX_PROMPTS_NAMED])
    more = f"; and {len(texts) - MAX_PROMPTS_NAMED} more" if len(texts) > MAX_PROMPTS_NAMED else ""
    raise UsageError(
        f"{protocol.title} on {config.name} needs an operator, and standard input is not a terminal, so nobody can answer: "
        f"{named}{more}. Nothing was moved. Start it at a terminal (over the network: ssh -t, or tmux), or in the window"
    )


def prompts_of_run(protocol: Protocol, rest_v: float, prepare: Sequence[Prompt] = ()) -> list[Prompt]:
    """Return the prompts known in advance: high voltage, preparation, and the first of each set-up."""
    setups = [entry.setup for entry in protocol.plan(rest_v) if entry.setup is not None]
    switches = [DISABLE_HIGH_VOLTAGE, *([ENABLE_HIGH_VOLTAGE] if protocol.high_voltage else [])]
    prompts: list[Prompt] = []
    for prompt in (*switches, *prepare, *setups):
        if prompt not in prompts:
            prompts.append(prompt)
    return prompts


def _in_foreground(keyboard: int) -> bool:
    """Return whether this program is in the terminal's foreground; true if the terminal has no foreground group."""
    try:
        return os.tcgetpgrp(keyboard) == os.getpgrp()
    except OSError:
        return True


def answer_instructions(prompt: Prompt) -> str:
    """Return the instruction how to answer a prompt."""
    if word := CONFIRMATION_WORDS.get(prompt.action):
        return f"type '{word}' and press Enter"
    if len(prompt.choices) == 1:
        return "press Enter when it is done"
    return f"type {' or '.join(f'{choice[0]} ({choice})' for choice in prompt.choices)} and press Enter"


def match_answer(prompt: Prompt, typed: str) -> str | None:
    """Return the answer that the input means, or None if it is not an answer."""
    if word := CONFIRMATION_WORDS.get(prompt.action):
        return typed if typed.casefold() == word else None
    if len(prompt.choices) == 1:
        return typed or prompt.choices[0]
    meant = [choice for choice in prompt.choices if typed and choice.casefold().startswith(typed.casefold())]
    return meant[0] if len(meant) == 1 else None


def _discard_type_ahead() -> None:
    """Discard input typed before the prompt; the lines of a pipe are kept."""
    if not sys.stdin.isatty():
        return
    if sys.platform == "win32":
        import msvcrt

        while msvcrt.kbhit():
            msvcrt.getwch()
    else:
        import termios

        termios.tcflush(sys.stdin, termios.TCIFLUSH)


@contextlib.contextmanager
def handling_stop_signals(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Handle Ctrl-C, SIGTERM and the end of the terminal; afterwards the previous handlers are back."""
    numbers = [signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])]
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, signal.SIG_DFL if previous is None else previous)
