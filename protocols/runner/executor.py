"""Step executor: carries out the steps of a plan entry on an armed bench and collects its recordings."""

import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import closing
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers import (
    DRIVE_CHANNEL,
    ArmedBench,
    Bench,
    BenchError,
    Block,
    Drive,
    Hold,
    LevelAction,
    Reading,
    Sine,
    channel_skew_s,
)
from protocols.base import (
    MAX_RECORDING_SCANS,
    STREAMED_RECORDING_SCANS,
    Array,
    Ask,
    BlockDiscarded,
    ChannelCalibration,
    DetectionResult,
    Detector,
    DriveReadbackChanged,
    DriveStarted,
    LevelExceeded,
    Log,
    LogMessage,
    Operator,
    PlanEntry,
    Play,
    Prompt,
    PromptAnswered,
    PromptShown,
    Protocol,
    Quality,
    ReadMeter,
    Record,
    Recording,
    RecordingFinished,
    Repeat,
    Settle,
    SettlingFinished,
    SettlingResult,
    StepResult,
    StreamedRecording,
    WaitForDetection,
    recording_too_long_message,
)
from protocols.runfile.writer import RunFileWriter
from protocols.runner.levels import LevelExceededError, LevelMonitor, LevelQuestion
from protocols.runner.publisher import RunRecorder
from protocols.signals import SettlingDetector


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
            self._samples.append(_to_si(self._channels, raw))
        else:
            self._samples.clear()


def _to_si(channels: Sequence[ChannelCalibration], raw: NDArray[np.int16]) -> tuple[Array, ...]:
    return tuple(channel.to_si(counts) for channel, counts in zip(channels, raw, strict=False))


BLOCK_LATENCY_S = 0.05
"""After a drive starts, scans older than this may still be in transfer."""

DRIVE_READBACK_TOLERANCE_V = 0.25
"""A larger deviation means that the drive does not reach the amplifier; nothing is measured then."""

ANALYSIS_TIMEOUT_S = 20.0
"""How long an analysis may take, while the drive continues, before the watchdog takes the program for hung."""

ANALYSIS_POLL_S = 0.01
"""Interval at which the card is read during an analysis."""

_PROMPT_IDS = itertools.count(1)
"""Unique in the process, so that a late answer to an earlier run's prompt is never taken for one of this run."""


