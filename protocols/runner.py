"""Executes a protocol's steps on an armed bench; owns storing, cancelling, prompting and the way to rest."""

import contextlib
import logging
import math
import threading
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np

from drivers.bench import DISPLACEMENT, DRIVE, Bench, drive_volts
from drivers.bench import Armed as ArmedBench
from drivers.drive import Drive, Sine
from drivers.errors import BenchError, UnsafeError
from drivers.ports import Block, Reading
from protocols.events import (
    Answered,
    Armed,
    Asked,
    AtRest,
    BlockTaken,
    Event,
    GoingToRest,
    Noted,
    Playing,
    PointMeasured,
    Progressed,
    Recorded,
    RunEnded,
    RunStarted,
    SettleEnded,
    Status,
    StreamStarted,
)
from protocols.operator import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE, Operator
from protocols.protocol import Protocol, rehearse
from protocols.quality import Quality
from protocols.runfile import RunFile, StoreError
from protocols.signals import SettlingDetector
from protocols.steps import Ask, Measured, Note, Play, Prompt, Read, Record, Settle, Settled, Step
from protocols.values import Estimate, Recording

FRESH_S = 0.05
"""After a drive begins, scans older than this may still be on their way to us."""

DRIVE_LOST_V = 0.25
"""A drive that the card sees further off than this does not reach the amplifier; nothing is measured under it."""

THINKING_S = 20.0
"""How long the run thread may work on numbers, while what plays plays on, before the watchdog takes it for hung."""

log = logging.getLogger(__name__)

Observer = Callable[[Event], None]


class Cancelled(Exception):
    """Somebody asked the run to stop."""


