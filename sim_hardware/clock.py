"""A clock for tests and for `--speed max`: its time moves only when somebody waits."""

import threading


class VirtualClock:
    """Bench time as a counter (drivers.clock.Clock). Sleeping costs nothing and moves it; so does waiting for data."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._lock = threading.Lock()
        self._now = start_s

    def now(self) -> float:
        with self._lock:
            return self._now

    def sleep(self, seconds: float) -> None:
        with self._lock:
            self._now += max(0.0, seconds)
