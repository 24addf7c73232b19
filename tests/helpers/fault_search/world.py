"""Invariants of a run, from the simulated world: the volts of its history, the faults, and what the program has told."""

import logging
import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from drivers.bench.rest import REST_NOISE_V, REST_TOLERANCE_V
from drivers.drive_shapes import Drive, Hold
from protocols.base import (
    BenchArmed,
    DriveStarted,
    EntryStarted,
    Event,
    Outcome,
    PointMeasured,
    Quality,
    RecordingFinished,
    RestMeasured,
    RunEnded,
    RunStatus,
    SpecimenMayBeLive,
    StreamStarted,
)
from protocols.measurements.endurance import CYCLES
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.history_report import VoltageReport, make_voltage_report
from sim_hardware.plant.voltage_history import HistoryEntry
from sim_hardware.testing.safe_volts import STEP_V

REST_V = 2.5
WARNED_S = 1.0
"""Longest time from a failure that the program has seen to the warning that the specimen may be live."""

SEEN_S = 0.6
"""A warning names volts that stood at the input within this time before it: PRESENT_S, and a block."""

REPORT_RATE_HZ = 20_000.0
"""Grid of the judgement: jumps within one step of it are one jump."""

SLOPE_V_PER_S = 10_000 + 2 * 5.0 / 2**14 * REPORT_RATE_HZ
"""Steepest slope over a step of the grid: the drive limits', and one code of a 14-bit converter at either end."""

TOUCHED_V, TOUCHED_SHARE, TOUCHED_DRIVE_SHARE = 0.02, 0.3, 0.1
"""A recording is touched if the input differs by so much from what the program commanded, or a fault is active, for this share of
the recording; if the program began its drive after another hand had acted, for this share of the drive."""

SAMPLE_S = 1e-5
"""Longest time for which a source holds a point of a drive's waveform."""

TOUCHES = ("sensor-stuck", "sensor-out-of-range")
"""Faults that make a recording worthless. An amplifier at its current limit is none of them: on these benches, without a voltage
monitor, it is a specimen with another gain."""

COMMAND_S = 0.1
"""Longest time from the begin of a drive at the source to its report."""

RESTS_S = 0.05
"""Time for which the input must stay at rest."""


