"""Channel calibration: raw counts of the card to volts and metres, and their quality flags."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from drivers import DISPLACEMENT_CHANNEL, DRIVE_CHANNEL, InputChannel, LaserSensor, Scale
from model import AmplifierMap, Array
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


VOLTAGE_KIND, FLOW_KINDS = "voltage-monitor", ("current-monitor", "charge")
"""Kinds of a bench's further inputs: volts on the specimen, and what flows into it."""
AIR_KINDS = "temperature", "humidity"
"""Kinds of sensors of the air: degrees Celsius, and relative humidity from 0 to 1."""


@dataclass(frozen=True, slots=True)
class ChannelSignal:
    """Samples of a further input in a recording, in its unit, (N,); `delay_s` is their whole delay behind the drive's samples."""

    channel: InputChannel
    values: Array
    delay_s: float


@dataclass(frozen=True, slots=True)
class FurtherInputs:
    """Further inputs of the card in the rows of a run.

    Attributes:
        configuration: the bench file, with its tables `channels` and `amplifier`.
        read: function that returns volts at the terminal of a channel in some rows, and the skew of its conversion behind the drive's.
    """

    configuration: Mapping[str, Any]
    read: Callable[[str, tuple[int, int]], tuple[Array, float]]

    def signal(self, rows: tuple[int, int], *kinds: str) -> ChannelSignal | None:
        """Return the samples of the first channel of one of the kinds; None without such a channel.

        Raises:
            ValueError: the configuration of a foreign file has an invalid channel.
        """
        names = {each.name for each in fields(InputChannel)}
        for table in self.configuration.get("channels", ()):
            try:
                values = {name: table[name] for name in names & set(table)}
                channel = InputChannel(terminal=str(table["channel"]), **values)
            except (KeyError, TypeError) as error:
                raise ValueError(f"its bench file has an invalid table of channels ({error})") from None
            if channel.kind in kinds:
                volts, skew_s = self.read(channel.name, rows)
                return ChannelSignal(channel, channel.values(volts), channel.delay_s - skew_s)
        return None

    def specimen_voltage(self, rows: tuple[int, int], drive_v: Array) -> ChannelSignal:
        """Return the volts on the specimen: of the voltage monitor, or without one the drive through the amplifier's characteristic."""
        if (seen := self.signal(rows, VOLTAGE_KIND)) is not None:
            return seen
        table = self.configuration.get("amplifier", {})
        characteristic = AmplifierMap(**{f.name: float(table[f.name]) for f in fields(AmplifierMap) if f.name in table})
        error = float(table.get("slope_relative_uncertainty", 0.0))
        stated = InputChannel("drive", "", kind=VOLTAGE_KIND, gain_relative_uncertainty=error)
        return ChannelSignal(stated, characteristic.specimen_v(drive_v), 0.0)
