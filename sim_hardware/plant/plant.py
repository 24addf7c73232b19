"""The one plant behind all simulated instruments: amplifier and tactor on a fixed time grid, simulated when asked for.

Input volts pass the amplifier's static map, its high-voltage switch and its slew limit. They and the weights on the
tactor drive its modes (sim_hardware.plant.stepper). What stands on the bench changes while it runs: the motion goes on from
where it was, with the modes of what is there now.
"""

import math
import threading
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from sim_hardware.plant.faults import Faults
from sim_hardware.plant.nonidealities import Creep, Hysteresis
from sim_hardware.plant.parameters import AmplifierTruth, BenchTruth
from sim_hardware.plant.setup_state import Situation, force_n, opening
from sim_hardware.plant.stepper import BLOCK, Stepper, slewed
from sim_hardware.plant.voltage_history import History

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LIMITED = 1e-3
"""Share of its slew rate that the amplifier keeps at its current limit."""

STILL_M = 1e-15
"""What still rings by less than this stands still."""

TOUCH_S = 2e-3
"""How long a weight's first touch lasts."""


@dataclass(frozen=True, slots=True)
class Change:
    """From `start_s` on the situation is `now`; until `end_s` a hand lets the weights' force go over to `after_n`.

    `impulse_ns` is what a weight brings along when it touches down.
    """

    start_s: float
    end_s: float
    now: Situation
    before_n: float = 0.0
    after_n: float = 0.0
    impulse_ns: float = 0.0

    def newtons(self, t: Array) -> Array:
        """The force at times `t` (n,), none of them before `start_s`."""
        share = np.clip((t - self.start_s) / max(self.end_s - self.start_s, 1e-9), 0.0, 1.0)
        force = self.before_n + (self.after_n - self.before_n) * share**2 * (3 - 2 * share)
        touch = np.clip((t - self.start_s) / TOUCH_S, 0.0, 1.0)
        return np.asarray(force + self.impulse_ns / TOUCH_S * math.pi / 2 * np.sin(math.pi * touch))


