"""A laser displacement sensor on an analogue input: a pure calibration, no I/O."""

from dataclasses import dataclass
from datetime import date

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
        serial: its serial number.
        calibrated, expires: the day of its calibration and the last day on which it holds, YYYY-MM-DD; empty: not told.
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
    expires: str = ""

    def expired(self, today: date) -> str:
        """What is to be said about a calibration that does not hold any more; empty where it does, or nothing is known."""
        if not self.expires or today <= date.fromisoformat(self.expires):
            return ""
        return (
            f"The calibration of {self.name} expired on {self.expires}; every point of this run is flagged. Have the sensor "
            "calibrated and write the new gain, its date and its expiry into the bench file"
        )

    def displacement_m(self, volts: ArrayLike) -> NDArray[np.float64]:
        """Displacement in metres, same shape as `volts`. Ask `valid` before believing it."""
        return (np.asarray(volts, float) - self.zero_v) * self.gain_m_per_v

    def valid(self, volts: ArrayLike) -> NDArray[np.bool_]:
        """Where the volts are a displacement."""
        volts = np.asarray(volts, float)
        return (volts >= self.valid_low_v) & (volts <= self.valid_high_v)
