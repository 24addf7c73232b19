"""Virtual clock for tests and `--speed max`: time advances only in `sleep`."""

import ctypes
import threading
from contextlib import suppress

KEPT_ARRAY_BYTES, KEPT_BYTES = 16 << 20, 64 << 20
"""Arena limit and trim threshold of malloc, bytes."""


class VirtualClock:
    """Bench time as a counter (drivers.clock.Clock). Sleeping and waiting for data advance it without real time."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._lock = threading.Lock()
        self._now = start_s

    def now(self) -> float:
        with self._lock:
            return self._now

    def sleep(self, seconds: float) -> None:
        with self._lock:
            self._now += max(0.0, seconds)


def keep_freed_memory() -> None:
    """Let glibc keep the memory of freed arrays: a new page from the system takes longer than its processing."""
    mmap_threshold, trim_threshold = -3, -1  # M_MMAP_THRESHOLD, M_TRIM_THRESHOLD of malloc.h
    with suppress(AttributeError, OSError, TypeError):  # another C library, or Windows
        library = ctypes.CDLL(None)
        library.mallopt(mmap_threshold, KEPT_ARRAY_BYTES)
        library.mallopt(trim_threshold, KEPT_BYTES)
