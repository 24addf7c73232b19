"""Laser view: target of the sensor (tactor or membrane), its zero, drift and shifts."""

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from model import Array
from sim_hardware.plant.parameters import SimulationParameters
from sim_hardware.plant.plant import Plant

MEMBRANE_SWING_HZ, MEMBRANE_SWING_DECAY_S = 4.0, 0.4
"""Swing of a released membrane: frequency and decay time, by air and rubber."""

BASE_DEPTH_M = 0.02
"""Depth of the base below the line of the membrane's clamps; the base is the target without a membrane."""

TACTOR_TARGET, REFERENCE_TARGET, MEMBRANE_TARGET, BASE_TARGET = "tactor", "place-reference", "hang-membrane", "base"


@dataclass(frozen=True, slots=True)
class _ViewChange:
    """From `start_s` the sensor measures `target`, plus `offset_m`, up to `limit_m`; membrane or base is `sag_m` below the reference.

    `mountings` counts how often the laser was moved to the tactor.
    """

    start_s: float
    target: str
    offset_m: float
    sag_m: float = 0.0
    limit_m: float = math.inf
    mountings: int = 0


class LaserView:
    """The displacement at the sensor in metres, as a function of time."""

    def __init__(self, parameters: SimulationParameters, plant: Plant) -> None:
        self._parameters, self._plant = parameters, plant
        self._views = [_ViewChange(-math.inf, TACTOR_TARGET, 0.0)]
        self._lock = threading.Lock()

    @property
    def change_count(self) -> int:
        """Number of changes of the view."""
        return len(self._views)

    def displacement(self, t: Array) -> Array:
        """Return the sensor's metres at bench times `t` (n,), ascending, with its delay; without noise and range."""
        delayed = t - self._parameters.sensor.delay_s
        with self._lock:
            views = list(self._views)
        number = np.searchsorted([view.start_s for view in views], t, side="right") - 1
        beyond = self._parameters.beyond
        out = beyond.drift_m_per_s * delayed + beyond.interference_m(t)
        for i in range(number[0], number[-1] + 1) if t.size else ():
            here, view = number == i, views[i]
            if here.any():
                out[here] += view.offset_m + self._target_displacement(view, delayed[here])
                out[here] = np.minimum(out[here], view.limit_m)
        return out

    def apply_action(self, t: float, action: str, values: Mapping[str, float], membrane_missing: bool = False) -> None:
        """Apply one of `setup_state.SENSOR_ACTIONS` at bench time `t`; any other action restores the tactor as target.

        Args:
            t: bench time.
            action: name of the action.
            values: its numbers.
            membrane_missing: whether there is no membrane, so that the base is the target.

        Raises:
            ValueError: an invalid elongation.
        """
        now = self._views[-1]
        there = replace(now, target=TACTOR_TARGET, sag_m=0.0, limit_m=math.inf)
        match action:
            case "zero-sensor":
                at = min(self._plant.available_until(t), t)
                view = replace(
                    now, offset_m=now.offset_m - float(self.displacement(np.array([at]))[0]), limit_m=math.inf
                )
            case "bump-sensor":
                view = replace(now, offset_m=now.offset_m + values["by_m"], limit_m=math.inf)
            case "limit-sensor":
                view = replace(now, limit_m=values["at_m"])
            case "place-reference":
                view = replace(there, target=REFERENCE_TARGET)
            case "hang-membrane" if membrane_missing:
                view = replace(there, target=BASE_TARGET, sag_m=BASE_DEPTH_M - values["reference_m"])
            case "hang-membrane":
                view = replace(there, target=MEMBRANE_TARGET, sag_m=self._membrane_sag_m(values))
            case "place-tactor":
                view = replace(there, mountings=now.mountings + 1)
            case "tidy-up":
                view = replace(now, mountings=int(values.get("laser_mountings", 0)))
            case _ if now.target == TACTOR_TARGET:
                return
            case _:
                view = there
        with self._lock:
            self._views.append(replace(view, start_s=t))

    def _membrane_sag_m(self, values: Mapping[str, float]) -> float:
        """Return the depth of the membrane's centre below the reference."""
        parameters, membrane = self._parameters, self._parameters.membrane
        elongation_m = values.get("elongation_m", 0.0) * (1 - parameters.beyond.membrane_slip)
        if not elongation_m >= 0:
            raise ValueError(f"{MEMBRANE_TARGET}: elongation_m must not be negative, not {elongation_m:g}")
        from model import sag  # most runs hang no membrane

        sag_m = sag(membrane, delta=elongation_m / membrane.L_m).centre_m
        return sag_m - values["reference_m"] - parameters.hands.reference_m

    def _target_displacement(self, view: _ViewChange, t: Array) -> Array:
        match view.target:
            case "place-reference":
                return np.zeros_like(t)
            case "base":
                return np.full_like(t, view.sag_m)
            case "hang-membrane":
                since = np.maximum(t - view.start_s, 0.0)
                swing = np.exp(-since / MEMBRANE_SWING_DECAY_S) * np.cos(2 * np.pi * MEMBRANE_SWING_HZ * since)
                return np.asarray(view.sag_m * (1 - swing))
        w = self._plant.displacement(t)
        gives = self._parameters.beyond.clamp_gives_m_per_n
        w = w + gives * self._plant.max_force_n(t) if gives else w
        scale = self._parameters.mounting.difference("laser", view.mountings, self._parameters.seed)
        return w * (1 + scale) if scale else w
