"""Air around the simulated tactor: of a laboratory that drifts, or of a climate chamber that approaches what is set."""

import numpy as np

from model import Array
from sim_hardware.plant.parameters import RoomParameters

STEP_K = 0.05
"""Resolution of the temperature of the tactor: each needs its own modes, and a fit does not see less than 0.1 K."""


class Room:
    """The temperature over bench time."""

    def __init__(self, parameters: RoomParameters) -> None:
        self.parameters = parameters
        self._settings: list[tuple[float, float, float]] = []
        """Time of each setting of the chamber, the temperature then, and the set one."""

    def temperature_at(self, t: Array) -> Array:
        """Return the temperature at bench times `t`, degrees Celsius, same shape."""
        room = self.parameters
        found = room.temperature_c + room.drift_k_per_h / 3600 * np.asarray(t, float)
        for at_s, before_c, set_c in self._settings:
            approached = set_c + (before_c - set_c) * np.exp(-np.maximum(t - at_s, 0) / room.chamber_lag_s)
            found = np.where(t < at_s, found, approached)
        return np.asarray(found)

    def tactor_c(self, t: float) -> float:
        """Return the temperature of the tactor at a bench time, degrees Celsius, in steps of STEP_K."""
        return STEP_K * round(float(self.temperature_at(np.array(t))) / STEP_K)

    def capacitance_share(self, t: float) -> float:
        """Return the capacitance at a bench time, relative to the capacitance at the reference temperature."""
        room = self.parameters
        if not room.capacitance_per_kelvin:
            return 1.0
        return 1 + room.capacitance_per_kelvin * (self.tactor_c(t) - room.reference_c)

    def set_chamber(self, at_s: float, celsius: float) -> None:
        """Set the chamber at a bench time."""
        self._settings.append((at_s, float(self.temperature_at(np.array(at_s))), celsius))
