"""Min/max decimation of a stream, block by block: the smallest and largest value per pixel column.

Drawing every sample at 500 kS/s stalls all threads (docs/decisions/0006-live-plot.md); two values a column do not.
"""

import threading

import numpy as np

from app.common import minmax_pairs
from model import Array


class MinMaxTrace:
    """The last `seconds` of a signal as `columns` pairs of minimum and maximum. Written by one thread, read by another.

    Columns lie on a fixed grid of the record, so that the display scrolls without flicker.
    """

    def __init__(self, seconds: float, columns: int = 1000) -> None:
        self.seconds, self.columns = seconds, columns
        self._lock = threading.Lock()
        self.reset(1.0)

    def reset(self, rate_hz: float) -> None:
        """Start a new record."""
        with self._lock:
            self._rate_hz = rate_hz
            self._samples_per_column = max(round(self.seconds * rate_hz / self.columns), 1)
            self._pairs = np.full((self.columns, 2), np.nan)
            self._filled = 0
            self._tail = np.empty(0)
            self.version = 0

    def append(self, samples: Array) -> None:
        """Append the next samples, (n,)."""
        with self._lock:
            pending = np.concatenate([self._tail, samples]) if self._tail.size else samples
            whole = pending.size // self._samples_per_column
            complete = whole * self._samples_per_column
            self._tail = pending[complete:].copy()
            if whole:
                pairs = minmax_pairs(pending[:complete], self._samples_per_column).reshape(whole, 2)[-self.columns :]
                self._pairs[(self._filled + whole - len(pairs) + np.arange(len(pairs))) % self.columns] = pairs
                self._filled += whole
            self.version += 1

    def decimated_curve(self) -> tuple[Array, Array]:
        """Return times in seconds since the record began, and values: low, high, low, high ...; both (2 columns,)."""
        with self._lock:
            have = min(self._filled, self.columns)
            column = self._filled - have + np.arange(have)
            time = column * self._samples_per_column / self._rate_hz
            return np.repeat(time, 2), self._pairs[column % self.columns].ravel()
