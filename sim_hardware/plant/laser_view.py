"""What the laser sensor looks at: the tactor's centre, or the membrane by itself; its zero, its drift, and a knock."""

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.membrane import sag
from sim_hardware.plant.parameters import BenchTruth
from sim_hardware.plant.plant import Plant

Array = NDArray[np.float64]

SWING_HZ, SWING_DECAY_S = 4.0, 0.4
"""How a membrane swings when it is let go: its air and its rubber soon stop it."""

TACTOR, LEVEL, HANGING = "tactor", "place-reference", "hang-membrane"


@dataclass(frozen=True, slots=True)
class _View:
    """From `start_s` on the sensor sees `target`, plus `add_m`; a membrane hangs `deep_m` below the reference."""

    start_s: float
    target: str
    add_m: float
    deep_m: float = 0.0


class Sight:
    """What the sensor sees in metres, as a function of time."""

    def __init__(self, truth: BenchTruth, plant: Plant) -> None:
        self._truth, self._plant = truth, plant
        self._views = [_View(-math.inf, TACTOR, 0.0)]
        self._lock = threading.Lock()

    def seen(self, t: Array) -> Array:
        """Metres that the sensor tells at bench times `t` (n,), ascending, and its delay; without noise and range."""
        delayed = t - self._truth.sensor.delay_s
        with self._lock:
            views = list(self._views)
        number = np.searchsorted([view.start_s for view in views], t, side="right") - 1
        out = self._truth.beyond.drift_m_per_s * delayed
        for i in range(number[0], number[-1] + 1) if t.size else ():
            here, view = number == i, views[i]
            if here.any():
                out[here] += view.add_m + self._target(view, delayed[here])
        return out

    def act(self, t: float, action: str, values: Mapping[str, float]) -> None:
        """Carry out one of `situation.SENSOR` at bench time `t`; any other action makes the sensor look at the tactor again.

        Raises:
            ValueError: an elongation makes no sense.
        """
        now = self._views[-1]
        match action:
            case "zero-sensor":
                at = min(self._plant.ready_until(t), t)
                view = _View(t, now.target, now.add_m - float(self.seen(np.array([at]))[0]), now.deep_m)
            case "bump-sensor":
                view = _View(t, now.target, now.add_m + values["by_m"], now.deep_m)
            case "place-reference":
                view = _View(t, LEVEL, now.add_m)
            case "hang-membrane":
                view = _View(t, HANGING, now.add_m, self._hangs(values))
            case _ if now.target == TACTOR:
                return
            case _:
                view = _View(t, TACTOR, now.add_m)
        with self._lock:
            self._views.append(view)

    def _hangs(self, values: Mapping[str, float]) -> float:
        """How far below the reference the membrane's centre hangs."""
        truth, membrane = self._truth, self._truth.membrane
        elongation_m = values.get("elongation_m", 0.0) * (1 - truth.beyond.membrane_slip)
        if not elongation_m >= 0:
            raise ValueError(f"{HANGING}: elongation_m must not be negative, not {elongation_m:g}")
        deep_m = sag(membrane, delta=elongation_m / membrane.L_m).centre_m
        return deep_m - values["reference_m"] - truth.hands.reference_m

    def _target(self, view: _View, t: Array) -> Array:
        match view.target:
            case "place-reference":
                return np.zeros_like(t)
            case "hang-membrane":
                since = np.maximum(t - view.start_s, 0.0)
                swing = np.exp(-since / SWING_DECAY_S) * np.cos(2 * np.pi * SWING_HZ * since)
                return np.asarray(view.deep_m * (1 - swing))
        w = self._plant.displacement(t)
        gives = self._truth.beyond.clamp_gives_m_per_n
        return w + gives * self._plant.largest_n(t) if gives else w
