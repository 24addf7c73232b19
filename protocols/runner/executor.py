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

from drivers.bench.bench import DISPLACEMENT, DRIVE, Bench, channel_skew_s, drive_volts
from drivers.bench.bench import Armed as ArmedBench
from drivers.drive import Drive, Hold, Sine
from drivers.errors import BenchError
from drivers.interfaces import Block, Reading, Scale
from protocols.base.events import Answered, Asked, BlockSeen, Noted, Playing, Recorded, SettleEnded
from protocols.base.operator import Operator
from protocols.base.protocol import Protocol
from protocols.base.quality import Quality
from protocols.base.records import LONG_SCANS, MOST_SCANS, Array, LongRecording, Planned, Recording, converted, too_long
from protocols.base.steps import Answer, Ask, Await, Awaited, Note, Play, Prompt, Read, Record, Redo, Settle, Settled
from protocols.runfile.writer import RunFile
from protocols.runner.publisher import Publisher
from protocols.signals import SettlingDetector

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


FRESH_S = 0.05
"""After a drive begins, scans older than this may still be on their way to us."""

DRIVE_LOST_V = 0.25
"""A drive that the card sees further off than this does not reach the amplifier; nothing is measured under it."""

THINKING_S = 20.0
"""How long the run thread may work on numbers, while what plays plays on, before the watchdog takes it for hung."""

THINKING_STEP_S = 0.01
"""How long it waits for numbers before it looks after the card."""

_ASK_IDS = itertools.count(1)
"""Unique in the program, so that a late answer to an earlier run's prompt is never taken for one of this run."""