class Runner:
    r"""Runs one protocol once: created -> run() -> ended, in the thread that calls it.

    ::

        file open -> card running -> armed at rest -> steps ... -> to rest, measured -> file finished
                 \____________ any failure, Stop, Ctrl-C ____________/

    Every event is stored first and then told to the observers. A store error fails the run; an observer error is
    logged and never does. `cancel` may be set from any thread; it is looked at after every block and in every wait.
    """

    def __init__(
        self,
        protocol: Protocol,
        bench: Bench,
        store: RunFile,
        operator: Operator,
        observers: Sequence[Observer] = (),
        cancel: threading.Event | None = None,
    ) -> None:
        self._protocol, self._bench, self._store, self._operator = protocol, bench, store, operator
        self._observers = tuple(observers)
        self._cancel = cancel or threading.Event()
        self._begin_s = bench.clock.now()
        self._armed: ArmedBench | None = None
        self._asked = 0
        self._done = 0
        self._points: list[Any] = []
        self._recordings = 0
        self._store_error: StoreError | None = None
        self._next_scan = 0
        self._expired = bench.sensor.expired(datetime.now(UTC).date())

    def run(self) -> tuple[Status, str]:
        """Carry the protocol out; how it ended and why, in a sentence. Never raises."""
        status, reason = Status.COMPLETED, "all points measured"
        try:
            rehearsal = rehearse(self._protocol, self._bench.amplifier)
            self._plan = self._protocol.plan(self._bench.amplifier.map.rest_v)
            self._publish(
                RunStarted(
                    self._protocol.name,
                    str(self._store.path),
                    rehearsal.duration_s,
                    rehearsal.entries,
                    self._bench.simulated,
                )
            )
            for words in (self._bench.watchdog.words, self._expired):
                if words:
                    self._publish(Noted(words))
            with self._bench.armed(self._protocol.sample_rate_hz, self._take, self, self._started) as armed:
                self._publish(Armed())
                self._progress()
                try:
                    self._execute(armed)
                finally:
                    self._tell(GoingToRest())
        except Cancelled:
            status, reason = Status.STOPPED, f"stopped by the operator after {self._done} of {len(self._plan)} points"
        except UnsafeError as error:
            status, reason = Status.UNSAFE, str(error)
            if isinstance(error.__cause__, (BenchError, StoreError)):
                reason += f" The run had failed before: {error.__cause__}"
        except (BenchError, StoreError) as error:
            status, reason = Status.FAILED, str(error)
        except KeyboardInterrupt:
            status, reason = Status.STOPPED, f"interrupted after {self._done} points"
        except Exception as error:
            log.exception("the run failed by an error of this program")
            status, reason = Status.FAILED, f"an error of this program: {type(error).__name__}: {error}"
        return self._finish(status, reason)

    # -- the operator's switch: a HighVoltageSwitch whose hands are prompts --------------------------------------------

    def disable(self) -> None:
        self._ask(DISABLE_HIGH_VOLTAGE)

    def enable(self) -> None:
        self._ask(ENABLE_HIGH_VOLTAGE)

    # -- steps ---------------------------------------------------------------------------------------------------------

    def _execute(self, armed: ArmedBench) -> None:
        rest_v = self._bench.amplifier.map.rest_v
        with contextlib.closing(self._protocol.steps(rest_v, self._bench.simulated)) as steps:
            answer: Any = None
            settled = Settled(True, 0.0)
            drive: Drive | None = None
            while True:
                self._check_cancel()
                try:
                    with self._bench.watchdog.allow(THINKING_S):  # a long record takes its time to become a point
                        step: Step = steps.send(answer)
                except StopIteration:
                    return
                match step:
                    case Settle():
                        drive = step.drive
                        answer = settled = self._settle(armed, step)
                    case Play():
                        drive = step.drive
                        answer = settled = self._play(armed, step)
                    case Record(duration_s):
                        if drive is None:
                            raise BenchError(f"protocol {self._protocol.name} records before anything was played")
                        answer = self._record(armed, drive, duration_s, settled)
                    case Measured(point):
                        self._measured(point)
                        answer = None
                    case Ask(prompt):
                        answer = self._ask(prompt)
                    case Read(meter):
                        answer = self._read_meter(meter)
                    case Note(text):
                        self._publish(Noted(text))
                        answer = None

    def _settle(self, armed: ArmedBench, step: Settle) -> Settled:
        if not isinstance(step.drive, Sine):
            raise BenchError(f"settling is detected under a sine, not under {type(step.drive).__name__}")
        armed.play(step.drive)
        self._publish(Playing(step.drive))
        rate = armed.rate_hz
        begin_s = self._bench.clock.now()
        first = math.ceil((begin_s - armed.stream.started_s + FRESH_S) * rate)
        last = first + math.ceil(step.limit_s * rate)
        detector = SettlingDetector(
            rate, step.drive.frequency_hz, round(step.window_s * rate), step.drive.amplitude_v, step.tolerance
        )
        while True:
            block = self._read(armed)
            fresh = slice(max(first - block.start, 0), None)
            drive_v, displacement_m, _ = self._units(armed, block.raw[:, fresh])
            done = detector.feed(drive_v, displacement_m)
            if done or block.stop >= last:
                break
        if detector.drive_seen_v < 0.5 * step.drive.amplitude_v:
            raise BenchError(
                f"the card sees a sine of {detector.drive_seen_v:.3f} V where {step.drive.amplitude_v:g} V at "
                f"{step.drive.frequency_hz:g} Hz is driven; check the cable from the generator to the card"
            )
        answer = Settled(done, (block.stop - first) / rate)
        self._publish(SettleEnded(answer.settled, answer.after_s))
        return answer

    def _play(self, armed: ArmedBench, step: Play) -> Settled:
        armed.play(step.drive)
        self._publish(Playing(step.drive))
        wait_s = max(step.wait_s, FRESH_S)
        last = math.ceil((self._bench.clock.now() - armed.stream.started_s + wait_s) * armed.rate_hz)
        block = self._read(armed)
        while block.stop < last:
            block = self._read(armed)
        seen_v = float(drive_volts(block, armed.scales).mean())
        low_v, high_v = step.drive.low_v, step.drive.high_v
        if not low_v - DRIVE_LOST_V <= seen_v <= high_v + DRIVE_LOST_V:
            raise BenchError(
                f"the card sees {seen_v:.3f} V where {low_v:g} to {high_v:g} V are driven (limit +-{DRIVE_LOST_V:g} V); check the "
                "cable from the generator to the amplifier and to the card"
            )
        self._publish(SettleEnded(True, wait_s))
        return Settled(True, wait_s)

    def _record(self, armed: ArmedBench, drive: Drive, duration_s: float, settled: Settled) -> Recording:
        wanted = round(duration_s * armed.rate_hz)
        start_row, start_scan = self._store.rows, self._next_scan
        blocks: list[Block] = []
        have = 0
        while have < wanted:
            block = self._read(armed)
            blocks.append(block)
            have += block.raw.shape[1]
        with self._bench.watchdog.allow(THINKING_S):
            raw = np.concatenate([block.raw for block in blocks], axis=1)[:, :wanted]
            drive_v, displacement_m, quality = self._units(armed, raw)
        if not settled.settled:
            quality |= Quality.UNSETTLED
        if blocks[-1].stop - start_scan != have:
            quality |= Quality.DROPPED
        recording = Recording(
            index=self._recordings,
            rows=(start_row, start_row + wanted),
            rate_hz=armed.rate_hz,
            drive=drive,
            drive_v=drive_v,
            displacement_m=displacement_m,
            quality=quality,
            sensor_delay_s=self._bench.sensor.delay_s,
        )
        self._recordings += 1
        self._store.recording(recording.rows, int(quality), drive)
        self._publish(Recorded(recording.index, recording.rows, int(quality), drive))
        return recording

    def _measured(self, point: Any) -> None:
        self._store.point(point)
        self._points.append(point)
        self._publish(PointMeasured(len(self._points) - 1, point))
        self._done += 1
        self._progress()

    def _ask(self, prompt: Prompt) -> str:
        self._asked += 1
        ask_id = self._asked
        self._publish(Asked(ask_id, prompt))
        self._operator.show(ask_id, prompt)
        while (words := self._operator.answer(ask_id)) is None:
            self._check_cancel()
            # The card must be emptied while a person takes their time; what it sees then is no measurement.
            if self._armed is not None:
                self._next_scan = self._armed.skip().stop
            else:
                self._bench.clock.sleep(0.05)
        self._publish(Answered(ask_id, words))
        return words

    def _read_meter(self, name: str) -> Reading:
        meter = self._bench.meters.get(name)
        if meter is None:
            have = ", ".join(self._bench.meters) or "none"
            raise BenchError(f"this bench has no meter '{name}' (it has: {have}); add it to the bench file")
        return meter.read()

    # -- blocks --------------------------------------------------------------------------------------------------------

    def _started(self, armed: ArmedBench) -> None:
        self._armed = armed
        self._store.begin(armed.rate_hz, armed.scales)
        self._publish(StreamStarted(armed.rate_hz, armed.scales))

    def _read(self, armed: ArmedBench) -> Block:
        block = armed.read()
        self._check_cancel()
        return block

    def _take(self, block: Block) -> None:
        """The bench's sink: into the file, then to the observers."""
        row = self._store.block(block, self._now())
        self._next_scan = block.stop
        self._tell(BlockTaken(block, row))

    def _units(self, armed: ArmedBench, raw: Any) -> tuple[Any, Any, Quality]:
        """Drive in volts, displacement in metres, and what is wrong with these samples."""
        sensor = self._bench.sensor
        volts = [scale.volts(raw[i]) for i, scale in enumerate(armed.scales)]
        quality = Quality.CALIBRATION_EXPIRED if self._expired else Quality.GOOD
        if any(armed.scales[i].clipped(raw[i]).any() for i in (DRIVE, DISPLACEMENT)):
            quality |= Quality.CLIPPED
        if not sensor.valid(volts[DISPLACEMENT]).all():
            quality |= Quality.OUT_OF_RANGE
        return volts[DRIVE], sensor.displacement_m(volts[DISPLACEMENT]), quality

    # -- events --------------------------------------------------------------------------------------------------------

    def _now(self) -> float:
        return self._bench.clock.now() - self._begin_s

    def _progress(self) -> None:
        left_s = sum(entry.expected_s for entry in self._plan[self._done :])
        label = self._plan[self._done].label if self._done < len(self._plan) else "done"
        self._publish(Progressed(self._done, len(self._plan), left_s, label))

    def _publish(self, event: Event) -> None:
        """Store an event, then tell it. After the store failed once, only tell."""
        if self._store_error is None:
            try:
                self._store.event(event, self._now())
            except StoreError as error:
                self._store_error = error
                raise
        self._tell(event)

    def _tell(self, event: Event) -> None:
        for observer in self._observers:
            try:
                observer(event)
            except Exception:
                log.exception("an observer failed on %s", type(event).__name__)

    def _check_cancel(self) -> None:
        if self._cancel.is_set():
            raise Cancelled

    def _finish(self, status: Status, reason: str) -> tuple[Status, str]:
        """Say how it ended: in the file while it can be written, to the observers in any case."""
        rest = self._armed.rest if self._armed is not None else None
        if rest is not None:
            event = AtRest(rest.confirmed, rest.measured_v, rest.words)
            try:
                self._publish(event)
            except StoreError:
                self._tell(event)  # whether it is safe must be heard, full disk or not
        estimates: tuple[Estimate, ...] = ()
        try:
            estimates = self._protocol.estimates(self._points)
        except Exception as error:
            log.exception("the analysis failed")
            reason += f"; the analysis failed: {type(error).__name__}: {error}"
        try:
            self._store.finish(status, reason, estimates)
        except StoreError as error:
            if status in (Status.COMPLETED, Status.STOPPED):
                status, reason = Status.FAILED, str(error)
            with contextlib.suppress(StoreError):
                self._store.abandon()
        self._tell(RunEnded(status, reason, str(self._store.path), estimates))
        return status, reason
