"""Voltage history: time-stamped segments at the amplifier's input, and its high-voltage switch.

Append only: a setting is never used for an earlier sample. Commands and samples come from different threads, so a change is
stamped under the readers' lock, and never earlier than a read time. The past that no instrument reads any more is dropped,
unless somebody will judge it.
"""

import math
import threading
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from drivers import Clock
from model import Array, Mask
from sim_hardware.plant.segments import ConstantSegment, PeriodicSegment, Segment

REMEMBERED_S, REMEMBERED = 120.0, 1000
"""Time before the last read, and number of changes, that are remembered; a plant remembers 60 s at most."""


@dataclass(frozen=True, slots=True)
class HistoryEntry:
    """From `start_s`: segment at the input, high voltage on or off; `cycles` were driven before."""

    start_s: float
    segment: Segment
    hv: bool
    cycles: float = 0.0

    def cycles_until(self, t: float, from_v: float) -> float:
        """Return the cycles of bursts of an amplitude of at least `from_v`, with high voltage on, until a time in this entry."""
        sine = self.segment
        if not (self.hv and isinstance(sine, PeriodicSegment) and sine.amplitude_v >= from_v):
            return self.cycles
        return self.cycles + sine.cycles_until(t) - sine.cycles_until(self.start_s)


class VoltageHistory:
    """Every change of the amplifier's input and of its high-voltage switch, in order.

    Args:
        open_circuit_v: volts at the unconnected input.
    """

    def __init__(self, open_circuit_v: float = 0.0) -> None:
        self._lock = threading.RLock()
        self.keeps_past = False
        """Whether no change is ever dropped, so that `entries` has the whole history."""
        self.counted_from_v = math.inf
        """Smallest amplitude of the cycles that are counted."""
        self._dropped = 0
        self._entries = [HistoryEntry(-math.inf, ConstantSegment(open_circuit_v), hv=False)]
        self._starts = [-math.inf]
        self._read_until = 0.0
        self._readable_until = math.inf
        self._switched_on, self._permitted_until = False, math.inf
        """The amplifier's own switch, and when the interlock takes the high voltage away unless it is permitted again."""

    @contextmanager
    def at_instant(self, clock: Clock) -> Iterator[float]:
        """Context with the present time, which no reader has passed or will pass within the block."""
        with self._lock:
            yield max(clock.now(), self._read_until, self._starts[-1])

    @contextmanager
    def reading_ahead(self, now_s: float) -> Iterator[None]:
        """Context of provisional reads beyond `now_s`: the input may still change from `now_s`."""
        with self._lock:
            self._readable_until = now_s
        try:
            yield
        finally:
            with self._lock:
                self._readable_until = math.inf

    @property
    def change_count(self) -> int:
        """Number of changes."""
        return self._dropped + len(self._entries)

    def append(self, start_s: float, segment: Segment) -> None:
        """Let the input follow `segment` from `start_s`.

        Raises:
            ValueError: the time has already been read or is before the last change.
        """
        with self._lock:
            self.settle(start_s)
            self._append_entry(start_s, segment)

    def switch_high_voltage(self, start_s: float, hv: bool) -> None:
        """Switch the amplifier's high voltage on or off from `start_s`. Raises ValueError as `append`."""
        with self._lock:
            self.settle(start_s)
            self._switched_on = hv
            self._append_entry(start_s, self._entries[-1].segment)

    def permit_high_voltage(self, start_s: float, until_s: float) -> None:
        """Let the interlock permit high voltage from `start_s` until `until_s`. Raises ValueError as `append`."""
        with self._lock:
            self.settle(start_s)
            self._permitted_until = until_s
            if self._entries[-1].hv != (self._switched_on and start_s < until_s):
                self._append_entry(start_s, self._entries[-1].segment)

    def settle(self, now_s: float) -> None:
        """Note that the interlock has taken the high voltage away, if it has by `now_s`."""
        with self._lock:
            if self._entries[-1].hv and now_s >= self._permitted_until:
                self._append_entry(self._permitted_until, self._entries[-1].segment)

    @property
    def high_voltage_on(self) -> bool:
        """Whether the amplifier's high voltage is on."""
        with self._lock:
            return self._entries[-1].hv

    def _append_entry(self, start_s: float, segment: Segment) -> None:
        if start_s < max(self._read_until, self._starts[-1]):
            raise ValueError(f"the past cannot be changed: {start_s} s has been read or written already")
        cycles = self._entries[-1].cycles_until(start_s, self.counted_from_v)
        hv = self._switched_on and start_s < self._permitted_until
        self._entries.append(HistoryEntry(start_s, segment, hv, cycles))
        self._starts.append(start_s)
        if len(self._starts) > 2 * REMEMBERED and not self.keeps_past:
            self._drop_past()

    def _drop_past(self) -> None:
        unread_s = min(self._read_until, self._readable_until) - REMEMBERED_S
        count = min(bisect_right(self._starts, unread_s) - 1, len(self._starts) - REMEMBERED)
        if count > 0:
            self._dropped += count
            del self._entries[:count], self._starts[:count]

    def mark_read(self, until_s: float) -> None:
        """Close the past: later changes must begin after `until_s`."""
        self._read_until = max(self._read_until, min(until_s, self._readable_until))

    def cycles_until(self, t: float) -> float:
        """Return the number of counted cycles until a time."""
        with self._lock:
            return self._entries[bisect_right(self._starts, t) - 1].cycles_until(t, self.counted_from_v)

    def entries(self) -> list[HistoryEntry]:
        """Return all pieces, the first from minus infinity.

        Raises:
            ValueError: some were dropped.
        """
        with self._lock:
            if self._dropped:
                raise ValueError(f"{self._dropped} changes were dropped: set keeps_past before the first run")
            return list(self._entries)

    def constant_between(self, first_s: float, last_s: float) -> tuple[float, bool] | None:
        """Return volts at the input and high voltage if both are constant between two past times; else None, without a read."""
        with self._lock:
            self.settle(last_s)
            piece = self._entries[bisect_right(self._starts, first_s) - 1]
            if (
                piece is not self._entries[bisect_right(self._starts, last_s) - 1]
                or piece.segment.constant_from_s > first_s
            ):
                return None
            self.mark_read(last_s)
        return float(piece.segment.volts(np.array([first_s]))[0]), piece.hv

    def volts(self, t: ArrayLike) -> Array:
        """Volts at the amplifier's input at past times `t`, ascending, shape (n,)."""
        return self.read(t)[0]

    def read(self, t: ArrayLike) -> tuple[Array, Mask]:
        """Volts at the input, and whether high voltage was on, at past times `t`, ascending, both shape (n,)."""
        times = np.asarray(t, float)
        if not times.size:
            return np.zeros(times.shape), np.zeros(times.shape, bool)
        with self._lock:
            self.settle(float(times[-1]))
            self.mark_read(float(times[-1]))
            first = bisect_right(self._starts, float(times[0])) - 1
            last = bisect_right(self._starts, float(times[-1])) - 1
            pieces, starts = self._entries[first : last + 1], self._starts[first : last + 1]
        if len(pieces) == 1:
            return pieces[0].segment.volts(times), np.full(times.shape, pieces[0].hv)
        volts, hv = np.zeros(times.shape), np.zeros(times.shape, bool)
        edges = [0, *np.searchsorted(times, starts[1:], side="left"), times.size]
        for piece, (begin, end) in zip(pieces, pairwise(edges), strict=True):
            if end > begin:
                volts[begin:end] = piece.segment.volts(times[begin:end])
                hv[begin:end] = piece.hv
        return volts, hv
