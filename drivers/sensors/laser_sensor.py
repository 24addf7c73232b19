"""Displacement sensor or vibrometer on an analogue input: calibration in volts, and presets by model.

`[sensor] preset = "..."` supplies values missing in the bench file. A preset is a starting point, not a calibration. Its
`confirmed` names the values of a public document; all others are from memory and depend on the settings of the controller (output
scaling, averaging, response time): confirm it on your sensor, then write it into the bench file, which takes precedence over the
preset.
"""

import tomllib
from dataclasses import dataclass
from datetime import date
from importlib.resources import files

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class SensorPreset:
    """Nominal gain and valid range of a model; fields as `drivers.sensors.laser_sensor.LaserSensor`."""

    name: str
    gain_m_per_v: float
    zero_v: float
    valid_low_v: float
    valid_high_v: float
    delay_s: float
    confirmed: str = ""
    quantity: str = "displacement"


PRESETS = {
    name: SensorPreset(gain_m_per_v=model.pop("span_m") / model.pop("span_v"), **model)
    for name, model in tomllib.loads(files("drivers.sensors").joinpath("presets.toml").read_text("utf-8")).items()
}


@dataclass(frozen=True, slots=True)
class LaserSensor:
    """Calibration of a sensor: volts to metres, or of a vibrometer to metres per second, and the valid range.

    Args:
        name: maker and model, for people.
        gain_m_per_v: displacement per volt; negative where a closer target gives more volts.
        zero_v: volts at zero displacement.
        valid_low_v, valid_high_v: outside this band the output means "out of range", not a displacement.
        delay_s: delay of its output after the target's motion.
        gain_relative_uncertainty: standard uncertainty of the gain, relative; common to all points of a run.
        serial: its serial number.
        calibrated, expires: the day of its calibration and its last day of validity, YYYY-MM-DD; empty if unknown.
        delay_uncertainty_s: standard uncertainty of the delay; 0 where none is stated.
        quantity: `displacement`, or `velocity` of a vibrometer, whose gain is in (m/s)/V.
        corner_hz: corner of a vibrometer's high pass of first order; 0: it measures constant velocities.
        curve: points (m, V) of a calibration, at rising volts, linear between them, in place of gain and zero: capacitive probes. Volts
            beyond its ends are out of range. Empty: a straight line.
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
    delay_uncertainty_s: float = 0.0
    quantity: str = "displacement"
    corner_hz: float = 0.0
    curve: tuple[tuple[float, float], ...] = ()

    @property
    def measures_velocity(self) -> bool:
        """Whether it is a vibrometer."""
        return self.quantity == "velocity"

    @property
    def unit(self) -> str:
        """SI unit of its quantity."""
        return "m/s" if self.measures_velocity else "m"

    def expiry_warning(self, today: date) -> str:
        """Return the warning for an expired calibration; empty if it is valid, or its expiry unknown."""
        if not self.expires or today <= date.fromisoformat(self.expires):
            return ""
        return (
            f"The calibration of {self.name} expired on {self.expires}; every point of this run is flagged. Have the sensor "
            "calibrated and write the new gain, its date and its expiry into the bench file"
        )

    def displacement_m(self, volts: ArrayLike) -> NDArray[np.float64]:
        """Return the displacement in metres, of a vibrometer the velocity in m/s, of the shape of `volts`; only where `is_valid`."""
        if self.curve:
            metres, at_volts = zip(*self.curve, strict=True)
            return np.asarray(np.interp(np.asarray(volts, float), at_volts, metres))
        return (np.asarray(volts, float) - self.zero_v) * self.gain_m_per_v

    def is_valid(self, volts: ArrayLike) -> NDArray[np.bool_]:
        """Return a mask of the volts that are a displacement, of the shape of `volts`."""
        volts = np.asarray(volts, float)
        low_v, high_v = self.valid_low_v, self.valid_high_v
        if self.curve:
            low_v, high_v = max(low_v, self.curve[0][1]), min(high_v, self.curve[-1][1])
        return (volts >= low_v) & (volts <= high_v)