class Executor:
    """The steps of one run, entry by entry.

    Args:
        events: stores what happens, and tells it.
        interrupted: called after every block and in every wait; raises where the run shall not go on.
        expired: why the sensor's calibration is out of date; empty where it is not.
    """

    def __init__(
        self,
        bench: Bench,
        store: RunFile,
        operator: Operator,
        events: Publisher,
        interrupted: Callable[[], None],
        expired: str,
    ) -> None:
        self._bench, self._store, self._operator = bench, store, operator
        self._events, self._interrupted, self._expired = events, interrupted, expired
        self._armed: ArmedBench | None = None
        self._recordings = 0
        self._taken = 0
        """Scans that the card has given us."""
        self._rest_v = bench.amplifier.map.rest_v

    def started(self, armed: ArmedBench) -> None:
        """The card runs."""
        self._armed = armed

    def carry_out(
        self, protocol: Protocol, index: int, entry: Planned, armed: ArmedBench
    ) -> tuple[list[Recording], Redo | None]:
        """All steps of an entry: what was recorded, and what shall be measured again."""
        recordings: list[Recording] = []
        settled, drive = Settled(True, 0.0), None
        answer: Answer = None
        with closing(protocol.measure(entry, self._rest_v)) as steps:
            while True:
                self._interrupted()
                try:
                    with self._bench.watchdog.allow(THINKING_S):  # a long record takes its time to become a number
                        step = steps.send(answer)
                except StopIteration as end:
                    return recordings, end.value
                match step:
                    case Settle():
                        drive = step.drive
                        answer = settled = self._settle(armed, step)
                    case Play():
                        drive = step.drive
                        answer = settled = self._play(armed, step)
                    case Record():
                        if step.drive is not None:
                            drive, settled = step.drive, Settled(True, 0.0)
                        answer = self._record(armed, drive, step, settled, index)
                        recordings.append(answer)
                    case Ask(prompt):
                        answer = self.ask(prompt)
                    case Await():
                        answer = self._await(armed, step)
                    case Read(meter):
                        answer = self._read_meter(meter)
                    case Note(text):
                        self._events.publish(Noted(text))
                        answer = None

    def ask(self, prompt: Prompt) -> str:
        """Show a prompt and wait for the answer, however long it takes."""
        ask_id = self._show(prompt)
        while (words := self._operator.answer(ask_id)) is None:
            self._interrupted()
            # The card must be emptied while a person takes their time; what it sees then is no measurement.
            if self._armed is not None:
                self.skip(self._armed)
            else:
                self._bench.clock.sleep(0.05)
        self._events.publish(Answered(ask_id, words))
        if self._armed is not None:
            self._catch_up(self._armed)
        return words

    def _catch_up(self, armed: ArmedBench) -> None:
        """Pass over what the card saw before this moment: it may still be on its way to us, and shows what was before."""
        now = self._scan_now(armed, 0.0)
        while self.skip(armed).stop < now:
            self._interrupted()

    def skip(self, armed: ArmedBench) -> Block:
        """Take a block that is not kept, and let whoever watches see it."""
        block = armed.skip()
        self._taken = block.stop
        self._events.tell(BlockSeen(block))
        return block

    def think(self, armed: ArmedBench, work: Callable[[], Answer]) -> Answer:
        """What `work` gives or raises. It may take its time: the card is emptied meanwhile, as far as it has blocks."""
        with self._bench.watchdog.allow(THINKING_S), ThreadPoolExecutor(1, "numbers") as numbers:
            done = numbers.submit(work)
            while not wait([done], THINKING_STEP_S).done:
                # On a virtual clock no time passes, so nothing is due.
                while self._scan_now(armed, -self._bench.block_s) >= self._taken:
                    self.skip(armed)
            return done.result()

    def _show(self, prompt: Prompt) -> int:
        ask_id = next(_ASK_IDS)
        self._events.publish(Asked(ask_id, prompt))
        self._operator.show(ask_id, prompt)
        return ask_id

    def _await(self, armed: ArmedBench, step: Await) -> Awaited:
        ask_id = self._show(step.prompt)
        while (words := self._operator.answer(ask_id)) is None:
            self._interrupted()
            block = self.skip(armed)
            drive_v, displacement_m, _ = self._units(armed, block.raw)
            if step.detector.feed(drive_v, displacement_m):
                self._events.publish(Answered(ask_id, "seen by the laser"))
                return Awaited(True, None)
        self._events.publish(Answered(ask_id, words))
        self._catch_up(armed)
        return Awaited(False, words)

    def _settle(self, armed: ArmedBench, step: Settle) -> Settled:
        if not isinstance(step.drive, Sine):
            raise BenchError(f"settling is detected under a sine, not under {step.drive.kind}")
        self._begin(armed, step.drive)
        rate = armed.rate_hz
        first = self._scan_now(armed, FRESH_S)
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
        self._events.publish(SettleEnded(answer.settled, answer.after_s))
        return answer

    def _play(self, armed: ArmedBench, step: Play) -> Settled:
        self._begin(armed, step.drive)
        wait_s = max(step.wait_s, FRESH_S)
        last = self._scan_now(armed, wait_s)
        block = self._read(armed)
        while block.stop < last:
            block = self._read(armed)
        self._check_drive(armed, step.drive, block)
        self._events.publish(SettleEnded(True, wait_s))
        return Settled(True, wait_s)

    def _record(self, armed: ArmedBench, drive: Drive | None, step: Record, settled: Settled, entry: int) -> Recording:
        start_row = self._store.rows
        wanted = math.ceil(step.duration_s * armed.rate_hz)
        if wanted > MOST_SCANS:
            raise BenchError(too_long(wanted))
        gathering = Gathering(partial(self._units, armed), self._read(armed))
        if step.drive is not None:
            while gathering.scans < step.lead_s * armed.rate_hz:
                gathering.add(self._read(armed))
            self._begin(armed, step.drive)
            # The card ran on while the source was told; what it saw meanwhile is the rest before the drive.
            wanted += max(self._scan_now(armed, FRESH_S) - gathering.start, 0)
        while gathering.scans < wanted:
            gathering.add(self._read(armed))
        samples, quality = gathering.end(wanted)
        if not settled.settled:
            quality |= Quality.UNSETTLED
        rows = (start_row, start_row + wanted)
        known: dict[str, Any] = {
            "index": self._recordings,
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
            recording = LongRecording(partial(self._stored, armed.scales, rows), **known)
        self._recordings += 1
        self._store.recording(recording.rows, int(quality), recording.drive, entry)
        self._events.publish(Recorded(recording.index, recording.rows, int(quality), recording.drive, entry))
        return recording

    def _begin(self, armed: ArmedBench, drive: Drive) -> None:
        armed.play(drive)
        self._events.publish(Playing(drive))

    def _scan_now(self, armed: ArmedBench, later_s: float) -> int:
        """The scan that is taken `later_s` from now."""
        return math.ceil((self._bench.clock.now() - armed.stream.started_s + later_s) * armed.rate_hz)

    def _check_drive(self, armed: ArmedBench, drive: Drive, block: Block) -> None:
        seen_v = float(drive_volts(block, armed.scales).mean())
        if not drive.low_v - DRIVE_LOST_V <= seen_v <= drive.high_v + DRIVE_LOST_V:
            raise BenchError(
                f"the card sees {seen_v:.3f} V where {drive.low_v:g} to {drive.high_v:g} V are driven (limit "
                f"±{DRIVE_LOST_V:g} V); check the cable from the generator to the amplifier and to the card"
            )

    def _read_meter(self, name: str) -> Reading:
        meter = self._bench.meters.get(name)
        if meter is None:
            have = ", ".join(self._bench.meters) or "none"
            raise BenchError(f"this bench has no meter '{name}' (it has: {have}); add it to the bench file")
        return meter.read()

    def _read(self, armed: ArmedBench) -> Block:
        block = armed.read()
        self._taken = block.stop
        self._interrupted()
        return block

    def _stored(self, scales: Sequence[Scale], rows: tuple[int, int], drive: bool) -> Any:
        """One channel of these rows of the run's file, in volts or metres."""
        if drive:
            return converted(scales[DRIVE].volts, self._store.raw("drive", rows))
        volts, sensor = scales[DISPLACEMENT].volts, self._bench.sensor
        return converted(lambda raw: sensor.displacement_m(volts(raw)), self._store.raw("displacement", rows))

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
