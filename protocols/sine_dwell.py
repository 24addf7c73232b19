"""Sine dwell: one frequency at a time, settled, whole cycles (paper, Sec. IV-3).

Each point carries the paper's amplitude, max - min, beside the fundamental of a least-squares sine fit: the
amplifier's two slopes make harmonics, and near half the resonance the two differ by a fifth.
"""

import math
from collections.abc import Generator, Iterable, Sequence
from typing import Annotated, Any, ClassVar, Self

from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from drivers.drive import Sine
from protocols.protocol import Protocol
from protocols.quality import Quality
from protocols.sine_point import SinePoint, sine_point
from protocols.steps import Note, Record, Settle, Step
from protocols.values import Estimate, Planned, Recording

SAMPLES_A_CYCLE = 20
"""Least samples in a cycle: what the paper has at 250 Hz and 5 kS/s."""

MOST_RECORDINGS = 20
"""Recordings averaged at one frequency where no time budget says otherwise."""

SAME_HZ = 0.05
"""Frequencies nearer than this are one."""

PAPER_FREQUENCIES_HZ = (25, 50, 75, 100, 125, 150, 155, 160, 165, 170, 175, 180, 185, 190, 195, 200, 225, 250)


class SineDwell(Protocol):
    """Frequencies one at a time, settled, whole cycles; the paper's 18 by default."""

    name: ClassVar[str] = "sine-dwell"
    title: ClassVar[str] = "Sine dwell"
    point_type: ClassVar[type] = SinePoint
    axes: ClassVar[tuple[str, str]] = ("frequency", "peak_to_peak")

    frequencies_hz: Annotated[
        tuple[Annotated[float, Interval(ge=1, le=2000)], ...], Unit("Hz"), Len(1, 500), "frequencies, in order"
    ] = PAPER_FREQUENCIES_HZ
    peak_to_peak_v: Annotated[
        float, Unit("V"), Interval(gt=0, le=5), "drive at the amplifier's input, peak to peak around rest"
    ] = 5.0
    record_s: Annotated[float, Unit("s"), Interval(ge=0.05, le=600), "at least this long is recorded"] = 0.5
    min_cycles: Annotated[
        int, Unit("1"), Interval(ge=3, le=100_000), "at least this many whole cycles are recorded"
    ] = 20
    settle_tolerance: Annotated[
        float, Unit("1"), Interval(gt=0, le=0.1), "relative change between windows that counts as settled"
    ] = 0.005
    settle_limit_s: Annotated[
        float, Unit("s"), Interval(ge=0.5, le=600), "after this long it is recorded unsettled, and flagged"
    ] = 5.0
    decay_s: Annotated[
        float,
        Unit("s"),
        Interval(ge=0, le=10),
        "decay time of the resonance, of a sweep: windows are no shorter; 0 unknown",
    ] = 0.0
    wanted: Annotated[
        float,
        Unit("1"),
        Interval(ge=0, le=0.5),
        "relative uncertainty of the fundamental to average for; 0 once is enough",
    ] = 0.0
    refine_to_hz: Annotated[
        float, Unit("Hz"), Interval(ge=0, le=100), "points are added around the peak until they lie this close; 0 none"
    ] = 0.0
    budget_s: Annotated[
        float, Unit("s"), Interval(ge=0, le=36_000), "bench time that averaging and added points may fill; 0 unlimited"
    ] = 0.0
    sample_rate_hz: Annotated[
        float, Unit("Hz"), Interval(ge=500, le=500_000), "scans per second; a USB-6341 makes 250 kHz of two channels"
    ] = 5000.0

    @model_validator(mode="after")
    def _can_be_done(self) -> Self:
        highest = max(self.frequencies_hz)
        # Fewer samples a cycle would miss the extremes, and fold the amplifier's harmonics onto the fundamental.
        if self.sample_rate_hz < SAMPLES_A_CYCLE * highest:
            raise ValueError(
                f"sample_rate_hz of {self.sample_rate_hz:g} Hz is too low for a sine of {highest:g} Hz; "
                f"at least {SAMPLES_A_CYCLE * highest:g} Hz is needed"
            )
        for f in self.frequencies_hz:
            if self.settle_limit_s < 3 * self._window_s(f) - 1e-9:
                raise ValueError(
                    f"settle_limit_s of {self.settle_limit_s:g} s holds no three windows of {self._window_s(f):.3g} s at "
                    f"{f:g} Hz, and two changes are needed to see that nothing changes; at least "
                    f"{3 * self._window_s(f):.3g} s is needed"
                )
        least_s = sum(map(self._expected_s, self.frequencies_hz))
        if 0 < self.budget_s < least_s:
            raise ValueError(
                f"budget_s of {self.budget_s:g} s is too short: {len(self.frequencies_hz)} frequencies take about "
                f"{least_s:.0f} s; measure fewer, or leave the budget at 0"
            )
        return self

    def plan(self, rest_v: float) -> tuple[Planned, ...]:
        return tuple(self._entry(f, rest_v) for f in self.frequencies_hz)

    def more(self, points: Sequence[Any], rest_v: float) -> tuple[Planned, ...]:
        """Halve the gaps to either side of the highest point while they are wider than `refine_to_hz`."""
        if not self.refine_to_hz:
            return ()
        added, left_s = [], self.budget_s - sum(self._expected_s(p.frequency) for p in points)
        for f in halved(points, self.refine_to_hz):
            left_s -= self._expected_s(f)
            if left_s >= 0 or not self.budget_s:
                added.append(self._entry(f, rest_v))
        return tuple(added)

    def measure(self, entry: Planned, rest_v: float) -> Generator[Step, Any, None]:
        f = float(entry.key[-1])
        yield Settle(entry.drives[0], self._window_s(f), self.settle_tolerance, self.settle_limit_s)
        have = [(yield Record(self._record_s(f)))]
        point = sine_point(have, simulated=False)
        most = self._most_recordings(f)
        while self.wanted and point.relative_uncertainty > self.wanted and len(have) < most:
            needed = math.ceil(len(have) * (point.relative_uncertainty / self.wanted) ** 2)
            missing = max(min(needed, most) - len(have), 1)
            limit = "" if needed <= most else f" of {needed - len(have)}, as many as the time allows,"
            yield Note(
                f"{entry.label}: {percent(point.relative_uncertainty)} after {len(have)}; {missing} more{limit} "
                f"to reach {percent(self.wanted)}"
            )
            for _ in range(missing):
                again = yield Record(self._record_s(f))
                have.append(again)
            point = sine_point(have, simulated=False)
        if Quality.NO_RESPONSE in Quality(point.quality):
            yield Note(
                f"{entry.label}: no response. The displacement's fundamental is {1e6 * point.fundamental:.2g} µm, within 5 "
                f"standard uncertainties of nothing ({1e6 * point.fundamental_errors:.2g} µm each), while the drive reads back "
                f"{point.drive_amplitude:.3g} V. Check that the amplifier's high voltage is on and the laser meets the tactor"
            )

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> Any:
        return sine_point(recordings, simulated)

    def estimates(self, points: Iterable[Any]) -> tuple[Estimate, ...]:
        from protocols.resonance import fit_resonance

        return fit_resonance([p for p in points if Quality(p.quality).usable])

    def _entry(self, f: float, rest_v: float) -> Planned:
        return Planned(f"{f:g} Hz", (self._drive(f, rest_v),), self._expected_s(f), (f,))

    def _expected_s(self, f: float) -> float:
        return 0.4 + 4 * self._window_s(f) + self._record_s(f)

    def _most_recordings(self, f: float) -> int:
        if not self.wanted:
            return 1
        if not self.budget_s:
            return MOST_RECORDINGS
        spare_s = self.budget_s - sum(map(self._expected_s, self.frequencies_hz))
        return 1 + math.floor(spare_s / len(self.frequencies_hz) / self._record_s(f))

    def _drive(self, frequency_hz: float, rest_v: float) -> Sine:
        # Long enough for the worst case, finite so that a generator left alone comes to rest.
        longest_s = self.settle_limit_s + self._most_recordings(frequency_hz) * self._record_s(frequency_hz) + 3.0
        cycles = math.ceil(longest_s * frequency_hz)
        return Sine(float(frequency_hz), self.peak_to_peak_v / 2, rest_v, cycles)

    def _window_s(self, frequency_hz: float) -> float:
        # A window much shorter than the decay sees a ringing response hardly change, and takes it for steady.
        return max(2, math.ceil(max(0.04, self.decay_s) * frequency_hz)) / frequency_hz

    def _record_s(self, frequency_hz: float) -> float:
        return max(self.min_cycles, math.ceil(self.record_s * frequency_hz)) / frequency_hz


def halved(points: Sequence[Any], closest_hz: float) -> list[float]:
    """Frequencies in the middle between the highest usable point and its neighbours, where those are not close enough."""
    usable = sorted((p for p in points if Quality(p.quality).usable), key=lambda p: p.frequency)
    if len(usable) < 3:
        return []
    top = max(range(len(usable)), key=lambda i: usable[i].fundamental / usable[i].drive_amplitude)
    found = []
    for i in (top - 1, top + 1):
        if 0 <= i < len(usable) and abs(usable[i].frequency - usable[top].frequency) > closest_hz + SAME_HZ:
            middle = round(0.5 * (usable[i].frequency + usable[top].frequency), 1)
            if all(
                abs(p.frequency - middle) > SAME_HZ for p in points
            ):  # one without a response is not asked for again
                found.append(middle)
    return found


def percent(share: float) -> str:
    """`2 %`, `0.031 %`."""
    return f"{100 * share:.2g} %" if math.isfinite(share) else "no response"
