"""Acquisition of a run: reads the card's blocks, buffers recordings, reports exceeded abort levels, checks for interrupts."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from drivers import (
    ArmedBench,
    Bench,
    BenchError,
    Block,
    CallThread,
    Deadline,
    LevelAction,
    OverdueError,
    ScansLostError,
)
from protocols.base import (
    STREAMED_RECORDING_SCANS,
    Array,
    BlockDiscarded,
    ChannelCalibration,
    DriveReadbackChanged,
    LevelExceeded,
    Quality,
    StepResult,
)
from protocols.runner.abort_levels import LevelExceededError, LevelMonitor, LevelQuestion
from protocols.runner.publisher import RunRecorder


class RecordingBuffer:
    """Collects the blocks of one recording as drive and displacement in SI; a long recording stores no samples.

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
        """Number of scans of all blocks."""

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
            quality |= channel.quality(ends)  # it suffices to check the ends
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


ANALYSIS_TIMEOUT_S = 20.0
"""Longest duration of an analysis during a drive before the watchdog considers the program hung."""

ANALYSIS_SHARE = 0.2
"""The limit as a share of the recording, if that is longer: a dwell of ten minutes."""

ANALYSIS_POLL_S = 0.01
"""Interval between readings of the card during an analysis."""


class RunAcquisition:
    """Reads the blocks of a run.

    Args:
        check_interrupts: callback after every block and in every wait; raises to end or pause the run.

    Attributes:
        levels: abort levels, evaluated in every block.
        channels: calibrations of drive and displacement; empty before `attach`.
    """

    def __init__(self, bench: Bench, recorder: RunRecorder, check_interrupts: Callable[[], None]) -> None:
        self._bench, self._recorder, self.check_interrupts = bench, recorder, check_interrupts
        self.levels = LevelMonitor(bench.levels, bench.sensor, bench.amplifier.map.rest_v, bench.clock, bench.channels)
        self.channels: Sequence[ChannelCalibration] = ()
        self._armed: ArmedBench | None = None
        self._scans_read = 0
        """Number of scans read from the card."""
        self._numbers = CallThread("numbers")
        self._question: LevelExceeded | None = None
        """An exceeded level that needs a decision of the operator."""

    def attach(self, armed: ArmedBench) -> None:
        """Adopt a bench with a running card."""
        self._armed, self.channels = armed, ChannelCalibration.pair(armed.scales, self._bench.sensor)
        self.levels.attach(armed.scales, armed.rate_hz, armed.stream.start_time_s)
        armed.monitor = self.levels

    def close(self) -> None:
        """End the thread of the analyses."""
        self._numbers.end()

    def read_block(self, armed: ArmedBench) -> Block:
        """Read and store a block.

        Raises:
            LevelQuestion: an abort level was exceeded, and the operator decides.
            LevelExceededError: an exceeded abort level ends the run.
        """
        block = armed.read_block()
        self._scans_read = block.stop
        self._report_levels()
        self.check_interrupts()
        self.raise_question()
        return block

    def watch_block(self, armed: ArmedBench) -> Block:
        """Read a block under a drive without storing it; raises as `read_block`. Lost scans are ignored."""
        block = self.discard_block(armed)
        self.check_interrupts()
        self.raise_question()
        return block

    def discard_block(self, armed: ArmedBench) -> Block:
        """Read a block without storing it, and publish it. Lost scans are ignored.

        Raises:
            LevelExceededError: an abort level was exceeded that ends the run.
        """
        try:
            block = armed.discard_block()
        except ScansLostError:
            block = armed.discard_block()
        self._scans_read = block.stop
        self._recorder.notify(BlockDiscarded(block))
        self._report_levels()
        return block

    def wait_for_block(self) -> Block | None:
        """Discard the next block; without a card, wait for the duration of a block and return None."""
        if self._armed is None:
            self._bench.clock.sleep(0.05)
            return None
        return self.discard_block(self._armed)

    def drain_stale_blocks(self) -> None:
        """Discard the blocks sampled before now, which may still be in transfer."""
        if self._armed is None:
            return
        now = self.scan_index(self._armed, 0.0)
        while self.discard_block(self._armed).stop < now:
            self.check_interrupts()

    def run_analysis(self, armed: ArmedBench, compute: Callable[[], StepResult], recorded_s: float = 0.0) -> StepResult:
        """Return the result of `compute` or raise its error; the card is read meanwhile, so that its buffer does not overflow."""
        allowed_s = max(ANALYSIS_TIMEOUT_S, ANALYSIS_SHARE * recorded_s)

        def read_due_blocks() -> None:
            # On a virtual clock no time passes.
            while self.scan_index(armed, -self._bench.block_s) >= self._scans_read:
                self.discard_block(armed)

        longest_s = Deadline.ANALYSIS.seconds + recorded_s
        try:
            with self._bench.watchdog.allow_silence(allowed_s):
                return self._numbers.call(compute, longest_s, read_due_blocks, ANALYSIS_POLL_S)
        except OverdueError:
            raise BenchError(f"the analysis of a recording has not ended after {longest_s:.0f} s") from None

    def scan_index(self, armed: ArmedBench, delay_s: float) -> int:
        """Return the index of the scan `delay_s` from now."""
        return math.ceil((self._bench.clock.now() - armed.stream.start_time_s + delay_s) * armed.rate_hz)

    def to_si(self, raw: NDArray[np.int16]) -> tuple[Array, ...]:
        """Return the counts of a block, (channels, scans), as volts at the amplifier's input and metres, (scans,) each."""
        return to_si(self.channels, raw)

    def raise_question(self) -> None:
        """Raise the pending question to the operator about an exceeded level.

        Raises:
            LevelQuestion: an abort level was exceeded, and the operator decides.
        """
        question, self._question = self._question, None
        if question is not None:
            raise LevelQuestion(question)

    def _report_levels(self) -> None:
        """Publish the abort levels exceeded by the last block, and changes of the drive at the card.

        Raises:
            LevelExceededError: an exceeded level ends the run.
        """
        for event in self.levels.take_events():
            if isinstance(event, DriveReadbackChanged):
                self._recorder.notify(event)
                continue
            self._recorder.publish(event)
            if event.action == LevelAction.REST:
                raise LevelExceededError(event.words)
            if event.action == LevelAction.ASK:
                self._question = self._question or event
