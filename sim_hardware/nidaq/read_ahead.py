"""Read-ahead of the simulated card on a virtual clock: several blocks are computed together, as long as nothing changes.

The numpy calls on one short block cost as much as their work. Blocks that have not been asked for yet are provisional: a change of
drive, setup, laser view or faults discards them, and they are computed anew.
"""

import numpy as np

from sim_hardware.nidaq.card import Acquisition, Counts

AHEAD_S = 0.8
"""Longest span that is computed together: beyond this the arrays no longer fit into the processor's cache."""

AHEAD_SCANS = 20_000
"""The same in scans, for high sample rates."""


class ReadAhead:
    """Reads the blocks of an acquisition in order.

    Args:
        acquisition: of the simulated card.
        block_scans: scans of each block.
    """

    def __init__(self, acquisition: Acquisition, block_scans: int) -> None:
        self._acquisition, self._block_scans = acquisition, block_scans
        self._most_blocks = int(min(AHEAD_S * acquisition.rate_hz, AHEAD_SCANS) / block_scans)
        self._computed: Counts = np.empty((len(acquisition.channels), 0), np.int16)
        self._first_scan = 0
        """Scan at which `_computed` begins."""
        self._change_count = -1
        self._unchanged_blocks = 0
        """Blocks read since the last change: a change is as likely to come again after so many."""

    def read(self, first: int, now_s: float) -> Counts:
        """Return the counts of the block from scan `first` on, (channels, block_scans); it must have been taken at `now_s`."""
        acquisition, count = self._acquisition, self._block_scans
        if self._change_count != acquisition.change_count:
            self._unchanged_blocks, self._change_count = 0, acquisition.change_count
            self._computed = self._computed[:, :0]
        begin = first - self._first_scan
        if not 0 <= begin <= self._computed.shape[1] - count:
            blocks = max(min(self._unchanged_blocks, self._most_blocks), 1)
            self._computed = (
                acquisition.read_ahead(first, blocks * count, now_s)
                if blocks > 1
                else acquisition.read_raw(first, count)
            )
            self._first_scan, begin = first, 0
        acquisition.confirm(now_s)
        self._unchanged_blocks += 1
        return self._computed[:, begin : begin + count].copy()

    def close(self) -> None:
        """Discard what was not read."""
        self._acquisition.discard_ahead()
