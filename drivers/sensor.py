"""A laser displacement sensor on an analogue input: a pure calibration, no I/O."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class LaserSensor:
    """Volts to metres, and where the volts mean nothing.

    Args:
        name: maker and model, as an operator calls it.
        gain_m_per_v: displacement per volt; negative where a closer target gives more volts.
        zero_v: volts at zero displacement.
        valid_low_v, valid_high_v: outside this band the sensor tells "out of range", not a displacement.
        delay_s: how late its output follows the target.
        gain_relative_uncertainty: standard uncertainty of the gain, relative; common to all points of a run.
        serial, calibrated: serial number and calibration date as text.
    """

    name: str
    gain_m_per_v: float
    zero_v: float = 0.0
    valid_low_v: float = -10.0
    valid_high_v: float = 10.0
    delay_s: float = 0.0
    gain_relative_uncertainty: float = 0.0
    serial: str = ""
    calibrated: str = ""

    def displacement_m(self, volts: ArrayLike) -> NDArray[np.float64]:
        """Displacement in metres, same shape as `volts`. Ask `valid` before believing it."""
        return (np.asarray(volts, float) - self.zero_v) * self.gain_m_per_v

    def valid(self, volts: ArrayLike) -> NDArray[np.bool_]:
        """Where the volts are a displacement."""
        volts = np.asarray(volts, float)
        return (volts >= self.valid_low_v) & (volts <= self.valid_high_v)
