"""Clock: bench time, which is real time, faster on a simulated bench, or a counter in tests.

Every wait of a driver or protocol uses a clock, so that tests need not wait.
"""

import array
import math
import mmap
import time
from pathlib import Path
from typing import Protocol


class Clock(Protocol):
    """Monotonic bench time in seconds."""

    def now(self) -> float:
        """Return the present bench time, s."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait for this bench time, s; return immediately if it is not positive."""


LATE_PER_SPEED_S = 0.025
"""Longest delay of a reply, and of the time of a first scan, on a busy computer: bench seconds per speed of a simulated bench."""

READER_GONE_S = 0.5
"""Real time without a read after which bench time no longer waits for the reader."""

SHORTEST_SLEEP_S = 1e-6
"""Smallest difference of two readings of a waiting time."""


class SharedTime:
    """Bench time of a simulated bench at raised speed, common to all its processes; it waits for a late reader of a card.

    A file holds the real time of its begin, the bench seconds for which it has waited, the bench time at which it waits and the
    real time until which it waits.

    Args:
        path: path of the file.
        speed: bench seconds per real second.
        new: whether time begins now, in a new file.
    """

    def __init__(self, path: Path, speed: float, new: bool = False) -> None:
        self.path, self.speed = path, speed
        if new:
            path.write_bytes(array.array("d", (time.monotonic(), 0.0, math.inf, 0.0)).tobytes())
        with path.open("r+b") as file:
            # A view stores a number at once; `struct.pack_into` clears its place first, and another process would read 0.
            self._numbers = memoryview(mmap.mmap(file.fileno(), 0)).cast("d")
        self._latest_s = 0.0

    def now(self) -> float:
        """Return the bench time, s."""
        # `wait_at` of another process writes the limit before its end: read the other way round, an earlier limit would hold anew.
        until = self._numbers[3]
        limit_s = self._numbers[2]
        real = time.monotonic()
        passed_s = (real - self._numbers[0]) * self.speed
        present_s = passed_s - self._numbers[1]
        if present_s > limit_s and real < until:
            self._numbers[1] = max(passed_s - limit_s, self._numbers[1])
            present_s = limit_s
        # Another process may have set the limit a moment too late; and two events never have the same time.
        self._latest_s = max(self._latest_s + SHORTEST_SLEEP_S, present_s)
        return self._latest_s

    def wait_at(self, limit_s: float) -> None:
        """Limit the bench time, as long as this is called every READER_GONE_S."""
        self._numbers[2] = max(limit_s, self.now())
        self._numbers[3] = time.monotonic() + READER_GONE_S


class WallClock:
    """Real time, multiplied by `speed` (1 on a real bench; up to 20 on a simulated one), or `shared` with other processes."""

    def __init__(self, speed: float = 1.0, shared: SharedTime | None = None) -> None:
        self.speed, self.shared = speed, shared
        self._start = time.monotonic()

    def now(self) -> float:
        return (time.monotonic() - self._start) * self.speed if self.shared is None else self.shared.now()

    def sleep(self, seconds: float) -> None:
        end_s = self.now() + seconds
        while (left_s := end_s - self.now()) > 0:
            time.sleep(max(left_s / self.speed, SHORTEST_SLEEP_S))
