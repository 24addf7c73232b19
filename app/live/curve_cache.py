"""Cache of computed model curves."""

import threading
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

C = TypeVar("C")


class CurveCache(Generic[C]):
    """The curves computed last, at most `size`; may be shared by threads."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._curves: dict[Hashable, C] = {}
        self._lock = threading.Lock()

    def get(self, key: Hashable, compute: Callable[[], C]) -> C:
        """Return the curve of a key, computed if it is not stored. `compute` runs outside the lock."""
        with self._lock:
            if (curve := self._curves.get(key)) is not None:
                return curve
        curve = compute()
        with self._lock:
            while len(self._curves) >= self._size:
                self._curves.pop(next(iter(self._curves)))
            return self._curves.setdefault(key, curve)
