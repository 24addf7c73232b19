"""Channel calibration: raw counts of the card to volts and metres, and their quality flags."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers import DISPLACEMENT_CHANNEL, DRIVE_CHANNEL, LaserSensor, Scale
from model import Array
from protocols.base.quality import Quality

TABULATED_SCANS = 1 << 18
"""From this size on, counts are converted through a table of all counts."""


@dataclass(frozen=True, slots=True)
class ChannelCalibration:
    """Conversion of a channel's raw counts to SI units.

    Attributes:
        scale: the card's polynomial, counts to volts.
        sensor: volts to metres; None for the drive, which stays in volts.
    """

    scale: Scale
    sensor: LaserSensor | None = None

    @classmethod
    def pair(cls, scales: Sequence[Scale], sensor: LaserSensor) -> tuple[Self, Self]:
        """Return the calibrations of drive and displacement."""
        return cls(scales[DRIVE_CHANNEL]), cls(scales[DISPLACEMENT_CHANNEL], sensor)

    def to_si(self, raw: NDArray[np.int16]) -> Array:
        """Return volts, or metres with a sensor; same shape as `raw`."""
        if raw.size >= TABULATED_SCANS:  # the same numbers in half the time
            counts = np.arange(1 << 16, dtype=np.uint16)
            return np.asarray(self.to_si(counts.view(np.int16))[raw.view(np.uint16)])
        volts = self.scale.to_volts(raw)
        return volts if self.sensor is None else self.sensor.displacement_m(volts)

    def quality(self, raw: NDArray[np.int16]) -> Quality:
        """Return the flags of these samples: clipped by the card, out of the sensor's range."""
        quality = Quality.CLIPPED if self.scale.is_clipped(raw).any() else Quality.GOOD
        if self.sensor is not None and not self.sensor.is_valid(self.scale.to_volts(raw)).all():
            quality |= Quality.OUT_OF_RANGE
        return quality
