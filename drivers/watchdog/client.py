"""The program's side of the watchdog: a small process that brings the source to rest if this one dies or hangs.

The run thread beats with every block it reads and every step it commands, and a second thread tells that the
interpreter runs at all. `drivers.watchdog.process` listens; when it hears nothing while the bench is live, it goes to
rest over a connection of its own (docs/decisions/0020-watchdog.md).
"""

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from drivers.bench.watchdog_interface import BEAT_S
from drivers.errors import BenchError
from drivers.watchdog.config import Charge
from drivers.watchdog.subprocesses import end

START_S = 15.0
DEAF_S = 3.0
"""A watchdog that has said nothing for so long while the bench is live does not watch any more."""

WIRE_MARGIN_S = 1.0
RESCUE_S = 12.0
TAKEOVER_S = 40.0


class WatchdogProcess:
    """A `drivers.bench.watchdog_interface.Watchdog` in a process of its own. It starts at once and is waited for when the bench is armed."""

    words = ""

    def __init__(self, charge: Charge) -> None:
        self._charge = charge
        self._folder: Path | None = None
        self._changed = threading.Condition()
        self._writing = threading.Lock()
        self._promise_s = charge.silence_s
        self._live = threading.Event()
        self._takeovers = self._seen = 0
        self._start()

    @property
    def pid(self) -> int:
        return self._child.pid

    def log_to(self, folder: Path) -> None:
        self._folder = folder.resolve()
        self._send(f"log {self._folder}")

    def arm(self) -> None:
        if not self._heard_of():
            self.close()
            self._start()  # one that ended since the last run is replaced; one that ends again is told
            if not self._heard_of():
                raise BenchError(
                    f"the watchdog does not watch{': ' + self._failed if self._failed else ''}. The bench does not go live "
                    "without it: mend that, or write 'enabled = false' under [watchdog] in the bench file"
                )
        self._acted, self._seen = "", self._takeovers
        self._last = self._beaten = time.monotonic()
        self._send("live")
        self._live.set()

    def beat(self) -> None:
        if not self._live.is_set():
            return
        if time.monotonic() - self._beaten > self._charge.silence_s:
            # We were held up, perhaps stopped: what it did meanwhile is still on its way to us.
            with self._changed:
                self._changed.wait_for(lambda: bool(self._acted or self._ended), 2 * BEAT_S)
        self._beaten = time.monotonic()
        self._send(f"beat {self._promise_s:.3f}")

    def check(self) -> None:
        if not self._live.is_set():
            return
        if self._acted:
            raise BenchError(f"the watchdog took the source over: {self._acted}")
        if self._ended or time.monotonic() - self._last > DEAF_S:
            how = f"has ended (code {self._child.poll()})" if self._ended else f"has said nothing for {DEAF_S:g} s"
            raise BenchError(
                f"the watchdog {how}, and the bench does not stay live without it. Look for what ended it (too little "
                "memory, a task manager), then run again"
            )

    @contextlib.contextmanager
    def allow(self, seconds: float | None = None) -> Iterator[None]:
        before, takeovers = self._promise_s, self._seen
        self._promise_s = max(before, self._charge.timeout_s + WIRE_MARGIN_S if seconds is None else seconds)
        self.beat()
        if self._busy:
            with self._changed:
                self._changed.wait_for(lambda: self._ended or not self._busy, TAKEOVER_S)
        self._seen = self._takeovers
        try:
            yield
        finally:
            self._promise_s, self._seen = before, takeovers
            self.beat()

    def interrupt(self) -> None:
        if self._live.is_set() and self._takeovers != self._seen:
            raise BenchError(f"the watchdog took the source over: {self._acted}")

    def rescue(self, why: str) -> str:
        self._told = ""
        self._send(f"help {_line(why)}")
        with self._changed:
            self._changed.wait_for(lambda: bool(self._told or self._ended), RESCUE_S)
        return self._told or "the watchdog did not answer"

    def note(self, words: str) -> None:
        self._send(f"note {_line(words)}")

    def disarm(self) -> None:
        self._live.clear()
        self._send("rest")

    def close(self) -> None:
        self._live.clear()
        self._send("bye")
        self._closing.set()
        end(self._child)
        for thread in (self._listener, self._pulse):
            thread.join()
        if self._child.stdout is not None:
            self._child.stdout.close()

    def _start(self) -> None:
        root = str(Path(__file__).resolve().parents[2])
        self._child = subprocess.Popen(
            [sys.executable, "-m", "drivers.watchdog.process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH")))),
                "OPENBLAS_NUM_THREADS": "1",
            },
            # A Ctrl-C or Ctrl-Z at the terminal is not for the watchdog.
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
        self._ready = self._failed = self._acted = self._told = ""
        self._busy = self._ended = False
        self._last = self._beaten = time.monotonic()
        self._closing = threading.Event()
        self._send(self._charge.as_line())
        if self._folder is not None:
            self._send(f"log {self._folder}")
        self._listener = threading.Thread(target=self._listen, name="watchdog's words", daemon=True)
        self._pulse = threading.Thread(target=self._beat_of_the_interpreter, name="watchdog's pulse", daemon=True)
        self._listener.start()
        self._pulse.start()

    def _heard_of(self) -> bool:
        """Whether it watches; waits for one that is still starting."""
        with self._changed:
            self._changed.wait_for(lambda: bool(self._ready or self._failed or self._ended), START_S)
        return bool(self._ready) and not self._ended

    def _listen(self) -> None:
        if self._child.stdout is not None:
            for line in self._child.stdout:
                self._hear(*line.rstrip("\n").partition(" ")[::2])
        with self._changed:
            self._ended, self._busy = True, False
            self._changed.notify_all()

    def _hear(self, word: str, words: str) -> None:
        with self._changed:
            self._last = time.monotonic()
            match word:
                case "ready":
                    self._ready = words
                case "failed":
                    self._failed = words
                case "acting":
                    self._busy, self._acted = True, words
                    self._takeovers += 1
                case "done" | "could-not":
                    self._busy, self._told = False, words
            self._changed.notify_all()

    def _beat_of_the_interpreter(self) -> None:
        while not self._closing.wait(BEAT_S):
            if self._live.is_set():
                self._send("pulse")

    def _send(self, line: str) -> None:
        """Tell it something. That it has ended is noticed by `check`, and a hung one before its pipe is full."""
        stdin = self._child.stdin
        if stdin is not None and not stdin.closed:
            with self._writing, contextlib.suppress(OSError, ValueError):
                stdin.write(line + "\n")
                stdin.flush()


def _line(words: str) -> str:
    return " ".join(words.split())
