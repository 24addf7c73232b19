"""Watchdog client: starts the process that brings the source to rest if this program is killed or hangs.

The run thread sends a heartbeat with every block it reads and every step it commands, and a second thread reports that the
interpreter runs. If `drivers.watchdog.process` receives neither while the bench is live, it brings the source to rest over its
own connection (docs/decisions/0020-watchdog.md).
"""

import contextlib
import json
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from drivers.bench import HEARTBEAT_PERIOD_S
from drivers.deadlines import Deadline
from drivers.drive_shapes import LevelPulse
from drivers.errors import BenchError
from drivers.watchdog.config import WatchdogConfig
from drivers.watchdog.hang_detection import ProcessActivity
from drivers.watchdog.origin import describe_copy
from drivers.watchdog.subprocesses import python_command, python_environment, terminate

WATCHDOG_SILENCE_S = 1.0
"""Longest silence of the watchdog while the bench is live; after it the watchdog counts as dead. It reports four times a second."""

REPLY_MARGIN_S = 1.0


class WatchdogClient:
    """A `Watchdog` (see drivers.bench.watchdog_interface) in a separate process; `arm` waits until it is ready."""

    inactive_reason = ""
    _failed: str
    _process: ProcessActivity

    def __init__(self, config: WatchdogConfig) -> None:
        self._config = config
        self.notices_after_s = config.silence_s
        self._log_folder: Path | None = None
        self._changed = threading.Condition()
        self._write_lock = threading.Lock()
        self._allowed_silence_s = config.silence_s
        self._live = threading.Event()
        self._takeovers = self._takeovers_at_allow = 0
        self._taking_over = self._failing = False
        """Whether the watchdog commands the source, and whether its first attempt has failed."""
        self._start()

    @property
    def pid(self) -> int:
        return self._child.pid

    @property
    def overdue_s(self) -> float:
        return time.monotonic() - self._last_heartbeat_s - self._allowed_silence_s if self._live.is_set() else 0.0

    def set_log_folder(self, folder: Path) -> None:
        self._log_folder = folder.resolve()
        self._send(f"log {self._log_folder}")

    def arm(self) -> None:
        if not self._wait_until_ready():
            self.close()
            self._start()  # a watchdog that ended since the last run is replaced; one that ends again is reported
            if not self._wait_until_ready():
                raise BenchError(
                    f"the watchdog does not watch{': ' + self._failed if self._failed else ''}. The bench does not go live "
                    "without it: mend that, or switch off 'enabled' of the bench's watchdog"
                )
        self.takeover_reason = self.takeover_outcome = ""
        self.brought_to_rest, self._takeovers_at_allow = False, self._takeovers
        self._process.skip_pause()  # it was not observed at rest
        self._last_line, self._last_heartbeat_s = self._process.mark(), time.monotonic()
        self._send("live")
        self._live.set()
        self._observes.set()

    def send_heartbeat(self) -> None:
        if not self._live.is_set():
            return
        if time.monotonic() - self._last_heartbeat_s > self._config.silence_s:
            # This process was delayed, possibly stopped: reports of the watchdog may still be in the pipe.
            with self._changed:
                self._changed.wait_for(lambda: bool(self.takeover_reason or self._ended), 2 * HEARTBEAT_PERIOD_S)
        self._last_heartbeat_s = time.monotonic()
        self._send(f"beat {self._allowed_silence_s:.3f}")

    def raise_for_status(self) -> None:
        if not self._live.is_set():
            return
        if self.takeover_reason:
            raise BenchError(f"the watchdog took the source over: {self.takeover_reason}")
        silence = self._process.since(self._last_line)
        if self._ended or silence.exceeds(WATCHDOG_SILENCE_S):
            how = (
                f"has ended (code {self._child.poll()})"
                if self._ended
                else f"has sent nothing for {silence.elapsed_s:.1f} s"
            )
            raise BenchError(
                f"the watchdog {how}, and the bench does not stay live without it. Find the cause (too little "
                "memory, a task manager), then run again"
            )

    @contextlib.contextmanager
    def allow_silence(self, seconds: float | None = None) -> Iterator[None]:
        before, takeovers = self._allowed_silence_s, self._takeovers_at_allow
        self._allowed_silence_s = max(
            before, self._config.longest_reply_s + REPLY_MARGIN_S if seconds is None else seconds
        )
        self.send_heartbeat()
        if self._taking_over:
            with self._changed:
                self._changed.wait_for(
                    lambda: self._ended or self._failing or not self._taking_over, Deadline.WATCHDOG_ATTEMPT.seconds
                )
                if self._failing:
                    self._send("mine")
                    self._changed.wait_for(
                        lambda: self._ended or not self._taking_over, Deadline.WATCHDOG_REQUEST.seconds
                    )
            self.send_heartbeat()
        self._takeovers_at_allow = self._takeovers
        try:
            yield
        finally:
            self._allowed_silence_s, self._takeovers_at_allow = before, takeovers
            self.send_heartbeat()

    def raise_if_taken_over(self) -> None:
        if self._live.is_set() and self._takeovers != self._takeovers_at_allow:
            raise BenchError(f"the watchdog took the source over: {self.takeover_reason}")

    def request_rest(self, reason: str) -> str:
        self.takeover_outcome = ""
        self._send(f"help {_single_line(reason)}")
        with self._changed:
            # Two attempts, with their time beside Stop.
            self._changed.wait_for(
                lambda: bool(self.takeover_outcome or self._ended),
                Deadline.WATCHDOG_REQUEST.seconds + self._config.retry_time_s(0.0),
            )
        return self.takeover_outcome or "the watchdog did not answer"

    def note_level(self, pulse: LevelPulse, remaining_s: float) -> None:
        self._send(f"level {json.dumps({'remaining_s': remaining_s, **asdict(pulse)})}")

    def forget_level(self) -> None:
        self._send("level")

    def log(self, message: str) -> None:
        self._send(f"note {_single_line(message)}")

    def disarm(self) -> None:
        self._live.clear()
        self._observes.clear()
        self._send("rest")

    def close(self) -> None:
        self._live.clear()
        self._send("bye")
        self._closing.set()
        self._observes.set()  # its thread ends
        terminate(self._child)
        for thread in (self._listener_thread, self._pulse_thread):
            thread.join()
        if self._child.stdout is not None:
            self._child.stdout.close()

    def _start(self) -> None:
        self._child = subprocess.Popen(  # noqa: S603 - this very Python
            python_command("-m", "drivers.watchdog.process"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            env=python_environment(),
            # A Ctrl-C or Ctrl-Z at the terminal is not for the watchdog.
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
        self._ready = self._failed = self.takeover_reason = self.takeover_outcome = ""
        self._taking_over = self._failing = self._ended = self.brought_to_rest = False
        self._process = ProcessActivity(self._child.pid)
        self._last_line, self._last_heartbeat_s = self._process.mark(), time.monotonic()
        self._closing, self._observes = threading.Event(), threading.Event()
        self._send(self._config.as_line())
        if self._log_folder is not None:
            self._send(f"log {self._log_folder}")
        self._listener_thread = threading.Thread(target=self._listen, name="watchdog listener", daemon=True)
        self._pulse_thread = threading.Thread(target=self._send_pulses, name="watchdog pulse", daemon=True)
        self._listener_thread.start()
        self._pulse_thread.start()

    def _wait_until_ready(self) -> bool:
        """Wait for the process to start; return whether it is ready."""
        with self._changed:
            self._changed.wait_for(
                lambda: bool(self._ready or self._failed or self._ended), Deadline.WATCHDOG_START.seconds
            )
        return bool(self._ready) and not self._ended

    def _listen(self) -> None:
        if self._child.stdout is not None:
            for line in self._child.stdout:
                self._handle_line(*line.rstrip("\n").partition(" ")[::2])
        with self._changed:
            self._ended, self._taking_over = True, False
            self._changed.notify_all()

    def _handle_line(self, keyword: str, text: str) -> None:
        with self._changed:
            self._last_line = self._process.mark()
            match keyword:
                case "ready" if text == describe_copy():
                    self._ready = text
                case "ready":
                    self._failed = (
                        f"the process that was started is another copy of this program, version {text}, while this one is "
                        f"version {describe_copy()}; restart this program"
                    )
                case "failed":
                    self._failed = text
                case "acting":
                    self._taking_over, self.takeover_reason = True, text
                    self._takeovers += 1
                case "failing":
                    self._failing = True
                case "done" | "could-not":
                    self._taking_over = self._failing = False
                    self.brought_to_rest, self.takeover_outcome = keyword == "done", text
            self._changed.notify_all()

    def _send_pulses(self) -> None:
        while self._observes.wait() and not self._closing.wait(HEARTBEAT_PERIOD_S):
            with contextlib.suppress(MemoryError):  # without pulses the watchdog would take the source over
                self._process.update()
            if self._live.is_set():
                self._send("pulse")

    def _send(self, line: str) -> None:
        """Send a line. `raise_for_status` detects a watchdog that has ended, and a hung one before its pipe is full."""
        stdin = self._child.stdin
        if stdin is not None and not stdin.closed:
            with self._write_lock, contextlib.suppress(OSError, ValueError):
                stdin.write(line + "\n")
                stdin.flush()


def _single_line(text: str) -> str:
    return " ".join(text.split())
