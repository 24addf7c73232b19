"""Carries out the steps of one entry on an armed bench, and answers each.

The samples of one recording while it is made: converted and judged block by block, kept only where they are few.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import closing
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.bench.bench import DISPLACEMENT_CHANNEL, DRIVE_CHANNEL, Bench, channel_skew_s, drive_voltage
from drivers.bench.bench import ArmedBench as ArmedBench
from drivers.drive import Drive, Hold, Sine
from drivers.errors import BenchError
from drivers.interfaces import Block, Reading, Scale
from protocols.base.events import (
    BlockDiscarded,
    DriveStarted,
    LogMessage,
    PromptAnswered,
    PromptShown,
    RecordingFinished,
    SettlingFinished,
)
from protocols.base.operator import Operator
from protocols.base.protocol import Protocol
from protocols.base.quality import Quality
from protocols.base.records import (
    MAX_RECORDING_SCANS,
    STREAMED_RECORDING_SCANS,
    Array,
    PlanEntry,
    Recording,
    StreamedRecording,
    recording_too_long_message,
    scale_counts,
)
from protocols.base.steps import (
    Ask,
    DetectionResult,
    Log,
    Play,
    Prompt,
    ReadMeter,
    Record,
    Repeat,
    Settle,
    SettlingResult,
    StepResult,
    WaitForDetection,
)
from protocols.runfile.writer import RunFileWriter
from protocols.runner.publisher import RunRecorder
from protocols.signals import SettlingDetector

BlockScaling = Callable[[NDArray[np.int16]], tuple[Array, Array, Quality]]


class RecordingBuffer:
    """Takes the blocks of a recording, one after the other.

    Args:
        units: drive (V), displacement (m) and what is wrong with them, of a block's integers (2, n).
    """

    def __init__(self, scale_block: BlockScaling, first_block: Block) -> None:
        self._scale_block = scale_block
        self._first_scan, self._last_block = first_block.start, first_block
        self._samples: list[tuple[Array, Array]] = []
        self._quality, self._scaled_scans = Quality.GOOD, 0
        self.scans = first_block.raw.shape[1]
        """Scans of all blocks so far."""

    @property
    def first_scan(self) -> int:
        """The card's number of the first scan."""
        return self._first_scan

    def add(self, block: Block) -> None:
        """The next block; what came before it is counted."""
        self._scale_and_append(self._last_block.raw)
        self._last_block = block
        self.scans += block.raw.shape[1]

    def finish(self, scans: int) -> tuple[Sequence[Array], Quality]:
        """Drive and displacement, (wanted,) each, and what is wrong with them; of a long recording no samples."""
        self._scale_and_append(self._last_block.raw[:, : scans - self._scaled_scans])
        if self._last_block.stop - self._first_scan != self.scans:
            self._quality |= Quality.DROPPED
        long = scans > STREAMED_RECORDING_SCANS
        return () if long else [np.concatenate(channel) for channel in zip(*self._samples, strict=True)], self._quality

    def _scale_and_append(self, raw: NDArray[np.int16]) -> None:
        drive_v, displacement_m, flags = self._scale_block(raw)
        self._quality |= flags
        self._scaled_scans += raw.shape[1]
        if self._scaled_scans <= STREAMED_RECORDING_SCANS:
            self._samples.append((drive_v, displacement_m))
        else:
            self._samples.clear()


BLOCK_LATENCY_S = 0.05
"""After a drive begins, scans older than this may still be on their way to us."""

DRIVE_READBACK_TOLERANCE_V = 0.25
"""A drive that the card sees further off than this does not reach the amplifier; nothing is measured under it."""

ANALYSIS_TIMEOUT_S = 20.0
"""How long the run thread may work on numbers, while what plays plays on, before the watchdog takes it for hung."""

ANALYSIS_POLL_S = 0.01
"""How long it waits for numbers before it looks after the card."""

_PROMPT_IDS = itertools.count(1)
"""Unique in the program, so that a late answer to an earlier run's prompt is never taken for one of this run."""