class Plant:
    """Displacement of the tactor's centre for everything that reached the amplifier's input, and for what lies on it.

    It remembers the last `window_s`; a gap longer than the tactor's own memory that nobody looked at is not simulated.
    """

    def __init__(self, truth: BenchTruth, history: History, faults: Faults | None = None) -> None:
        self._truth = truth
        self._history = history
        self._faults = faults or Faults()
        self._amplifier: AmplifierTruth = truth.amplifier
        self._rate = truth.plant_rate_hz
        self._ring = np.zeros(max(BLOCK, math.ceil(truth.window_s * self._rate / BLOCK) * BLOCK))
        self._lock = threading.RLock()
        self._steppers: dict[tuple[object, ...], Stepper] = {}
        self._changes = [Change(-math.inf, -math.inf, opening(truth))]
        self._starts = [-math.inf]
        beyond = truth.beyond
        self._creep = Creep(beyond.creep_per_decade, BLOCK / self._rate)
        self._creep_n = Creep(beyond.creep_per_decade, BLOCK / self._rate)
        self._hysteresis = Hysteresis(beyond.hysteresis_width)
        self._next = 0  # first grid step not yet simulated
        self._valid_from = 0
        self._stepper = self._stepper_of(self._changes[0].now)
        self._state = self._stepper.settled(0.0, 0.0)
        self._before_v = self._bent_v = self._before_n = 0.0

    def ready_at(self, t: float) -> float:
        """Bench time from which the displacement at `t` can be known."""
        return (math.ceil(t * self._rate) // BLOCK + 1) * BLOCK / self._rate

    def ready_until(self, now: float) -> float:
        """The latest time whose displacement can be known at `now`."""
        return (math.floor(now * self._rate + 1e-6) // BLOCK * BLOCK - 1) / self._rate

    def change(
        self,
        clock: Clock,
        how: Callable[[Situation], Situation],
        after_s: float = 0.0,
        over_s: float = 0.0,
        landing_m_per_s: float = 0.0,
    ) -> float:
        """Change the situation `after_s` from now, or when the change before is over; bench time when it is complete.

        `over_s` is the time a hand takes to put weights down or lift them off; they land at `landing_m_per_s`.
        """
        # The plant's lock first, then the history's: the order in which a reader takes them.
        with self._lock, self._history.instant(clock) as now_s:
            last = self._changes[-1]
            start_s = max(now_s + after_s, last.end_s)
            start_s = math.ceil(start_s * self._rate / BLOCK) * BLOCK / self._rate
            end_s = start_s + math.ceil(over_s * self._rate / BLOCK) * BLOCK / self._rate
            now = how(last.now)
            after_n = force_n(now, self._truth)
            placed_kg = sum(now.weights_kg) - sum(last.now.weights_kg)
            if placed_kg >= 0:
                self._append(Change(start_s, end_s, now, last.after_n, after_n, placed_kg * landing_m_per_s))
            else:  # a weight in the hand moves with the tactor until it is lifted off
                self._append(
                    Change(start_s, end_s, replace(now, weights_kg=last.now.weights_kg), last.after_n, after_n)
                )
                self._append(Change(end_s, end_s, now, after_n, after_n))
            return end_s

    @property
    def situation(self) -> Situation:
        """What stands on the bench once every change that was begun is complete."""
        return self._changes[-1].now

    def largest_n(self, t: Array) -> Array:
        """The largest force of the weights until each time `t` (n,)."""
        with self._lock:
            reached = np.maximum.accumulate([change.after_n for change in self._changes])
            ends = [change.end_s for change in self._changes]
        return np.asarray(reached[np.searchsorted(ends, t, side="right") - 1])

    def displacement(self, t: Array) -> Array:
        """Metres at past times `t`, ascending, shape (n,); linear between grid points, 0 before the bench began.

        Raises:
            ValueError: `t` reaches further back than the plant remembers.
        """
        if not t.size:
            return np.zeros(0)
        place = np.maximum(t * self._rate, -1.0)
        below = np.floor(place).astype(np.int64)
        with self._lock:
            first = max(0, int(below[0]))
            self._simulate(first, int(below[-1]) + 1)
            if first < max(self._valid_from, self._next - self._ring.size):
                raise ValueError(
                    f"the plant remembers {self._ring.size / self._rate:g} s; {t[0]:.3f} s is further back than that"
                )
            low = self._ring.take(below, mode="wrap")
            high = self._ring.take(below + 1, mode="wrap")
        high = low + (place - below) * (high - low)
        return np.where(below < 0, 0.0, high) if below[0] < 0 else high

    def _append(self, change: Change) -> None:
        self._changes.append(change)
        self._starts.append(change.start_s)

    def _at(self, step: int) -> int:
        """Number of the change in force at a grid step."""
        return bisect_right(self._starts, (step + 1e-3) / self._rate) - 1

    def _stepper_of(self, situation: Situation) -> Stepper:
        tactor, difference = self._truth.tactor, self._truth.beyond.side_difference
        k2 = tactor.k2 * (1 + situation.side * difference / 2)
        key = (situation.mass_kg, situation.skin, k2)
        if key not in self._steppers:
            there = replace(tactor, m_add=situation.mass_kg, k2=k2)
            self._steppers[key] = Stepper.of(there, situation.skin, self._truth.modes, 1 / self._rate)
        return self._steppers[key]

    def _simulate(self, first: int, last: int) -> None:
        self._skip(first)
        while self._next <= last:
            number = self._at(self._next)
            change = self._changes[number]
            stepper = self._stepper_of(change.now)
            if stepper is not self._stepper:
                self._state = stepper.taken_over(self._stepper, self._state, self._bent_v, self._before_n)
                self._stepper = stepper
            # A bounded stretch at a time keeps memory flat when much is asked for at once.
            stop = min((last // BLOCK + 1) * BLOCK, self._next + min(1024 * BLOCK, self._ring.size))
            if number + 1 < len(self._starts):
                stop = min(stop, round(self._starts[number + 1] * self._rate))
            if (still := self._still(change, stepper, stop)) is not None:
                w = np.full(stop - self._next, still)
            else:
                volts = self._bent(self._slewed(self._next, self._specimen(self._next, stop, change.now)), change.now)
                newtons = self._newtons(change, self._next, stop)
                w, self._state = stepper.run(volts, self._bent_v, newtons, self._before_n, self._state)
                self._bent_v, self._before_n = float(volts[-1]), float(newtons[-1])
            begin = self._next % self._ring.size
            head = min(w.size, self._ring.size - begin)
            self._ring[begin : begin + head] = w[:head]
            self._ring[: w.size - head] = w[head:]
            self._next = stop

    def _still(self, change: Change, stepper: Stepper, stop: int) -> float | None:
        """Where the tactor stands until a grid step, if nothing moves it and nothing rings; else None.

        Half of a bench's time nothing happens, and a held level is as quick as nothing then.
        """
        first_s, beyond = self._next / self._rate, self._truth.beyond
        if beyond.creep_per_decade or beyond.hysteresis_width or self._faults.ever("amplifier-limited"):
            return None
        if first_s <= change.end_s + TOUCH_S or self._before_n != change.after_n:
            return None
        left = self._state - stepper.settled(self._bent_v, self._before_n)
        if np.abs(left).max(initial=0.0) * np.abs(stepper.O).max() > STILL_M:
            return None
        standing = self._history.standing(first_s, (stop - 1) / self._rate)
        if standing is None:
            return None
        volts, hv = standing
        wanted = float(self._amplifier.map.specimen_v(volts)) if hv and not change.now.shorted else 0.0
        if wanted != self._before_v or change.now.side * wanted != self._bent_v:
            return None
        return stepper.stands(self._bent_v, self._before_n)

    def _skip(self, first: int) -> None:
        """Leave out what nobody looked at, as far as the tactor has forgotten it when somebody does."""
        stepper = self._stepper_of(self._changes[self._at(first)].now)
        if stepper.slowest <= 0:
            return
        start = (first - math.ceil(40 / stepper.slowest * self._rate)) // BLOCK * BLOCK
        if start <= self._next + BLOCK:
            return
        change = self._changes[self._at(start - 1)]
        gap_s = (start - self._next) / self._rate
        self._next = self._valid_from = start
        volts = self._specimen(start - 1, start, change.now)
        for creep, drive in ((self._creep, float(volts[0])), (self._creep_n, change.after_n)):
            creep.skip(drive, gap_s)
        self._bent_v = float(self._bent(volts, change.now)[0])
        self._before_n = float(self._newtons(change, start - 1, start)[0])
        self._stepper = self._stepper_of(change.now)
        self._state = self._stepper.settled(self._bent_v, self._before_n)

    def _newtons(self, change: Change, first: int, stop: int) -> Array:
        """What the weights press with at grid steps first..stop, all under one change."""
        if first / self._rate > change.end_s + TOUCH_S:
            force = np.full(stop - first, change.after_n)
        else:
            force = change.newtons(np.arange(first, stop) / self._rate)
        return self._creep_n.feed(force.reshape(-1, min(BLOCK, force.size))).ravel()

    def _bent(self, volts: Array, situation: Situation) -> Array:
        """What bends the specimen, seen from the sensor: its volts with hysteresis and creep, as the side up turns them."""
        self._before_v = float(volts[-1])
        bent = self._hysteresis.feed(volts)
        return situation.side * self._creep.feed(bent.reshape(-1, min(BLOCK, bent.size))).ravel()

    def _slewed(self, first: int, wanted: Array) -> Array:
        """What the amplifier makes of the volts it wants from grid step `first` on, stretch by stretch of its limit."""
        limited = self._faults.during("amplifier-limited", np.arange(first, first + wanted.size) / self._rate)
        edges = [0, *(np.flatnonzero(np.diff(limited)) + 1).tolist(), wanted.size]
        step_v, before_v = self._amplifier.slew_v_per_s / self._rate, self._before_v
        volts = np.empty_like(wanted)
        for begin, end in pairwise(edges):
            most_v = step_v * (LIMITED if limited[begin] else 1.0)
            volts[begin:end] = slewed(wanted[begin:end], before_v, most_v)
            before_v = float(volts[end - 1])
        return volts

    def _specimen(self, first: int, stop: int, situation: Situation) -> Array:
        """Volts the amplifier wants on the specimen, grid steps first..stop; none where its electrodes are shorted."""
        volts, hv = self._history.read(np.arange(first, stop) / self._rate)
        wanted = self._amplifier.map.specimen_v(volts)
        if situation.shorted:
            return np.zeros_like(wanted)
        return wanted if hv.all() else np.where(hv, wanted, 0.0)
