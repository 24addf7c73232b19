"""Walks a DC supply along a drive in steps while the run goes on: a supply has no memory for a waveform."""

import threading
from typing import Protocol

import numpy as np

from drivers.clock import Clock
from drivers.drive import Ramp, Steps

PERIOD_S = 2e-3


class Steppable(Protocol):
    """What the walk needs of a supply."""

    def idle_v(self) -> float: ...

    def set_level(self, level_v: float) -> None:
        """One step, at once."""

    def towards(self, wanted_v: float) -> float:
        """The level at most one step from the present one."""


class Stairs(threading.Thread):
    """Walks a supply along a drive in steps while the run goes on; ends with the drive, or when it is told to."""

    def __init__(self, supply: Steppable, drive: Ramp | Steps, clock: Clock) -> None:
        super().__init__(name="DC supply steps", daemon=True)
        self._supply, self._drive, self._clock = supply, drive, clock
        self._told = threading.Event()
        self._failure: BaseException | None = None
        self._began_s = clock.now()
        self.start()

    def run(self) -> None:
        try:
            while not self._told.wait(PERIOD_S):
                t = self._clock.now() - self._began_s
                level_v = self._supply.towards(float(self._drive.volts(np.array([t]))[0]))
                if level_v != self._supply.idle_v():
                    self._supply.set_level(level_v)
                elif t >= self._drive.duration_s:
                    return
        except Exception as error:  # noqa: BLE001 - told by `end`, to whoever owns the run
            self._failure = error

    def end(self) -> BaseException | None:
        """Stay where it is; what went wrong on the way."""
        self._told.set()
        self.join()
        return self._failure
