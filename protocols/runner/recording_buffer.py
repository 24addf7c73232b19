"""Recording buffer: collects the blocks of one recording, as counts, and scales them to SI units."""

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
        self._raws: list[NDArray[np.int16]] = []
        self._lowest = self._highest = first_block.raw[: len(channels), 0]
        """Counts of each channel."""
        self._kept_scans = 0
        self.scans = first_block.raw.shape[1]
        """Scans of all blocks so far."""

    def add(self, block: Block) -> None:
        """Append the next block."""
        self._keep(self._last_block.raw)
        self._last_block = block
        self.scans += block.raw.shape[1]

    def finish(self, scans: int) -> tuple[Sequence[Array], Quality]:
        """Return drive and displacement, (scans,) each, and their flags; no samples of a long recording."""
        self._keep(self._last_block.raw[:, : scans - self._kept_scans])
        quality = Quality.GOOD if self._last_block.stop - self.first_scan == self.scans else Quality.DROPPED
        for channel, ends in zip(self._channels, np.stack((self._lowest, self._highest), axis=1), strict=True):
            quality |= channel.quality(ends)  # the ends decide for all
        if scans > STREAMED_RECORDING_SCANS:
            return (), quality
        return to_si(self._channels, np.concatenate(self._raws, axis=1)), quality

    def _keep(self, raw: NDArray[np.int16]) -> None:
        raw = raw[: len(self._channels)]
        if raw.shape[1]:
            self._lowest = np.minimum(self._lowest, raw.min(axis=1))
            self._highest = np.maximum(self._highest, raw.max(axis=1))
        self._kept_scans += raw.shape[1]
        if self._kept_scans <= STREAMED_RECORDING_SCANS:
            self._raws.append(raw)
        else:
            self._raws.clear()


def to_si(channels: Sequence[ChannelCalibration], raw: NDArray[np.int16]) -> tuple[Array, ...]:
    """Return the counts of a block, (channels, scans), in SI units: (scans,) of each calibrated channel."""
    return tuple(channel.to_si(counts) for channel, counts in zip(channels, raw, strict=False))
