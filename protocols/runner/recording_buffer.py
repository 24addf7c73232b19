"""Recording buffer: collects the blocks of one recording, scaled to SI units."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers import Block
from protocols.base import STREAMED_RECORDING_SCANS, Array, ChannelCalibration, Quality


class RecordingBuffer:
    """Collects the blocks of one recording as drive and displacement in SI; a long recording keeps no samples.

    Args:
        channels: calibrations of drive and displacement.
    """

    def __init__(self, channels: Sequence[ChannelCalibration], first_block: Block) -> None:
        self._channels = channels
        self.first_scan, self._last_block = first_block.start, first_block
        """The card's number of the first scan."""
        self._samples: list[tuple[Array, ...]] = []
        self._quality, self._scaled_scans = Quality.GOOD, 0
        self.scans = first_block.raw.shape[1]
        """Scans of all blocks so far."""

    def add(self, block: Block) -> None:
        """Append the next block."""
        self._scale_and_append(self._last_block.raw)
        self._last_block = block
        self.scans += block.raw.shape[1]

    def finish(self, scans: int) -> tuple[Sequence[Array], Quality]:
        """Return drive and displacement, (scans,) each, and their flags; no samples of a long recording."""
        self._scale_and_append(self._last_block.raw[:, : scans - self._scaled_scans])
        if self._last_block.stop - self.first_scan != self.scans:
            self._quality |= Quality.DROPPED
        long = scans > STREAMED_RECORDING_SCANS
        return () if long else [np.concatenate(channel) for channel in zip(*self._samples, strict=True)], self._quality

    def _scale_and_append(self, raw: NDArray[np.int16]) -> None:
        for channel, counts in zip(self._channels, raw, strict=False):
            self._quality |= channel.quality(counts)
        self._scaled_scans += raw.shape[1]
        if self._scaled_scans <= STREAMED_RECORDING_SCANS:
            self._samples.append(to_si(self._channels, raw))
        else:
            self._samples.clear()


def to_si(channels: Sequence[ChannelCalibration], raw: NDArray[np.int16]) -> tuple[Array, ...]:
    """Return the counts of a block, (channels, scans), in SI units: (scans,) of each calibrated channel."""
    return tuple(channel.to_si(counts) for channel, counts in zip(channels, raw, strict=False))