class StepExecutor:
    """The steps of one run, entry by entry.

    Args:
        events: stores what happens, and tells it.
        interrupted: called after every block and in every wait; raises where the run shall not go on.
        expired: why the sensor's calibration is out of date; empty where it is not.
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
        self._recording_count = 0
        self._scans_read = 0
        """Scans that the card has given us."""
        self._rest_v = bench.amplifier.map.rest_v

    def attach(self, armed: ArmedBench) -> None:
        """The card runs."""
        self._armed = armed

    def run_entry(
        self, protocol: Protocol, index: int, entry: PlanEntry, armed: ArmedBench
    ) -> tuple[list[Recording], Repeat | None]:
        """All steps of an entry: what was recorded, and what shall be measured again."""
        recordings: list[Recording] = []
        settled, drive = SettlingResult(True, 0.0), None
        answer: StepResult = None
        with closing(protocol.measure(entry, self._rest_v)) as steps:
            while True:
                self._check_interrupts()
                try:
                    with self._bench.watchdog.allow_silence(
                        ANALYSIS_TIMEOUT_S
                    ):  # a long record takes its time to become a number
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
                    case WaitForDetection():
                        answer = self._wait_for_detection(armed, step)
                    case ReadMeter(meter):
                        answer = self._read_meter(meter)
                    case Log(text):
                        self._recorder.publish(LogMessage(text))
                        answer = None

    def ask_operator(self, prompt: Prompt) -> str:
        """Show a prompt and wait for the answer, however long it takes."""
        ask_id = self._show_prompt(prompt)
        while (words := self._operator.answer(ask_id)) is None:
            self._check_interrupts()
            # The card must be emptied while a person takes their time; what it sees then is no measurement.
            if self._armed is not None:
                self.discard_block(self._armed)
            else:
                self._bench.clock.sleep(0.05)
        self._recorder.publish(PromptAnswered(ask_id, words))
        if self._armed is not None:
            self._drain_stale_blocks(self._armed)
        return words

    def _drain_stale_blocks(self, armed: ArmedBench) -> None:
        """Pass over what the card saw before this moment: it may still be on its way to us, and shows what was before."""
        now = self._scan_index(armed, 0.0)
        while self.discard_block(armed).stop < now:
            self._check_interrupts()

    def discard_block(self, armed: ArmedBench) -> Block:
        """Take a block that is not kept, and let whoever watches see it."""
        block = armed.discard_block()
        self._scans_read = block.stop
        self._recorder.notify(BlockDiscarded(block))
        return block

    def run_analysis(self, armed: ArmedBench, compute: Callable[[], StepResult]) -> StepResult:
        """What `work` gives or raises. It may take its time: the card is emptied meanwhile, as far as it has blocks."""
        with self._bench.watchdog.allow_silence(ANALYSIS_TIMEOUT_S), ThreadPoolExecutor(1, "numbers") as numbers:
            done = numbers.submit(compute)
            while not wait([done], ANALYSIS_POLL_S).done:
                # On a virtual clock no time passes, so nothing is due.
                while self._scan_index(armed, -self._bench.block_s) >= self._scans_read:
                    self.discard_block(armed)
            return done.result()

    def _show_prompt(self, prompt: Prompt) -> int:
        ask_id = next(_PROMPT_IDS)
        self._recorder.publish(PromptShown(ask_id, prompt))
        self._operator.show(ask_id, prompt)
        return ask_id

    def _wait_for_detection(self, armed: ArmedBench, step: WaitForDetection) -> DetectionResult:
        ask_id = self._show_prompt(step.prompt)
        while (words := self._operator.answer(ask_id)) is None:
            self._check_interrupts()
            block = self.discard_block(armed)
            drive_v, displacement_m, _ = self._scale_block(armed, block.raw)
            if step.detector.feed(drive_v, displacement_m):
                self._recorder.publish(PromptAnswered(ask_id, "seen by the laser"))
                return DetectionResult(True, None)
        self._recorder.publish(PromptAnswered(ask_id, words))
        self._drain_stale_blocks(armed)
        return DetectionResult(False, words)

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
            fresh = slice(max(first - block.start, 0), None)
            drive_v, displacement_m, _ = self._scale_block(armed, block.raw[:, fresh])
            done = detector.feed(drive_v, displacement_m)
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
        self._check_drive_readback(armed, step.drive, block)
        self._recorder.publish(SettlingFinished(True, wait_s))
        return SettlingResult(True, wait_s)

    def _record(
        self, armed: ArmedBench, drive: Drive | None, step: Record, settled: SettlingResult, entry: int
    ) -> Recording:
        start_row = self._run_file.row_count
        wanted = math.ceil(step.duration_s * armed.rate_hz)
        if wanted > MAX_RECORDING_SCANS:
            raise BenchError(recording_too_long_message(wanted))
        gathering = RecordingBuffer(partial(self._scale_block, armed), self._read_block(armed))
        if step.drive is not None:
            while gathering.scans < step.lead_s * armed.rate_hz:
                gathering.add(self._read_block(armed))
            self._start_drive(armed, step.drive)
            # The card ran on while the source was told; what it saw meanwhile is the rest before the drive.
            wanted += max(self._scan_index(armed, BLOCK_LATENCY_S) - gathering.first_scan, 0)
        while gathering.scans < wanted:
            gathering.add(self._read_block(armed))
        samples, quality = gathering.finish(wanted)
        if not settled.settled:
            quality |= Quality.UNSETTLED
        rows = (start_row, start_row + wanted)
        known: dict[str, Any] = {
            "index": self._recording_count,
            "rows": rows,
            "rate_hz": armed.rate_hz,
            "drive": drive or Hold(self._rest_v, step.duration_s),
            "quality": quality,
            "sensor_delay_s": self._bench.sensor.delay_s - channel_skew_s(armed.scales),
            "entry": entry,
        }
        if samples:
            recording = Recording(drive_v=samples[0], displacement_m=samples[1], **known)
        else:
            recording = StreamedRecording(partial(self._read_stored, armed.scales, rows), **known)
        self._recording_count += 1
        self._run_file.append_recording(recording.rows, int(quality), recording.drive, entry)
        self._recorder.publish(RecordingFinished(recording.index, recording.rows, int(quality), recording.drive, entry))
        return recording

    def _start_drive(self, armed: ArmedBench, drive: Drive) -> None:
        armed.start_drive(drive)
        self._recorder.publish(DriveStarted(drive))

    def _scan_index(self, armed: ArmedBench, delay_s: float) -> int:
        """The scan that is taken `later_s` from now."""
        return math.ceil((self._bench.clock.now() - armed.stream.start_time_s + delay_s) * armed.rate_hz)

    def _check_drive_readback(self, armed: ArmedBench, drive: Drive, block: Block) -> None:
        seen_v = float(drive_voltage(block, armed.scales).mean())
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
        self._check_interrupts()
        return block

    def _read_stored(self, scales: Sequence[Scale], rows: tuple[int, int], drive: bool) -> Any:
        """One channel of these rows of the run's file, in volts or metres."""
        if drive:
            return scale_counts(scales[DRIVE_CHANNEL].to_volts, self._run_file.read_raw("drive", rows))
        volts, sensor = scales[DISPLACEMENT_CHANNEL].to_volts, self._bench.sensor
        return scale_counts(
            lambda raw: sensor.displacement_m(volts(raw)), self._run_file.read_raw("displacement", rows)
        )

    def _scale_block(self, armed: ArmedBench, raw: Any) -> tuple[Any, Any, Quality]:
        """Drive in volts, displacement in metres, and what is wrong with these samples."""
        sensor = self._bench.sensor
        volts = [scale.to_volts(raw[i]) for i, scale in enumerate(armed.scales)]
        quality = Quality.CALIBRATION_EXPIRED if self._calibration_warning else Quality.GOOD
        if any(armed.scales[i].is_clipped(raw[i]).any() for i in (DRIVE_CHANNEL, DISPLACEMENT_CHANNEL)):
            quality |= Quality.CLIPPED
        if not sensor.is_valid(volts[DISPLACEMENT_CHANNEL]).all():
            quality |= Quality.OUT_OF_RANGE
        return volts[DRIVE_CHANNEL], sensor.displacement_m(volts[DISPLACEMENT_CHANNEL]), quality
