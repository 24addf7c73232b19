"""What a watchdog is to the program: something that must hear from the run thread while the bench is live.

`drivers.watchdog.client` starts the real one, a process of its own; here is the door, and the one for benches that need none.
"""

import contextlib
import time
from pathlib import Path
from typing import Protocol

from drivers.clock import WallClock

HEARTBEAT_PERIOD_S = 0.1
"""How often the interpreter says that it runs, and the longest wait between two beats of a sleeping run thread."""

WATCHDOG_DISABLED_WARNING = (
    "No watchdog: the bench file switches it off. If this program dies while the bench is live, a burst ends by itself, "
    "but a held level stays on the specimen"
)


class Watchdog(Protocol):
    """Watches while the bench is live. Only the run thread calls it, but for `close`."""

    inactive_reason: str
    """Why nobody watches, where nobody does; empty otherwise."""

    def set_log_folder(self, folder: Path) -> None:
        """From now on its log stands beside the runs of this folder."""

    def arm(self) -> None:
        """From now on a silence means that the program is dead.

        Raises:
            BenchError: nobody watches, so the bench must not go live.
        """

    def send_heartbeat(self) -> None:
        """The run thread is alive. Never raises."""

    def raise_for_status(self) -> None:
        """Raises BenchError if the watchdog has ended, or has brought the source to rest itself."""

    def allow_silence(self, seconds: float | None = None, /) -> contextlib.AbstractContextManager[None]:
        """Inside, the run thread may be silent for so long; default is one answer of the source that does not come.

        Where the watchdog commands the source, this waits until it has done: the two must not command in turns.
        """

    def raise_if_taken_over(self) -> None:
        """Raises BenchError if the watchdog took the source over since the present `allow` began."""

    def request_rest(self, reason: str, /) -> str:
        """Ask it to bring the source to rest, because the program could not. What came of it in words; never raises."""

    def log(self, message: str) -> None:
        """Write a line into its log."""

    def disarm(self) -> None:
        """The way out is over: a silence means nothing any more."""

    def close(self) -> None:
        """Send it away."""


class NoWatchdog:
    """Nobody watches: on the virtual clock, where bench and program die together, or because the bench file says so."""

    def __init__(self, inactive_reason: str = "") -> None:
        self.inactive_reason = inactive_reason

    def set_log_folder(self, folder: Path) -> None: ...

    def arm(self) -> None: ...

    def send_heartbeat(self) -> None: ...

    def raise_for_status(self) -> None: ...

    def allow_silence(self, _seconds: float | None = None, /) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext()

    def raise_if_taken_over(self) -> None: ...

    def request_rest(self, _reason: str, /) -> str:
        return ""

    def log(self, message: str) -> None: ...

    def disarm(self) -> None: ...

    def close(self) -> None: ...


class HeartbeatClock(WallClock):
    """Real time in which a waiting run thread goes on beating: drivers pace their staircases with it.

    A driver that was held up in the middle of a staircase must not go on with it once the watchdog has been there.
    """

    def __init__(self, speed: float = 1.0) -> None:
        super().__init__(speed)
        self.watchdog: Watchdog = NoWatchdog()

    def sleep(self, seconds: float) -> None:
        end = time.monotonic() + seconds / self.speed
        while (left := end - time.monotonic()) > 0:
            time.sleep(min(left, HEARTBEAT_PERIOD_S))
            self.watchdog.send_heartbeat()
        self.watchdog.raise_if_taken_over()
