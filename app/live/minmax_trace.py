"""Min/max decimation of a stream, block by block: the smallest and largest value per pixel column.

Drawing every sample at 500 kS/s stalls all threads (docs/decisions/0006-live-plot.md); two values a column do not.
"""

import math
import threading

import numpy as np

from app.common import minmax_pairs
from model import Array

MAX_PENDING = 20_000
"""Samples that wait until somebody looks at the trace; more are decimated where they arrive."""


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
            self._pending: list[Array] = []
            self._pending_samples = 0
            self.version = 0

    def append(self, samples: Array) -> None:
        """Append the next samples, (n,), which are not changed later."""
        with self._lock:
            self._pending.append(samples)
            self._pending_samples += samples.size
            if self._pending_samples > MAX_PENDING:
                self._decimate()
            self.version += 1

    def _decimate(self) -> None:
        """Take the samples that wait; those of an incomplete column go on waiting."""
        if self._pending_samples < self._samples_per_column:
            return
        pending = np.concatenate(self._pending)
        whole = pending.size // self._samples_per_column
        complete = whole * self._samples_per_column
        self._pending = [pending[complete:].copy()]
        self._pending_samples = self._pending[0].size
        pairs = minmax_pairs(pending[:complete], self._samples_per_column).reshape(whole, 2)[-self.columns :]
        self._pairs[(self._filled + whole - len(pairs) + np.arange(len(pairs))) % self.columns] = pairs
        self._filled += whole

    def decimated_curve(self, seconds: float = math.inf) -> tuple[Array, Array]:
        """Return times in seconds since the record began, and values: low, high, low, high ...; both (2 columns,).

        `seconds` limits the record to its end.
        """
        with self._lock:
            self._decimate()
            have = int(min(self._filled, self.columns, 1 + seconds * self._rate_hz / self._samples_per_column))
            time = np.arange(self._filled - have, self._filled) * self._samples_per_column / self._rate_hz
            end = self._filled % self.columns
            pairs = (
                self._pairs[end - have : end]
                if have <= end
                else np.concatenate((self._pairs[end - have :], self._pairs[:end]))
            )
            return np.repeat(time, 2), pairs.reshape(-1).copy()
