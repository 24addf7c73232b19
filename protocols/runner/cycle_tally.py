"""Cycle tally: reads the card while a sine is played to its end, stores the first part, and keeps statistics of the rest."""

from drivers import DISPLACEMENT_CHANNEL, ArmedBench, Block, Clock, Sine
from protocols.base import CycleStatistics, Quality
from protocols.runner.acquisition import RecordingBuffer, RunAcquisition

START_S = 0.1
"""Time after the start of a drive in which older scans may still be in transfer, and before its end, which has no exact time."""

CLOCK_SHARE = 1e-4
"""Largest difference between the clocks of source and card, relative."""

WATCHED_S = 0.25
"""Time that is read at the begin of a block and before its end on the virtual clock, which passes the rest unread."""


class CycleTally:
    """Statistics of the blocks read under one sine.

    Args:
        before: statistics of the cycles before an interruption.

    Attributes:
        quality: flags of samples that are not in the statistics.
        drive_lost: whether the card saw another drive.
    """

    def __init__(self, before: CycleStatistics, acquisition: RunAcquisition) -> None:
        self.statistics, self._acquisition = before, acquisition
        self.quality, self.drive_lost = Quality.GOOD, False

    def read(self, armed: ArmedBench, drive: Sine, keep_s: float, clock: Clock) -> RecordingBuffer:
        """Read until the drive, which has just started, has ended; return the stored samples, `keep_s` and one block at least.

        Raises:
            LevelQuestion, LevelExceededError: an abort level was exceeded.
            RunCancelled, PauseInterrupt: stop or pause was requested.
        """
        acquisition, rate = self._acquisition, armed.rate_hz
        first, start_s = acquisition.scan_index(armed, START_S), clock.now()
        last = acquisition.scan_index(armed, drive.duration_s * (1 - CLOCK_SHARE) - START_S)
        end = acquisition.scan_index(armed, drive.duration_s * (1 + CLOCK_SHARE) + START_S)
        block = acquisition.read_block(armed)
        while block.start < first:
            block = acquisition.read_block(armed)
        buffer, kept = RecordingBuffer(acquisition.channels, block), True
        while True:
            if first <= block.start and block.stop <= last:
                self._add(block)
            if block.stop >= end:
                return buffer
            kept = kept and buffer.scans < keep_s * rate and block.stop < last
            if not kept:
                self._skip(armed, start_s + drive.duration_s - WATCHED_S - clock.now(), clock.now() - start_s)
            block = acquisition.read_block(armed) if kept else acquisition.watch_block(armed)
            if kept:
                buffer.add(block)

    def rest(self, armed: ArmedBench, seconds: float) -> None:
        """Read without storing at rest for this time; raises as `read`."""
        end = self._acquisition.scan_index(armed, seconds)
        armed.stream.skip(seconds - WATCHED_S)
        while self._acquisition.watch_block(armed).stop < end:
            pass

    def _skip(self, armed: ArmedBench, left_s: float, played_s: float) -> None:
        if left_s > WATCHED_S and played_s > WATCHED_S:
            armed.stream.skip(left_s)

    def _add(self, block: Block) -> None:
        self.drive_lost |= self._acquisition.levels.drive_lost
        channel, counts = self._acquisition.channels[DISPLACEMENT_CHANNEL], block.raw[DISPLACEMENT_CHANNEL]
        if (quality := channel.quality(counts)).usable:
            self.statistics = self.statistics.with_samples(channel.to_si(counts))
        else:
            self.quality |= quality
