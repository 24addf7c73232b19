"""The samples of one recording while it is made: converted and judged block by block, kept only where they are few."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.ports import Block
from protocols.quality import Quality
from protocols.values import LONG_SCANS, Array

Units = Callable[[NDArray[np.int16]], tuple[Array, Array, Quality]]


class Gathering:
    """Takes the blocks of a recording, one after the other.

    Args:
        units: drive (V), displacement (m) and what is wrong with them, of a block's integers (2, n).
    """

    def __init__(self, units: Units, first: Block) -> None:
        self._units = units
        self._first, self._last = first.start, first
        self._whole: list[tuple[Array, Array]] = []
        self._quality, self._taken = Quality.GOOD, 0
        self.scans = first.raw.shape[1]
        """Scans of all blocks so far."""

    @property
    def start(self) -> int:
        """The card's number of the first scan."""
        return self._first

    def add(self, block: Block) -> None:
        """The next block; what came before it is counted."""
        self._take(self._last.raw)
        self._last = block
        self.scans += block.raw.shape[1]

    def end(self, wanted: int) -> tuple[Sequence[Array], Quality]:
        """Drive and displacement, (wanted,) each, and what is wrong with them; of a long recording no samples."""
        self._take(self._last.raw[:, : wanted - self._taken])
        if self._last.stop - self._first != self.scans:
            self._quality |= Quality.DROPPED
        long = wanted > LONG_SCANS
        return () if long else [np.concatenate(channel) for channel in zip(*self._whole, strict=True)], self._quality

    def _take(self, raw: NDArray[np.int16]) -> None:
        drive_v, displacement_m, flags = self._units(raw)
        self._quality |= flags
        self._taken += raw.shape[1]
        if self._taken <= LONG_SCANS:
            self._whole.append((drive_v, displacement_m))
        else:
            self._whole.clear()
