"""The output of a programmable DC supply, whatever dialect it speaks: quick to rise, slow to fall, off is not 2.5 V."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim_hardware.generators.generator import Make
from sim_hardware.plant.parameters import SupplyTruth
from sim_hardware.plant.segments import Array, Segment

RISE_TAU_S = 1e-3


@dataclass(frozen=True, slots=True)
class Relax:
    """From `start_v` at `origin_s` to `stop_v` as a capacitor is charged: a supply's output, quick up and slow down."""

    origin_s: float
    start_v: float
    stop_v: float
    tau_s: float

    @property
    def still_from_s(self) -> float:
        away = abs(self.start_v - self.stop_v)
        return self.origin_s + self.tau_s * math.log(max(away / 1e-4, 1.0))  # a tenth of a millivolt is still

    @property
    def knots_s(self) -> tuple[float, ...]:
        return ()

    def volts(self, t: Array) -> Array:
        since = np.maximum(np.asarray(t, float) - self.origin_s, 0.0)
        return self.stop_v + (self.start_v - self.stop_v) * np.exp(-since / self.tau_s)


class Supply:
    """One output.

    Args:
        emit: takes what makes the next segment and puts it where the output goes.
        now: bench time.
    """

    def __init__(self, emit: Callable[[Make], None], now: Callable[[], float], truth: SupplyTruth) -> None:
        self._emit, self._now, self._truth = emit, now, truth
        self._segment: Segment = Relax(0.0, 0.0, 0.0, RISE_TAU_S)
        self.level_v = 0.0
        self.current_a = 1.0
        self.on = False
        self.ovp_v = truth.ovp_v
        self.ovp = truth.ovp
        self.tripped = False
        self._powered = True
        self.follow()

    def follow(self) -> None:
        """Go to where the settings say, from where the output is now."""

        def make(t: float) -> Segment:
            start = float(self._segment.volts(np.array([t]))[0])
            if self.on and self.ovp and self.level_v > self.ovp_v:
                self.on, self.tripped = False, True
            target = self.level_v if self.on and self._powered else self._truth.off_v
            self._segment = Relax(t, start, target, RISE_TAU_S if target > start else self._truth.fall_tau_s)
            return self._segment

        self._emit(make)

    def measured_v(self) -> float:
        """What its own voltmeter says."""
        return round(float(self._segment.volts(np.array([self._now()]))[0]), 4)

    def reset(self) -> None:
        """Factory state: off."""
        self.on, self.level_v, self.tripped = False, 0.0, False
        self.ovp, self.ovp_v = self._truth.ovp, self._truth.ovp_v
        self.follow()

    def power(self, on: bool) -> None:
        """The mains plug. Power comes back with the factory state."""
        self._powered = on
        self.reset()
