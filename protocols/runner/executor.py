"""Step executor: carries out the steps of a plan entry on an armed bench and collects its recordings."""

import math
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import Any

from drivers import (
    DISPLACEMENT_CHANNEL,
    DRIVE_CHANNEL,
    ArmedBench,
    Bench,
    BenchError,
    Block,
    ClimateChamber,
    Drive,
    Hold,
    Reading,
    Scale,
    Sine,
    channel_skew_s,
)
from protocols.base import (
    AirTarget,
    Array,
    Ask,
    Cycle,
    CyclesInterrupted,
    CycleStatistics,
    DetectionResult,
    DriveStarted,
    FurtherInputs,
    InterferenceLine,
    InterferenceMeasured,
    Log,
    LogMessage,
    PlanEntry,
    Play,
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
from protocols.runfile import CHANNELS, RunFileWriter
from protocols.runner.acquisition import ANALYSIS_TIMEOUT_S, RecordingBuffer, RunAcquisition
from protocols.runner.air import JUDGED_S, AirReadings, AirWait, chamber_prompt
from protocols.runner.cycle_tally import WATCHED_S, CycleTally
from protocols.runner.operator_actions import OperatorPrompts
from protocols.runner.publisher import RunRecorder
from protocols.signals import SettlingDetector, find_lines, prediction_noise

BLOCK_LATENCY_S = 0.05
"""Time after the start of a drive in which older scans may still be in transfer."""

DRIVE_READBACK_TOLERANCE_V = 0.25
"""Largest deviation of a drive that reaches the amplifier; beyond it nothing is measured."""


MAX_PUBLISHED_LINES = 8
"""Largest number of interference lines in the log."""


class StepExecutor:
    """Executes the steps of a run, entry by entry.

    Args:
        prompts: prompts of steps to the operator.
        calibration_warning: expired calibration of the sensor as text; empty for a valid one.
    """

    def __init__(
        self,
        bench: Bench,
        run_file: RunFileWriter,
        recorder: RunRecorder,
        acquisition: RunAcquisition,
        prompts: OperatorPrompts,
        calibration_warning: str,
    ) -> None:
        self._bench, self._run_file, self._recorder = bench, run_file, recorder
        self._acquisition, self._prompts, self._calibration_warning = acquisition, prompts, calibration_warning
        self._recording_count = 0
        self._lines_at_rest: tuple[InterferenceLine, ...] = ()
        self._rest_noise_m = math.nan
        self._reached_s = math.nan, math.nan
        """Times at which the last two drives were reached, since the begin of the stream."""
        self.interference: InterferenceMeasured | None = None
        """The interference measured at rest; None before, or without a measurement."""
        self.air = AirReadings(bench)
        self._rest_v = bench.amplifier.map.rest_v
        self.driven: dict[int, CycleStatistics] = {}
        """Cycles of interrupted blocks, by entry."""

    def run_entry(
        self, protocol: Protocol, index: int, entry: PlanEntry, armed: ArmedBench
    ) -> tuple[list[Recording], Repeat | None]:
        """Execute the steps of an entry; return its recordings, and the request to measure again.

        Raises:
            LevelQuestion: an abort level was exceeded, and the operator decides.
            LevelExceededError: an abort level was exceeded that ends the run.
        """
        self._acquisition.levels.begin_entry()
        recordings: list[Recording] = []
        settled, drive = SettlingResult(True, 0.0), None
        answer: StepResult = None
        with closing(protocol.measure(entry, self._rest_v)) as steps:
            while True:
                self._acquisition.check_interrupts()
                self._acquisition.raise_question()
                try:
                    # The analysis of a long recording takes time.
                    with self._bench.watchdog.allow_silence(ANALYSIS_TIMEOUT_S):
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
                        answer = self._record(armed, drive, step, settled, index, protocol.max_recording_scans)
                        recordings.append(answer)
                    case Cycle():
                        answer = self._cycle(armed, step, index)
                        recordings.append(answer)
                    case Ask(prompt):
                        answer = self._prompts.ask(prompt)
                    case WaitForDetection(prompt, detector):
                        text = self._prompts.wait_for_answer(prompt, detector)
                        answer = DetectionResult(text is None, text)
                    case ReadMeter(meter):
                        answer = self._read_meter(meter)
                    case Log(text):
                        self._recorder.publish(LogMessage(text))
                        answer = None

    def wait_for_air(self, armed: ArmedBench, target: AirTarget, tell: Callable[[str, float], None]) -> None:
        """Set the climate chamber, by its driver or by a prompt, and wait at rest; `tell` publishes the progress.

        Raises:
            BenchError: the chamber refuses, or the wait is too long.
            RunCancelled: Stop was requested.
        """
        clock, chamber = self._bench.clock, self._bench.environment
        wait, is_set = AirWait(target, clock.now()), False
        armed.return_to_verified_rest()
        while True:
            self.air.request()
            end = self._acquisition.scan_index(armed, JUDGED_S)
            armed.stream.skip(JUDGED_S - WATCHED_S)
            while (block := self._acquisition.watch_block(armed)).stop < end:
                pass
            if wait.is_over(clock.now(), self.air.present_c(block, armed.scales)):
                break
            if isinstance(chamber, ClimateChamber) and not is_set:
                self._acquisition.run_analysis(armed, partial(chamber.set_temperature, target.celsius))
            elif not (is_set or wait.is_near or self._prompts.unreachable_reason):
                self._prompts.ask(chamber_prompt(target))
                wait = AirWait(target, clock.now())
            is_set = True
            tell(f"waiting for {wait.text}", wait.left_s)
        self._recorder.publish(LogMessage(f"Waited for {wait.text}"))

    def measure_interference(self, armed: ArmedBench, duration_s: float) -> None:
        """Record the displacement at rest, before the first drive, and publish its hum and other lines."""
        scans, start_row = math.ceil(duration_s * armed.rate_hz), self._run_file.row_count
        buffer = RecordingBuffer(self._acquisition.channels, self._acquisition.read_block(armed))
        while buffer.scans < scans:
            buffer.add(self._acquisition.read_block(armed))
        samples, quality = buffer.finish(scans)
        rows = (start_row, start_row + scans)
        if not quality.usable:
            self._recorder.publish(
                LogMessage(
                    f"Interference at rest could not be measured: {quality.description} in the recording at rest"
                )
            )
            return
        displacement_m = samples[1] if samples else self._read_stored(rows, drive=False)
        find = partial(find_lines, displacement_m, armed.rate_hz)
        self._lines_at_rest = self._acquisition.run_analysis(armed, find)
        self._rest_noise_m = prediction_noise(displacement_m)
        significant = tuple(line for line in self._lines_at_rest if line.significant)
        self.interference = InterferenceMeasured(rows, significant[:MAX_PUBLISHED_LINES])
        self._recorder.publish(self.interference)

    def _settle(self, armed: ArmedBench, step: Settle) -> SettlingResult:
        if not isinstance(step.drive, Sine):
            raise BenchError(f"settling is detected under a sine, not under {step.drive.kind}")
        self._start_drive(armed, step.drive)
        rate = armed.rate_hz
        first = self._acquisition.scan_index(armed, BLOCK_LATENCY_S)
        last = first + math.ceil(step.limit_s * rate)
        detector = SettlingDetector(
            rate, step.drive.frequency_hz, round(step.window_s * rate), step.drive.amplitude_v, step.tolerance
        )
        while True:
            block = self._acquisition.read_block(armed)
            done = detector.feed(*self._acquisition.to_si(block.raw[:, max(first - block.start, 0) :]))
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
        self._check_level_lasts(armed, wait_s)
        last = self._acquisition.scan_index(armed, wait_s)
        block = self._acquisition.read_block(armed)
        while block.stop < last:
            block = self._acquisition.read_block(armed)
        self._check_drive_readback(step.drive, block)
        self._recorder.publish(SettlingFinished(True, wait_s))
        return SettlingResult(True, wait_s)

    def _record(
        self, armed: ArmedBench, drive: Drive | None, step: Record, settled: SettlingResult, entry: int, longest: float
    ) -> Recording:
        self.air.request()
        start_row = self._run_file.row_count
        scans = math.ceil(step.duration_s * armed.rate_hz)
        if scans > longest:
            raise BenchError(recording_too_long_message(scans))
        levels = self._acquisition.levels
        buffer = RecordingBuffer(self._acquisition.channels, self._acquisition.read_block(armed))
        drive_off = step.drive is None and levels.drive_lost
        if step.drive is not None:
            while buffer.scans < step.lead_s * armed.rate_hz:
                buffer.add(self._acquisition.read_block(armed))
            self._start_drive(armed, step.drive)
            # The card continued during the start of the source; these samples are the rest before the drive.
            scans += max(self._acquisition.scan_index(armed, BLOCK_LATENCY_S) - buffer.first_scan, 0)
        self._check_level_lasts(armed, step.duration_s)
        while buffer.scans < scans:
            buffer.add(self._acquisition.read_block(armed))
            drive_off |= levels.drive_lost
        flags = (Quality.GOOD if settled.settled else Quality.UNSETTLED) | (
            Quality.DRIVE_OFF if drive_off else Quality.GOOD
        )
        return self._store_recording(armed, buffer, (start_row, start_row + scans), drive, flags, entry)

    def _cycle(self, armed: ArmedBench, step: Cycle, entry: int) -> Recording:
        """Play the cycles that are left of a block to their end; an interruption keeps the count of those driven."""
        self.air.request()
        before = self.driven.get(entry, CycleStatistics())
        left = step.drive.cycles - before.cycles
        if left > 0:
            drive, start_row = replace(step.drive, cycles=left), self._run_file.row_count
            tally = CycleTally(before, self._acquisition)
            started_s = self._bench.clock.now()
            try:
                self._start_drive(armed, drive)
                started_s = self._bench.clock.now()
                buffer = tally.read(armed, drive, step.keep_s, self._bench.clock)
            except BaseException:
                # Counted until rest is commanded, and a cycle for its way.
                played = (self._bench.clock.now() - started_s) * drive.frequency_hz
                driven = before.cycles + min(math.ceil(played) + 1, left)
                self.driven[entry] = replace(tally.statistics, cycles=driven)
                self._recorder.publish_always(CyclesInterrupted(entry, self.driven[entry]))
                raise
        else:
            drive, start_row, tally = step.drive, self._run_file.row_count, CycleTally(before, self._acquisition)
            buffer = RecordingBuffer(self._acquisition.channels, self._acquisition.read_block(armed))
        statistics = replace(tally.statistics, cycles=step.drive.cycles)
        self.driven[entry] = statistics  # also where the pause is interrupted
        if step.rest_s:
            armed.return_to_verified_rest()
            tally.rest(armed, step.rest_s)
        del self.driven[entry]
        flags = tally.quality | (Quality.DRIVE_OFF if tally.drive_lost else Quality.GOOD)
        rows = (start_row, start_row + buffer.scans)
        return self._store_recording(armed, buffer, rows, drive, flags, entry, statistics)

    def _store_recording(
        self,
        armed: ArmedBench,
        buffer: RecordingBuffer,
        rows: tuple[int, int],
        drive: Drive | None,
        flags: Quality,
        entry: int,
        cycles: CycleStatistics | None = None,
    ) -> Recording:
        """Return the recording of the buffer with its flags, and store its rows."""
        levels = self._acquisition.levels
        samples, quality = buffer.finish(rows[1] - rows[0])
        quality |= flags
        if self._calibration_warning:
            quality |= Quality.CALIBRATION_EXPIRED
        if levels.entry_flagged:
            quality |= Quality.LEVEL_EXCEEDED
        fields: dict[str, Any] = {
            "index": self._recording_count,
            "rows": rows,
            "rate_hz": armed.rate_hz,
            "drive": drive or Hold(self._rest_v, (rows[1] - rows[0]) / armed.rate_hz),
            "quality": quality,
            "sensor_delay_s": self._bench.sensor.delay_s - channel_skew_s(armed.scales),
            "velocity_corner_hz": self._bench.sensor.corner_hz if self._bench.sensor.measures_velocity else None,
            "entry": entry,
            "interference": self._lines_at_rest,
            "start_s": buffer.first_scan / armed.rate_hz,
            "rest_noise_m": self._rest_noise_m,
            "rested_s": self._reached_s[0],
            "cycles": cycles,
            "inputs": FurtherInputs(self._bench.configuration, partial(self._read_input, armed.scales)),
        }
        fields["air"], messages = self.air.read(fields["inputs"], rows)
        if samples:
            recording = Recording(drive_v=samples[0], displacement_m=samples[1], **fields)
        else:
            recording = StreamedRecording(self._read_stored, **fields)
        for message in messages:
            self._recorder.publish(LogMessage(message))
        self._recording_count += 1
        self._run_file.append_recording(recording.rows, int(quality), recording.drive, entry)
        self._recorder.publish(RecordingFinished(recording.index, recording.rows, int(quality), recording.drive, entry))
        return recording

    def _start_drive(self, armed: ArmedBench, drive: Drive) -> None:
        armed.start_drive(drive)
        self._reached_s = self._reached_s[1], self._recorder.elapsed_s()
        self._recorder.publish(DriveStarted(drive))

    def _check_level_lasts(self, armed: ArmedBench, needed_s: float) -> None:
        """Reject a recording or wait beyond the end of a level that returns to rest by itself."""
        left_s = armed.amplifier.level_remaining_s
        if left_s < needed_s + BLOCK_LATENCY_S:
            raise BenchError(
                f"the held level returns to rest by itself in {left_s:.1f} s, and {needed_s:g} s are to be recorded or waited under it; "
                "give its Hold a longer duration_s in the protocol, or close other programs if they held this one up"
            )

    def _check_drive_readback(self, drive: Drive, block: Block) -> None:
        seen_v = float(self._acquisition.channels[DRIVE_CHANNEL].to_si(block.raw[DRIVE_CHANNEL]).mean())
        if not drive.low_v - DRIVE_READBACK_TOLERANCE_V <= seen_v <= drive.high_v + DRIVE_READBACK_TOLERANCE_V:
            raise BenchError(
                f"the card sees {seen_v:.3f} V where {drive.low_v:g} to {drive.high_v:g} V are driven (limit "
                f"{DRIVE_READBACK_TOLERANCE_V:g} V); check the cable from the generator to the amplifier and to the card"
            )

    def _read_meter(self, name: str) -> Reading:
        meter = self._bench.meters.get(name)
        if meter is None:
            have = ", ".join(self._bench.meters) or "none"
            raise BenchError(f"this bench has no meter '{name}' (it has: {have}); add it to the bench file")
        return meter.read()

    def _read_input(self, scales: Sequence[Scale], name: str, rows: tuple[int, int]) -> tuple[Array, float]:
        """Return the volts at a further input in these rows of the run file, and the skew of its conversion behind the drive's."""
        names = [channel.name for channel in self._bench.channels]
        scale = scales[DISPLACEMENT_CHANNEL + 1 + names.index(name)]
        return scale.to_volts(self._run_file.read_raw(name, rows)), scale.skew_s - scales[DRIVE_CHANNEL].skew_s

    def _read_stored(self, rows: tuple[int, int], drive: bool) -> Array:
        """Read one channel of these rows of the run file, in volts or metres."""
        number = DRIVE_CHANNEL if drive else DISPLACEMENT_CHANNEL
        return self._acquisition.channels[number].to_si(self._run_file.read_raw(CHANNELS[number], rows))
