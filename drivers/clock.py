"""Clock: bench time, which is real time, faster on a simulated bench, or a counter in tests.

Every wait of a driver or protocol goes through a clock, so that tests need not wait.
"""

import time
from typing import Protocol


class Clock(Protocol):
    """Monotonic bench time in seconds."""

    def now(self) -> float:
        """Return the present bench time, s."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait for this bench time, s; return immediately if it is not positive."""


class WallClock:
    """Real time, multiplied by `speed` (1 on a real bench; up to 20 on a simulated one)."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self._start = time.monotonic()

    def now(self) -> float:
        return (time.monotonic() - self._start) * self.speed

    def sleep(self, seconds: float) -> None:
        if seconds > 0:
            time.sleep(seconds / self.speed)