class ErrorLog(logging.Handler):
    """Errors that the program logs."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        cause = record.exc_info[1] if record.exc_info else None
        self.lines.append(record.getMessage() + (f": {type(cause).__name__}: {cause}" if cause else ""))


@dataclass
class World:
    """A simulated bench, and where its volts are not the program's.

    Attributes:
        disturbed: number of changes before the first that another hand or the loss of the drive made; None without any.
        touches: time of every change by another hand, with the number of changes before and after it.
    """

    bench: SimulatedBench
    disturbed: int | None = None
    touches: list[tuple[float, int, int]] = field(default_factory=list)
    lost: int = 0
    """Messages that the source may not have received: the next step of a ramp is by as many larger."""
    _part: tuple[int, float] = (0, -math.inf)
    """Changes before the present part of the history, and its begin."""

    @property
    def now_s(self) -> float:
        return float(self.bench.clock.now())

    @property
    def live(self) -> bool:
        """Whether high voltage is on and the input is not at rest."""
        self.bench.history.settle(self.now_s)
        entry = self.bench.history.entries()[-1]
        return entry.hv and not _is_at_rest(entry, self.now_s)

    def volts(self, first_s: float, last_s: float, count: int = 2000) -> Any:
        """Volts at the input, without a read of the history."""
        times = np.linspace(first_s, last_s, count) if last_s > first_s else np.array([last_s])
        entries = self.bench.history.entries()
        starts = np.array([entry.start_s for entry in entries])
        which = np.searchsorted(starts, times, side="right") - 1
        values = np.empty(times.shape)
        for k in np.unique(which):
            values[which == k] = entries[k].segment.volts(times[which == k])
        return values

    def disturb(self, act: Any) -> None:
        """Let another hand act."""
        before, at_s = self.bench.history.change_count, self.now_s
        act()
        after = self.bench.history.change_count
        if self.disturbed is None:
            self.disturbed = before
        self.touches.append((at_s, before, after))

    def begin_part(self) -> None:
        """Judge the volts from now on, anew."""
        self.disturbed, self._part = None, (self.bench.history.change_count - 1, self.now_s)

    def report(self) -> VoltageReport:
        """Return the report of the present part, until another hand or the loss of the drive made a change."""
        now_s = self.now_s
        self.bench.history.settle(now_s)
        entries = self.bench.history.entries()
        if self.disturbed is not None and self.disturbed < len(entries):
            now_s = math.nextafter(entries[self.disturbed].start_s, -math.inf)
            entries = entries[: self.disturbed]
        first, begin_s = self._part
        entries = [replace(entries[first], start_s=max(entries[first].start_s, begin_s)), *entries[first + 1 :]]
        return make_voltage_report(entries, max(now_s, begin_s), REPORT_RATE_HZ, REST_V, 0.02)

    def wrong_volts(self) -> list[str]:
        """What the volts owe and did not keep until then."""
        report, wrong = self.report(), []
        if report.lowest_v < -1e-9 or report.highest_v > 5 + 1e-9:
            wrong.append(f"the input left its range: {report.lowest_v:.3f} to {report.highest_v:.3f} V")
        if report.largest_jump_v > STEP_V * (1 + self.lost) + 1e-6:
            wrong.append(f"a jump of {report.largest_jump_v:.3f} V")
        if report.steepest_v_per_s > SLOPE_V_PER_S:
            wrong.append(f"a slope of {report.steepest_v_per_s:.0f} V/s")
        if not report.switched_at_rest and not self._switched_at_rest():
            wrong.append("high voltage was switched while the input was not at rest")
        return wrong

    def _switched_at_rest(self) -> bool:
        """Whether the input was at rest at every switching of high voltage in the present part, until another hand acted."""
        entries = self.bench.history.entries()[self._part[0] : self.disturbed]
        switched = [entry for before, entry in pairwise(entries) if before.hv != entry.hv]
        return all(_is_at_rest(entry, entry.start_s) for entry in switched)

    def is_touched(self, begin_s: float, end_s: float, drive: Drive, started_s: float) -> bool:
        """Whether another hand or a fault changed what was recorded between two times under a drive started at `started_s`."""
        needed_s = TOUCHED_SHARE * (end_s - begin_s)
        times = np.linspace(begin_s, end_s, 500)
        if any(np.mean(self.bench.faults.was_active(fault, times)) >= TOUCHED_SHARE for fault in TOUCHES):
            return True
        entries = self.bench.history.entries()
        for at_s, before, after in self.touches:
            later = times[times > at_s + 0.01]
            if before == after or not begin_s - needed_s < at_s < end_s - needed_s:
                continue
            if at_s < started_s:  # the program has set the source since then
                held = (
                    times[times >= started_s] if isinstance(drive, Hold) else times
                )  # its ramp is not part of a level
                if held.size and self._differs(held, drive, at_s, started_s):
                    return True
                continue
            old, new = (entries[k - 1].segment.volts(later) for k in (before, after))
            if entries[after - 1].hv and np.mean(np.abs(new - old) > TOUCHED_V) > TOUCHED_SHARE:
                return True
        return False

    def _differs(self, times: Any, drive: Drive, first_s: float, last_s: float) -> bool:
        """Whether the volts differ from a drive, whichever change of the source between two times began it."""
        seen = self.volts(times[0], times[-1], times.size)
        begins = [e.start_s for e in self.bench.history.entries() if first_s - COMMAND_S < e.start_s <= last_s]
        most = min(TOUCHED_SHARE, TOUCHED_DRIVE_SHARE * drive.duration_s / (times[-1] - times[0]))
        return all(np.mean(_distance(seen, drive, times - begin_s) > TOUCHED_V) > most for begin_s in begins)


def _distance(volts: Any, drive: Drive, times_s: Any) -> Any:
    """Distance of volts from the nearest that a drive has within a sample of the source."""
    early, late = drive.volts(times_s - SAMPLE_S), drive.volts(times_s + SAMPLE_S)
    return np.maximum(volts - np.maximum(early, late), np.minimum(early, late) - volts)


def _is_at_rest(entry: HistoryEntry, at_s: float) -> bool:
    """Whether the input stays at rest from a time on; the amplitude at which a burst idles, 10 mV peak to peak, is no drive."""
    volts = entry.segment.volts(at_s + np.linspace(0, RESTS_S, 500))
    return bool(abs(volts.mean() - REST_V) <= REST_TOLERANCE_V and volts.std() <= REST_NOISE_V)


class Watch:
    """Observer of one run; collects what the program owes and did not keep."""

    def __init__(self, world: World, block_s: float) -> None:
        self.world, self._block_s = world, block_s
        self.wrong: list[str] = []
        self.acknowledged: list[dict[str, float]] = []
        self.ended: RunEnded | None = None
        self.warned_s = self.failed_s = math.inf
        """Time of the first warning; and since when the source does not answer, while the specimen was live."""
        self._armed = self._cycling = False
        self._rest_s = math.inf
        """Time at which rest was confirmed."""
        self._rate_hz = math.nan
        self._started_s = self._recorded_s = -math.inf
        self._recorded: Drive | None = None
        """The drive of the entry's last recording."""
        self._touched_s: dict[int, float] = {}
        """End of the last touched recording of each entry; -inf without any."""
        self._good: dict[int, bool] = {}
        self._hv_seen = False
        self._live_since_s, self._found_live_s = math.inf, 0.0
        """Since when, and for how long, the card has shown a live source before the end of arming."""

    def source_failed(self) -> None:
        """Note that a message to the source failed."""
        if math.isinf(self.failed_s) and self.world.live:
            self.failed_s = self.world.now_s

    def source_answered(self) -> None:
        """Note that the source answered."""
        if math.isinf(self.warned_s):
            self.failed_s = math.inf

    def __call__(self, event: Event) -> None:
        now_s = self.world.now_s
        if not math.isnan(self._rate_hz) and not self._armed and math.isinf(self.warned_s):
            self._live_since_s = min(self._live_since_s, now_s) if self.world.live else math.inf
            self._found_live_s = max(self._found_live_s, now_s - self._live_since_s)
        match event:
            case StreamStarted(rate_hz):
                self._rate_hz = rate_hz
            case BenchArmed():
                self._armed = True
            case EntryStarted(index, key=key):
                self._touched_s[index], self._recorded = -math.inf, None
                self._cycling = key[0] == CYCLES
            case DriveStarted():
                self._started_s = now_s
                self._hv_seen |= self.world.bench.history.high_voltage_on
            case RecordingFinished(rows=(first, last), entry=entry, drive=drive, quality=quality):
                seconds = (
                    last - first
                ) / self._rate_hz  # it begins with a block, and was read to the end of another one
                begin_s = now_s - self._block_s * math.ceil(seconds / self._block_s - 1e-6)
                if self._cycling:  # only its first rows are stored, but its values cover the whole block
                    begin_s, seconds = self._started_s, drive.duration_s
                # The flags of a recording are those of its point: a point without them is of another recording.
                touched = Quality(quality).usable and self.world.is_touched(
                    begin_s, begin_s + seconds, drive, self._started_s
                )
                # A drive that is played again is recorded for the specimen's sake first: the point is of the last one.
                again = drive == self._recorded and self._started_s > self._recorded_s
                earlier_s = -math.inf if again else self._touched_s.get(entry, -math.inf)
                self._touched_s[entry] = begin_s + seconds if touched else earlier_s
                self._recorded, self._recorded_s = drive, now_s
            case PointMeasured(point=point, entry=entry):
                values = {name: getattr(point, name) for name in point.__slots__ if name != "quality"}
                numbers = {name: float(v) for name, v in values.items() if isinstance(v, int | float)}
                self.acknowledged.append({**numbers, "entry": float(entry)})
                self._good[entry] = Quality(int(point.quality)).usable
                if self._touched_s.get(entry, -math.inf) < numbers.get(
                    "zero_before_time", -math.inf
                ):  # its zero was lost, and it began anew
                    self._touched_s[entry] = -math.inf
            case SpecimenMayBeLive():
                self._check_warning(event)
            case RestMeasured(confirmed=confirmed):
                self._check_rest(event)
                self._rest_s = now_s if confirmed else math.inf
            case RunEnded():
                self.ended = event

    def _check_warning(self, event: SpecimenMayBeLive) -> None:
        now_s = self.world.now_s
        self.warned_s = min(self.warned_s, now_s)
        if math.isnan(event.low_v):
            return
        seen = self.world.volts(now_s - SEEN_S, now_s)
        if event.low_v < seen.min() - 0.06 or event.high_v > seen.max() + 0.06:
            self.wrong.append(
                f"the warning names {event.low_v:.3f} to {event.high_v:.3f} V where {seen.min():.3f} to {seen.max():.3f} V stood"
            )

    def _check_rest(self, event: RestMeasured) -> None:
        if event.confirmed and self.world.live:
            self.wrong.append(f"rest was confirmed with {self.world.volts(0, self.world.now_s)[-1]:.3f} V at the input")

    def conclude(self, high_voltage: bool) -> list[str]:
        """Return what is wrong when the run has ended."""
        wrong, ended = list(self.wrong), self.ended
        if ended is None:
            return wrong if math.isnan(self._rate_hz) else [*wrong, "the run was not reported as ended"]
        if "an error of this program" in ended.reason:
            wrong.append(ended.reason)
        moved_later = any(at_s >= self._rest_s and before < after for at_s, before, after in self.world.touches)
        if self.world.live and not moved_later:
            volts = self.world.volts(0.0, self.world.now_s)[-1]
            if ended.status is not RunStatus.UNSAFE:
                wrong.append(f"the input is at {volts:.3f} V, and the run is {ended.status}")
            told_s = min(self.warned_s, self.world.now_s)
            if told_s - self.failed_s > WARNED_S:
                wrong.append(f"the warning came {told_s - self.failed_s:.1f} s after the failure that the program saw")
        if self._found_live_s > WARNED_S:
            wrong.append(f"a source that was left live was seen for {self._found_live_s:.1f} s without a warning")
        if ended.verdict.outcome is Outcome.GOOD:
            for entry, touched_s in self._touched_s.items():
                if touched_s > -math.inf and self._good.get(entry, False):
                    wrong.append(f"the verdict is good on entry {entry}, which was touched")
            if high_voltage and not self._hv_seen:
                wrong.append("the verdict is good although high voltage was never on")
        return wrong
