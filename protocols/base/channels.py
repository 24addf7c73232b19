"""Channel calibration: raw counts of the card to volts and metres, and their quality flags."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers import DISPLACEMENT_CHANNEL, DRIVE_CHANNEL, LaserSensor, Scale
from model import Array
from protocols.base.quality import Quality

TABULATED_SCANS = 256
"""Size above which counts are converted through a cached table of all counts."""
LOOK_UP_SCANS = 16_384
"""Number of counts per look-up."""


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
        if raw.size >= TABULATED_SCANS:  # equal values in a third of the time
            return _look_up(_values_of_counts(self), raw)
        return self._computed(raw)

    def _computed(self, raw: NDArray[np.int16]) -> Array:
        volts = self.scale.to_volts(raw)
        return volts if self.sensor is None else self.sensor.displacement_m(volts)

    def quality(self, raw: NDArray[np.int16]) -> Quality:
        """Return the flags of these samples: clipped by the card, out of the sensor's range."""
        # A card's polynomial rises with the counts: it suffices to check the ends.
        ends = np.array([raw.min(), raw.max()], np.int16) if raw.size else raw
        quality = Quality.CLIPPED if self.scale.is_clipped(ends).any() else Quality.GOOD
        if self.sensor is not None and not self.sensor.is_valid(self.scale.to_volts(ends)).all():
            quality |= Quality.OUT_OF_RANGE
        return quality


@lru_cache(maxsize=16)
def _values_of_counts(channel: ChannelCalibration) -> Array:
    """Return the value of every count, in the order of the counts as unsigned numbers, (65536,)."""
    return channel._computed(np.arange(1 << 16, dtype=np.uint16).view(np.int16))  # noqa: SLF001 - of this module


def _look_up(values: Array, raw: NDArray[np.int16]) -> Array:
    """Return the values of counts, same shape; in pieces, because numpy makes indices of eight bytes of the counts."""
    counts = np.ascontiguousarray(raw).view(np.uint16).ravel()
    looked_up = np.empty(counts.size)
    for start in range(0, counts.size, LOOK_UP_SCANS):
        piece = slice(start, start + LOOK_UP_SCANS)
        np.take(values, counts[piece], out=looked_up[piece], mode="clip")  # the default mode copies `out`
    return looked_up.reshape(raw.shape)
