"""Laser displacement sensor on an analogue input: calibration in volts, and presets by model.

`[sensor] preset = "..."` supplies values missing in the bench file. A preset is a starting point, not a calibration. Its
`confirmed` names the values of a public document; all others are from memory and depend on the settings of the controller (output
scaling, averaging, response time): confirm it on your sensor, then write it into the bench file, which takes precedence over the
preset.
"""

from dataclasses import dataclass
from datetime import date

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


PRESETS = {
    # LK-G: +-10 V, scaled in the controller ("not a fixed constant"); here the head's range over the full span. Beyond
    # the range the output is near 10.8 V. Delay: three samples of 50 us.
    "keyence-lk-g30": SensorPreset("Keyence LK-G30", 5e-3 / 10, 0.0, -10.2, 10.2, 150e-6),
    "keyence-lk-g80": SensorPreset("Keyence LK-G80", 15e-3 / 10, 0.0, -10.2, 10.2, 150e-6),
    "keyence-lk-g150": SensorPreset("Keyence LK-G150", 40e-3 / 10, 0.0, -10.2, 10.2, 150e-6),
    # IL: -5..+5 V over the range; an error is +5.5 V. Delay: sampling 0.33 ms, three samples.
    "keyence-il-030": SensorPreset(
        "Keyence IL-030", 15e-3 / 5, 0.0, -5.25, 5.25, 1e-3, "error output 5.5 V: DL-RS1A manual p. 13"
    ),
    "keyence-il-065": SensorPreset(
        "Keyence IL-065", 50e-3 / 5, 0.0, -5.25, 5.25, 1e-3, "error output 5.5 V: DL-RS1A manual p. 13"
    ),
    "keyence-il-100": SensorPreset(
        "Keyence IL-100", 55e-3 / 5, 0.0, -5.25, 5.25, 1e-3, "error output 5.5 V: DL-RS1A manual p. 13"
    ),
    # optoNCDT 1420: 4..20 mA; 250 ohm make 1..5 V of it, the middle of the range is 3 V. An error is below 3.8 mA.
    "optoncdt-1420-10": SensorPreset(
        "Micro-Epsilon ILD1420-10", 10e-3 / 4, 3.0, 0.95, 5.05, 1e-3, "4..20 mA: manual p. 116"
    ),
    "optoncdt-1420-25": SensorPreset(
        "Micro-Epsilon ILD1420-25", 25e-3 / 4, 3.0, 0.95, 5.05, 1e-3, "4..20 mA: manual p. 116"
    ),
    # HG-C: 0..5 V over the range, the middle is 2.5 V; response 1.5 ms at its fastest. Coarse: 10 um and more.
    "panasonic-hg-c1030": SensorPreset(
        "Panasonic HG-C1030", 10e-3 / 5, 2.5, 0.0, 5.0, 1.5e-3, "0..5 V, +-5 mm: data sheet p. 8"
    ),
    "panasonic-hg-c1050": SensorPreset(
        "Panasonic HG-C1050", 30e-3 / 5, 2.5, 0.0, 5.0, 1.5e-3, "0..5 V, +-15 mm: data sheet p. 8"
    ),
    "panasonic-hg-c1100": SensorPreset(
        "Panasonic HG-C1100", 70e-3 / 5, 2.5, 0.0, 5.0, 1.5e-3, "0..5 V, +-35 mm: data sheet p. 8"
    ),
}


@dataclass(frozen=True, slots=True)
class LaserSensor:
    """Calibration of a laser sensor: volts to metres, and the valid range.

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

    def expiry_warning(self, today: date) -> str:
        """Return the warning for an expired calibration; empty if it is valid, or its expiry unknown."""
        if not self.expires or today <= date.fromisoformat(self.expires):
            return ""
        return (
            f"The calibration of {self.name} expired on {self.expires}; every point of this run is flagged. Have the sensor "
            "calibrated and write the new gain, its date and its expiry into the bench file"
        )

    def displacement_m(self, volts: ArrayLike) -> NDArray[np.float64]:
        """Return the displacement in metres, same shape as `volts`; meaningful only where `is_valid`."""
        return (np.asarray(volts, float) - self.zero_v) * self.gain_m_per_v

    def is_valid(self, volts: ArrayLike) -> NDArray[np.bool_]:
        """Return a mask of the volts that are a displacement, of the shape of `volts`."""
        volts = np.asarray(volts, float)
        return (volts >= self.valid_low_v) & (volts <= self.valid_high_v)
