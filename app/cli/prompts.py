"""The keyboard of a terminal during a run: prompts are answered, and between them a run is paused and goes on."""

import contextlib
import os
import select
import sys
import threading
from collections.abc import Iterator
from typing import Any, Protocol

from protocols.base.events import PromptAnswered, RunEnded
from protocols.base.operator import ENABLE_HIGH_VOLTAGE
from protocols.base.steps import Prompt

CONFIRMATION_WORDS = {ENABLE_HIGH_VOLTAGE.action: "on"}
"""Prompts of one choice that a bare Enter does not answer, and the word that does: nobody enables high voltage by leaning
on a key."""

PAUSE_KEY = "p"
KEY_HELP = "p and Enter pauses, Ctrl-C stops the run"
POLL_PERIOD_S = 0.1


class Pausable(Protocol):
    """What is paused: a session."""

    @property
    def pause_requested(self) -> bool: ...

    def pause(self) -> None: ...

    def resume(self) -> None: ...


class ConsoleOperator:
    """Prompts answered on a terminal: by Enter, by a word (`CONFIRMATION_WORDS`), or by the beginning of one of several choices.

    Only what is typed after a prompt answers it: what lay waiting is thrown away. Reads in a thread, so that the card is
    emptied meanwhile. While `listening`, what is typed where nothing is asked pauses the run and lets it go on.
    """

    def __init__(self) -> None:
        self._answers: dict[int, str] = {}
        self._pending: tuple[int, Prompt] | None = None
        self._listening = False
        self._input_lock = threading.Lock()
        """Held while a line is read and understood, and while one is asked for: no line falls between the two."""

    def __call__(self, event: Any) -> None:
        """An observer: a prompt that the laser answered, or whose run has ended, is none any more."""
        if isinstance(event, PromptAnswered | RunEnded):
            self._pending = None

    def show(self, ask_id: int, prompt: Prompt) -> None:
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
    def listening(self, run: Pausable) -> Iterator[None]:
        """Meanwhile a person at this terminal may pause the run."""
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

    def _listen(self, run: Pausable, ended: threading.Event) -> None:
        keyboard = sys.stdin.fileno()
        while not ended.is_set():
            # Looked at, not waited for in a read: whoever reads a terminal from the background is halted.
            if not select.select([keyboard], [], [], POLL_PERIOD_S)[0]:
                continue
            if not _in_foreground(keyboard):
                ended.wait(POLL_PERIOD_S)
                continue
            with self._input_lock:
                if not select.select([keyboard], [], [], 0)[0]:  # thrown away meanwhile
                    continue
                try:
                    typed = os.read(keyboard, 4096)
                except OSError:
                    typed = b""
                if not typed:  # the terminal has gone
                    return
                for line in typed.decode(errors="replace").splitlines():
                    self._handle_line(line.strip(), run)

    def _handle_line(self, typed: str, run: Pausable) -> None:
        if self._pending is not None:
            ask_id, prompt = self._pending
            meant = match_answer(prompt, typed) if typed.casefold() != PAUSE_KEY else None
            if meant is None:
                _print(f"that is no answer: {answer_instructions(prompt)}; Ctrl-C stops the run")
            else:
                self._pending = None
                self._answers[ask_id] = meant
        elif run.pause_requested and typed.casefold() in ("", PAUSE_KEY):
            run.resume()
        elif typed.casefold() == PAUSE_KEY:
            _print("the run goes to rest and pauses there; Enter lets it go on, Ctrl-C stops it")
            run.pause()
        elif typed:
            _print(f"nothing is asked now; {KEY_HELP}")

    def _read_answer(self, ask_id: int, prompt: Prompt) -> None:
        while line := sys.stdin.readline():
            meant = match_answer(prompt, line.strip())
            if meant is not None:
                self._pending = None
                self._answers[ask_id] = meant
                return
            _print(f"that is no answer: {answer_instructions(prompt)}; Ctrl-C stops the run")
        _print("standard input has ended, so nobody can answer here: the run waits until it is stopped")


def _print(text: str) -> None:
    with contextlib.suppress(OSError):  # nobody reads it any more: the run goes on
        sys.stderr.write(f"  {text}\n")


def can_poll_keyboard() -> bool:
    """Whether keys can be looked for without waiting: at a terminal, and not on Windows."""
    try:
        return os.name != "nt" and sys.stdin.isatty() and sys.stdin.fileno() >= 0
    except (AttributeError, OSError, ValueError):
        return False


def _in_foreground(keyboard: int) -> bool:
    """Whether this program is in the terminal's foreground. Where that cannot be told, it is no terminal of a shell."""
    try:
        return os.tcgetpgrp(keyboard) == os.getpgrp()
    except OSError:
        return True


def answer_instructions(prompt: Prompt) -> str:
    """How a prompt is answered, in words."""
    if word := CONFIRMATION_WORDS.get(prompt.action):
        return f"type '{word}' and press Enter"
    if len(prompt.choices) == 1:
        return "press Enter when it is done"
    return f"type {' or '.join(f'{choice[0]} ({choice})' for choice in prompt.choices)} and press Enter"


def match_answer(prompt: Prompt, typed: str) -> str | None:
    """The answer that what was typed means; None where it is none."""
    if word := CONFIRMATION_WORDS.get(prompt.action):
        return typed if typed.casefold() == word else None
    if len(prompt.choices) == 1:
        return typed or prompt.choices[0]
    meant = [choice for choice in prompt.choices if typed and choice.casefold().startswith(typed.casefold())]
    return meant[0] if len(meant) == 1 else None


def _discard_type_ahead() -> None:
    """Throw away what was typed before it was asked for. A pipe is not a person and keeps its lines."""
    if not sys.stdin.isatty():
        return
    try:
        import termios

        termios.tcflush(sys.stdin, termios.TCIFLUSH)
    except ImportError:
        _discard_keys()


def _discard_keys() -> None:
    if sys.platform == "win32":
        import msvcrt

        while msvcrt.kbhit():
            msvcrt.getwch()
