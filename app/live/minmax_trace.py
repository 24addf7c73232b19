"""What a screen can show of a long record: smallest and largest value per pixel column, kept up to date block by block.

Drawing every sample at 500 kS/s stalls all threads (docs/decisions/0006-live-plot.md); two values a column do not.
"""

import threading

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class MinMaxTrace:
    """The last `seconds` of a signal as `columns` pairs of minimum and maximum. Written by one thread, read by another.

    Columns stand on a fixed grid of the record, so that the picture scrolls and never shimmers.
    """

    def __init__(self, seconds: float, columns: int = 1000) -> None:
        self.seconds, self.columns = seconds, columns
        self._lock = threading.Lock()
        self.reset(1.0)

    def reset(self, rate_hz: float) -> None:
        """Begin a new record."""
        with self._lock:
            self._rate_hz = rate_hz
            self._samples_per_column = max(round(self.seconds * rate_hz / self.columns), 1)
            self._low = np.full(self.columns, np.nan)
            self._high = np.full(self.columns, np.nan)
            self._filled = 0
            self._tail = np.empty(0)
            self.version = 0

    def append(self, samples: Array) -> None:
        """Take the next samples, (n,)."""
        with self._lock:
            pending = np.concatenate([self._tail, samples]) if self._tail.size else samples
            whole = pending.size // self._samples_per_column
            grid = pending[: whole * self._samples_per_column].reshape(whole, self._samples_per_column)
            self._tail = pending[whole * self._samples_per_column :].copy()
            if whole:
                low, high = grid.min(axis=1)[-self.columns :], grid.max(axis=1)[-self.columns :]
                at = (self._filled + whole - len(low) + np.arange(len(low))) % self.columns
                self._low[at], self._high[at] = low, high
                self._filled += whole
            self.version += 1

    def decimated_curve(self) -> tuple[Array, Array]:
        """Times in seconds since the record began, and values: low, high, low, high ...; both (2 columns,)."""
        with self._lock:
            have = min(self._filled, self.columns)
            first = self._filled - have
            at = (first + np.arange(have)) % self.columns
            time = (first + np.arange(have)) * self._samples_per_column / self._rate_hz
            values = np.empty(2 * have)
            values[0::2], values[1::2] = self._low[at], self._high[at]
        return np.repeat(time, 2), values
