"""Watchdog interface: heartbeats that the run thread sends while the bench is live.

`drivers.watchdog.client` starts the real one, a separate process; `NoWatchdog` is for benches that need none.
"""

import contextlib
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from drivers.clock import SharedTime, WallClock
from drivers.drive_shapes import LevelPulse

HEARTBEAT_PERIOD_S = 0.1
"""Period of the interpreter's pulse, and longest interval between two heartbeats of a sleeping run thread."""

WATCHDOG_DISABLED_WARNING = (
    "No watchdog: the bench file disables it. If this program is killed while the bench is live, a burst ends by itself, "
    "but a held level stays on the specimen"
)


class Watchdog(Protocol):
    """Monitors the program while the bench is live. Only the run thread calls it, except for `close`."""

    inactive_reason: str
    """Reason why the bench is not monitored; empty if it is."""

    notices_after_s: float
    """Silence of the run thread after which the watchdog acts; NaN without a watchdog."""

    takeover_reason: str
    """Why the watchdog took the source over since arming; empty while it has not. Read in any thread."""

    takeover_outcome: str
    """What came of that, or of a request; empty while it acts."""

    brought_to_rest: bool
    """Whether the outcome is that the source obeyed."""

    @property
    def overdue_s(self) -> float:
        """By how much longer than allowed the run thread has been silent while live, s; 0 or less if not. Any thread."""
        ...

    def set_log_folder(self, folder: Path) -> None:
        """Write the log into this folder of runs."""

    def arm(self) -> None:
        """Start monitoring: silence then means that the program is dead.

        Raises:
            BenchError: the watchdog does not run; the bench must not go live.
        """

    def send_heartbeat(self) -> None:
        """Report that the run thread is running. Errors are not raised."""

    def raise_for_status(self) -> None:
        """Raise BenchError if the watchdog has ended, or has brought the source to rest itself."""

    def allow_silence(self, seconds: float | None = None, /) -> contextlib.AbstractContextManager[None]:
        """Allow the run thread this silence inside; default: one missing reply of the source.

        While the watchdog commands the source, this waits, because both must not command it alternately.
        """

    def raise_if_taken_over(self) -> None:
        """Raise BenchError if the watchdog took over the source since the begin of the present `allow_silence`."""

    def request_rest(self, reason: str, /) -> str:
        """Ask the watchdog to bring the source to rest because the program could not; return the outcome. Errors are not raised."""

    def note_level(self, pulse: LevelPulse, remaining_s: float) -> None:
        """Report a level whose end Stop may hasten, and its duration. Never raises."""

    def forget_level(self) -> None:
        """Report the end of the level. Never raises."""

    def log(self, message: str) -> None:
        """Write a line into the log."""

    def disarm(self) -> None:
        """Stop monitoring, after the shutdown."""

    def close(self) -> None:
        """End the watchdog."""


DEFAULT_SILENCE_S = 3.0
"""Silence that is allowed without a watchdog: the reply timeout of an instrument, and a margin."""


class NoWatchdog:
    """No monitoring: on the virtual clock, with which bench and program end together, or disabled by the bench file."""

    def __init__(self, inactive_reason: str = "") -> None:
        self.inactive_reason = inactive_reason
        self.notices_after_s = math.nan
        self.takeover_reason = self.takeover_outcome = ""
        self.brought_to_rest = False
        self._heard_s, self._allowed_s = math.inf, DEFAULT_SILENCE_S

    @property
    def overdue_s(self) -> float:
        return time.monotonic() - self._heard_s - self._allowed_s

    def set_log_folder(self, folder: Path) -> None: ...

    def arm(self) -> None:
        self._heard_s = time.monotonic()

    def send_heartbeat(self) -> None:
        if math.isfinite(self._heard_s):
            self._heard_s = time.monotonic()

    def raise_for_status(self) -> None: ...

    @contextlib.contextmanager
    def allow_silence(self, seconds: float | None = None, /) -> Iterator[None]:
        before, self._allowed_s = self._allowed_s, max(self._allowed_s, seconds or 0.0)
        try:
            yield
        finally:
            self._allowed_s = before
            self.send_heartbeat()

    def raise_if_taken_over(self) -> None: ...

    def request_rest(self, _reason: str, /) -> str:
        return ""

    def note_level(self, pulse: LevelPulse, remaining_s: float) -> None: ...

    def forget_level(self) -> None: ...

    def log(self, message: str) -> None: ...

    def disarm(self) -> None:
        self._heard_s = math.inf

    def close(self) -> None: ...


class HeartbeatClock(WallClock):
    """Real time in which a sleeping run thread continues to send heartbeats; paces the drivers' steps.

    A driver delayed within a series of steps must not continue it after the watchdog has taken over.
    """

    def __init__(self, speed: float = 1.0, shared: SharedTime | None = None) -> None:
        super().__init__(speed, shared)
        self.watchdog: Watchdog = NoWatchdog()

    def sleep(self, seconds: float) -> None:
        end_s = self.now() + seconds
        while (left_s := end_s - self.now()) > 0:
            time.sleep(min(left_s / self.speed, HEARTBEAT_PERIOD_S))
            self.watchdog.send_heartbeat()
        self.watchdog.raise_if_taken_over()