class StepExecutor:
    """Executes the steps of a run, entry by entry.

    Args:
        recorder: stores and publishes events.
        check_interrupts: called after every block and in every wait; raises to end or pause the run.
        calibration_warning: why the sensor's calibration has expired; empty if it has not.
    """

    def __init__(
        self,
        bench: Bench,
        run_file: RunFileWriter,
        operator: Operator,
        recorder: RunRecorder,
        check_interrupts: Callable[[], None],
        calibration_warning: str,
    ) -> None:
        self._bench, self._run_file, self._operator = bench, run_file, operator
        self._recorder, self._check_interrupts, self._calibration_warning = (
            recorder,
            check_interrupts,
            calibration_warning,
        )
        self._armed: ArmedBench | None = None
        self._channels: Sequence[ChannelCalibration] = ()
        self._recording_count = 0
        self._scans_read = 0
        """Scans read from the card."""
        self._rest_v = bench.amplifier.map.rest_v
        self.levels = LevelMonitor(bench.levels, bench.sensor, self._rest_v, bench.clock, bench.channels)
        self._question: LevelExceeded | None = None
        """An exceeded level that the operator has to decide on."""

    def attach(self, armed: ArmedBench) -> None:
        """Take the bench whose card now runs."""
        self._armed, self._channels = armed, ChannelCalibration.pair(armed.scales, self._bench.sensor)
        self.levels.attach(armed.scales, armed.rate_hz, armed.stream.start_time_s)
        armed.monitor = self.levels

    def run_entry(
        self, protocol: Protocol, index: int, entry: PlanEntry, armed: ArmedBench
    ) -> tuple[list[Recording], Repeat | None]:
        """Execute the steps of an entry; return its recordings, and what to measure again.

        Raises:
            LevelQuestion: an abort level was exceeded, and the operator decides.
            LevelExceededError: an abort level was exceeded that ends the run.
        """
        self.levels.begin_entry()
        recordings: list[Recording] = []
        settled, drive = SettlingResult(True, 0.0), None
        answer: StepResult = None
        with closing(protocol.measure(entry, self._rest_v)) as steps:
            while True:
                self._check_interrupts()
                self._raise_question()
                try:
                    with self._bench.watchdog.allow_silence(
                        ANALYSIS_TIMEOUT_S
                    ):  # the analysis of a long record takes time
                        step = steps.send(answer)
                except StopIteration as end:
                    return recordings, end.value
                match step:
                    case Settle():
                        drive = step.drive
                        answer = settled = self._settle(armed, step)
                    case Play():
                        drive = step.drive
                        answer = settled = self._play_and_wait(armed, step)
                    case Record():
                        if step.drive is not None:
                            drive, settled = step.drive, SettlingResult(True, 0.0)
                        answer = self._record(armed, drive, step, settled, index)
                        recordings.append(answer)
                    case Ask(prompt):
                        answer = self.ask_operator(prompt)
                    case WaitForDetection(prompt, detector):
                        text = self._wait_for_answer(prompt, detector)
                        answer = DetectionResult(text is None, text)
                    case ReadMeter(meter):
                        answer = self._read_meter(meter)
                    case Log(text):
                        self._recorder.publish(LogMessage(text))
                        answer = None

    def ask_operator(self, prompt: Prompt) -> str:
        """Show a prompt, wait for the answer without a time limit, and return it."""
        return self._wait_for_answer(prompt) or ""

    def _wait_for_answer(self, prompt: Prompt, detector: Detector | None = None) -> str | None:
        """Show a prompt and wait for the answer; return None once `detector` has detected the action."""
        ask_id = next(_PROMPT_IDS)
        self._recorder.publish(PromptShown(ask_id, prompt))
        self._operator.show(ask_id, prompt)
        while (answer := self._operator.answer(ask_id)) is None:
            self._check_interrupts()
            # The card's buffer must be read while the operator takes their time; these samples are not stored.
            if self._armed is None:
                self._bench.clock.sleep(0.05)
                continue
            block = self.discard_block(self._armed)
            if detector is not None and detector.feed(*_to_si(self._channels, block.raw)):
                self._recorder.publish(PromptAnswered(ask_id, "seen by the laser"))
                return None
        self._recorder.publish(PromptAnswered(ask_id, answer))
        if self._armed is not None:
            self._drain_stale_blocks(self._armed)
        return answer

    def _drain_stale_blocks(self, armed: ArmedBench) -> None:
        """Discard the blocks sampled before this moment, which may still be in transfer."""
        now = self._scan_index(armed, 0.0)
        while self.discard_block(armed).stop < now:
            self._check_interrupts()

    def discard_block(self, armed: ArmedBench) -> Block:
        """Read a block without storing it, and publish it."""
        block = armed.discard_block()
        self._scans_read = block.stop
        self._recorder.notify(BlockDiscarded(block))
        self._report_levels()
        return block

    def run_analysis(self, armed: ArmedBench, compute: Callable[[], StepResult]) -> StepResult:
        """Return what `compute` returns or raises; the card is read meanwhile, so that its buffer does not overflow."""
        with self._bench.watchdog.allow_silence(ANALYSIS_TIMEOUT_S), ThreadPoolExecutor(1, "numbers") as numbers:
            done = numbers.submit(compute)
            while not wait([done], ANALYSIS_POLL_S).done:
                # On a virtual clock no time passes, so nothing is due.
                while self._scan_index(armed, -self._bench.block_s) >= self._scans_read:
                    self.discard_block(armed)
            return done.result()

    def _settle(self, armed: ArmedBench, step: Settle) -> SettlingResult:
        if not isinstance(step.drive, Sine):
            raise BenchError(f"settling is detected under a sine, not under {step.drive.kind}")
        self._start_drive(armed, step.drive)
        rate = armed.rate_hz
        first = self._scan_index(armed, BLOCK_LATENCY_S)
        last = first + math.ceil(step.limit_s * rate)
        detector = SettlingDetector(
            rate, step.drive.frequency_hz, round(step.window_s * rate), step.drive.amplitude_v, step.tolerance
        )
        while True:
            block = self._read_block(armed)
            done = detector.feed(*_to_si(self._channels, block.raw[:, max(first - block.start, 0) :]))
            if done or block.stop >= last:
                break
        if detector.drive_seen_v < 0.5 * step.drive.amplitude_v:
            raise BenchError(
                f"the card sees a sine of {detector.drive_seen_v:.3f} V where {step.drive.amplitude_v:g} V at "
                f"{step.drive.frequency_hz:g} Hz is driven; check the cable from the generator to the card"
            )
        answer = SettlingResult(done, (block.stop - first) / rate)
        self._recorder.publish(SettlingFinished(answer.settled, answer.after_s))
        return answer

    def _play_and_wait(self, armed: ArmedBench, step: Play) -> SettlingResult:
        self._start_drive(armed, step.drive)
        wait_s = max(step.wait_s, BLOCK_LATENCY_S)
        last = self._scan_index(armed, wait_s)
        block = self._read_block(armed)
        while block.stop < last:
            block = self._read_block(armed)
        self._check_drive_readback(step.drive, block)
        self._recorder.publish(SettlingFinished(True, wait_s))
        return SettlingResult(True, wait_s)

    def _record(
        self, armed: ArmedBench, drive: Drive | None, step: Record, settled: SettlingResult, entry: int
    ) -> Recording:
        start_row = self._run_file.row_count
        scans = math.ceil(step.duration_s * armed.rate_hz)
        if scans > MAX_RECORDING_SCANS:
            raise BenchError(recording_too_long_message(scans))
        buffer = RecordingBuffer(self._channels, self._read_block(armed))
        if step.drive is not None:
            while buffer.scans < step.lead_s * armed.rate_hz:
                buffer.add(self._read_block(armed))
            self._start_drive(armed, step.drive)
            # The card continued while the source was started; those samples are the rest before the drive.
            scans += max(self._scan_index(armed, BLOCK_LATENCY_S) - buffer.first_scan, 0)
        while buffer.scans < scans:
            buffer.add(self._read_block(armed))
        samples, quality = buffer.finish(scans)
        if not settled.settled:
            quality |= Quality.UNSETTLED
        if self._calibration_warning:
            quality |= Quality.CALIBRATION_EXPIRED
        if self.levels.entry_flagged:
            quality |= Quality.LEVEL_EXCEEDED
        rows = (start_row, start_row + scans)
        fields: dict[str, Any] = {
            "index": self._recording_count,
            "rows": rows,
            "rate_hz": armed.rate_hz,
            "drive": drive or Hold(self._rest_v, step.duration_s),
            "quality": quality,
            "sensor_delay_s": self._bench.sensor.delay_s - channel_skew_s(armed.scales),
            "entry": entry,
        }
        if samples:
            recording = Recording(drive_v=samples[0], displacement_m=samples[1], **fields)
        else:
            recording = StreamedRecording(partial(self._read_stored, rows), **fields)
        self._recording_count += 1
        self._run_file.append_recording(recording.rows, int(quality), recording.drive, entry)
        self._recorder.publish(RecordingFinished(recording.index, recording.rows, int(quality), recording.drive, entry))
        return recording

    def _start_drive(self, armed: ArmedBench, drive: Drive) -> None:
        armed.start_drive(drive)
        self._recorder.publish(DriveStarted(drive))

    def _scan_index(self, armed: ArmedBench, delay_s: float) -> int:
        """Return the index of the scan `delay_s` from now."""
        return math.ceil((self._bench.clock.now() - armed.stream.start_time_s + delay_s) * armed.rate_hz)

    def _check_drive_readback(self, drive: Drive, block: Block) -> None:
        seen_v = float(self._channels[DRIVE_CHANNEL].to_si(block.raw[DRIVE_CHANNEL]).mean())
        if not drive.low_v - DRIVE_READBACK_TOLERANCE_V <= seen_v <= drive.high_v + DRIVE_READBACK_TOLERANCE_V:
            raise BenchError(
                f"the card sees {seen_v:.3f} V where {drive.low_v:g} to {drive.high_v:g} V are driven (limit "
                f"±{DRIVE_READBACK_TOLERANCE_V:g} V); check the cable from the generator to the amplifier and to the card"
            )

    def _read_meter(self, name: str) -> Reading:
        meter = self._bench.meters.get(name)
        if meter is None:
            have = ", ".join(self._bench.meters) or "none"
            raise BenchError(f"this bench has no meter '{name}' (it has: {have}); add it to the bench file")
        return meter.read()

    def _read_block(self, armed: ArmedBench) -> Block:
        block = armed.read_block()
        self._scans_read = block.stop
        self._report_levels()
        self._check_interrupts()
        self._raise_question()
        return block

    def _report_levels(self) -> None:
        """Publish the abort levels that the last block exceeded, and whether the card sees the drive.

        Raises:
            LevelExceededError: one of them ends the run.
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

    def _raise_question(self) -> None:
        question, self._question = self._question, None
        if question is not None:
            raise LevelQuestion(question)

    def _read_stored(self, rows: tuple[int, int], drive: bool) -> Array:
        """Read one channel of these rows of the run file, in volts or metres."""
        name, channel = ("drive", self._channels[0]) if drive else ("displacement", self._channels[1])
        return channel.to_si(self._run_file.read_raw(name, rows))
