"""Virtual clock for tests and `--speed max`: time advances only in `sleep`."""

import threading


class VirtualClock:
    """Bench time as a counter (drivers.clock.Clock). Sleeping and waiting for data advance it and take no real time."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._lock = threading.Lock()
        self._now = start_s

    def now(self) -> float:
        with self._lock:
            return self._now

    def sleep(self, seconds: float) -> None:
        with self._lock:
            self._now += max(0.0, seconds)
