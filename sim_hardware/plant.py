"""The one plant behind all simulated instruments: amplifier and tactor on a fixed time grid, simulated when asked for.

Input volts pass the amplifier's static map, its high-voltage switch and its slew limit, and drive the tactor's modes,
each stepped exactly for an input that is linear between grid points (first-order hold). Whole blocks of the grid are
computed at once: y = T v + O x, with one small recursion from block to block.
"""

import math
import threading
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from model.response import modal
from model.skin import Skin
from sim_hardware.faults import Faults
from sim_hardware.history import History
from sim_hardware.truth import AmplifierTruth, BenchTruth

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LIMITED = 1e-3
"""Share of its slew rate that the amplifier keeps at its current limit."""

BLOCK = 128
"""Grid steps simulated together; nothing is known of a block before it is complete."""


@dataclass(frozen=True, slots=True)
class _Stepper:
    """Matrices of one block: displacement and next state for volts v[-1..BLOCK-1] and the state before."""

    T: Array  # (BLOCK + 1, BLOCK), volts to displacement
    O: Complex  # (m, BLOCK), state to displacement  # noqa: E741
    W: Complex  # (BLOCK + 1, m), volts to the state after the block
    advance: Complex  # (m,), state over one block
    poles: Complex

    @classmethod
    def of(cls, poles: Complex, residues: Complex, step_s: float) -> "_Stepper":
        """First-order hold for w = Re sum r z, z' = s z + v; conjugate pairs are kept once."""
        keep = poles.imag >= 0
        s, r = poles[keep], residues[keep] * np.where(poles[keep].imag > 0, 2.0, 1.0)
        # Modes beyond the grid follow the voltage at once; their oscillation could not be sampled anyway.
        fast = np.abs(s) * step_s > 1.0
        static = float(np.sum((-r[fast] / s[fast]).real))
        s, r = s[~fast], r[~fast]
        a, z = np.exp(s * step_s), s * step_s
        new = (a - 1 - z) / (s * z)  # weight of the voltage at the end of a step
        old = (a - 1) / s - new  # and of the one at its beginning
        k = np.arange(BLOCK)
        powers = a[:, None] ** k
        both = powers * (a * new + old)[:, None]
        later = (r @ both).real  # response `lag` + 1 steps after a voltage
        T = np.zeros((BLOCK + 1, BLOCK))
        T[0] = (r @ (powers * old[:, None])).real
        for j in range(BLOCK):
            T[j + 1, j] = float((r @ new).real) + static
            T[j + 1, j + 1 :] = later[: BLOCK - 1 - j]
        W = np.zeros((BLOCK + 1, s.size), complex)
        W[0] = a ** (BLOCK - 1) * old
        W[1:BLOCK] = both[:, : BLOCK - 1][:, ::-1].T
        W[BLOCK] = new
        return cls(T, r[:, None] * a[:, None] ** (k + 1), W, a**BLOCK, s)

    def settled(self, volts: float) -> Complex:
        """The state after `volts` stood for ever."""
        return -volts / self.poles

    def run(self, before_v: float, volts: Array, state: Complex) -> tuple[Array, Complex]:
        """Displacement on the grid for whole blocks of `volts` (n BLOCK,), and the state after them."""
        blocks = volts.reshape(-1, BLOCK)
        u = np.concatenate((np.concatenate(([before_v], blocks[:-1, -1]))[:, None], blocks), axis=1)
        pushes = u @ self.W
        states = np.empty_like(pushes)
        for i, push in enumerate(pushes):
            states[i] = state
            state = self.advance * state + push
        return (u @ self.T + (states @ self.O).real).ravel(), state


def slewed(target: Array, start_v: float, step_v: float) -> Array:
    """`target` followed from `start_v` with at most `step_v` per sample; untouched where it is slow enough."""
    rises = target.copy()
    rises[1:] -= target[:-1]
    rises[0] -= start_v
    jumps = np.flatnonzero(np.abs(rises) > step_v)
    if not jumps.size:
        return target
    out, wanted = target.copy(), target.tolist()
    i, n = int(jumps[0]), target.size
    while True:
        at = float(out[i - 1]) if i else start_v
        while i < n and abs(wanted[i] - at) > step_v:
            at += math.copysign(step_v, wanted[i] - at)
            out[i] = at
            i += 1
        # Caught up: sample i is admissible; go on to the next one that is not.
        later = int(np.searchsorted(jumps, i, side="right"))
        if later >= jumps.size:
            return out
        i = int(jumps[later])


class Plant:
    """Displacement of the tactor's centre for everything that reached the amplifier's input.

    It remembers the last `window_s`; a gap longer than the tactor's own memory that nobody looked at is not simulated.
    """

    def __init__(self, truth: BenchTruth, history: History, faults: Faults | None = None) -> None:
        self._history = history
        self._faults = faults or Faults()
        self._amplifier: AmplifierTruth = truth.amplifier
        self._rate = truth.plant_rate_hz
        self._n = truth.modes
        self._tactor = truth.tactor
        self._stepper, self._memory = self._tactor_of(truth.skin)
        self._ring = np.zeros(max(BLOCK, math.ceil(truth.window_s * self._rate / BLOCK) * BLOCK))
        self._lock = threading.RLock()
        self._next = 0  # first grid step not yet simulated
        self._valid_from = 0
        self._state = self._stepper.settled(0.0)
        self._before_v = 0.0

    def _tactor_of(self, skin: Skin | None) -> tuple[_Stepper, int]:
        form = modal(self._tactor, skin, self._n)
        slowest = float(np.min(-form.poles.real))
        memory = math.ceil(40 / slowest * self._rate) if slowest > 0 else np.iinfo(np.int64).max
        return _Stepper.of(form.poles, form.residues, 1 / self._rate), int(memory)

    def ready_at(self, t: float) -> float:
        """Bench time from which the displacement at `t` can be known."""
        return (math.ceil(t * self._rate) // BLOCK + 1) * BLOCK / self._rate

    def ready_until(self, now: float) -> float:
        """The latest time whose displacement can be known at `now`."""
        return (math.floor(now * self._rate + 1e-6) // BLOCK * BLOCK - 1) / self._rate

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

    def _simulate(self, first: int, last: int) -> None:
        if first - self._next > self._memory + BLOCK:
            self._next = self._valid_from = (first - self._memory) // BLOCK * BLOCK
            self._before_v = float(self._specimen(self._next - 1, self._next)[0])
            self._state = self._stepper.settled(self._before_v)
        while self._next <= last:
            # A bounded stretch at a time keeps memory flat when much is asked for at once.
            stop = min((last // BLOCK + 1) * BLOCK, self._next + min(1024 * BLOCK, self._ring.size))
            volts = self._slewed(self._next, self._specimen(self._next, stop))
            w, self._state = self._stepper.run(self._before_v, volts, self._state)
            self._before_v = float(volts[-1])
            begin = self._next % self._ring.size
            head = min(w.size, self._ring.size - begin)
            self._ring[begin : begin + head] = w[:head]
            self._ring[: w.size - head] = w[head:]
            self._next = stop

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

    def _specimen(self, first: int, stop: int) -> Array:
        """Volts the amplifier wants on the specimen, grid steps first..stop."""
        volts, hv = self._history.read(np.arange(first, stop) / self._rate)
        wanted = self._amplifier.map.specimen_v(volts)
        return wanted if hv.all() else np.where(hv, wanted, 0.0)
