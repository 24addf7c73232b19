"""Voltage steps: held levels against rest, creep, repeatability and loop width (paper, Sec. IV-2).

Creep is logarithmic in time: the deflection under a held voltage has no final value, so the reading time is part of the
result. It counts from the end of the guard's ramp to the level, as recorded by the card.

A piezoelectric specimen at rest remembers the turning points of earlier drives, and a sweep that fades out leaves another state
than a sine that ends. A loop through the highest and the lowest level before the first one replaces that memory by a known one.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from drivers import Hold
from model import format_quantity, misfit_factor
from protocols.base import (
    CheckResult,
    EstimatedQuantity,
    PlanEntry,
    Play,
    Protocol,
    Quality,
    Record,
    Recording,
    Role,
    Series,
    Step,
)
from protocols.measurements.fields import QualityFlags, RepeatNumber, SampleRate, point_quality
from protocols.measurements.fit_lines import line_indices
from protocols.measurements.result_checks import (
    CABLE_REMEDY,
    group_values,
    mean_with_error,
    repeatability_check,
    signal_to_noise_check,
    usable_points,
)
from protocols.signals import DetectedRamp, estimate_step, find_ramp, fit_creep, weighted_fit

UP, DOWN, RANDOM = "up", "down", "random"
DIRECTION_CODES = {UP: 1.0, DOWN: -1.0, RANDOM: 0.0}
"""The order of levels as a column of a file: rising, falling, shuffled."""

LEVEL_TOLERANCE_V = 0.02
"""Largest deviation of a recorded level from the commanded one: accuracy of supply and card."""


def deflection_per_volt(points: Sequence[Any]) -> tuple[float, float] | None:
    """Return the deflection per volt of the recorded drive, a line through the origin, and its error, from the scatter if it is significant."""
    if len(points) < 2:
        return None
    v, w, errors = (
        np.array([getattr(p, n) for p in points]) for n in ("drive_step", "deflection", "deflection_errors")
    )
    slope = float(v @ w / (v @ v))
    left = w - slope * v
    spread, noise = float(left @ left) / (len(points) - 1) / float(v @ v), float(np.sum((v * errors / (v @ v)) ** 2))
    scatters = misfit_factor(float(np.sum((left / errors) ** 2)), len(points) - 1) > 1
    return slope, math.sqrt(max(spread, noise) if scatters else noise)


def relative_creep(points: Sequence[Any]) -> tuple[float, float] | None:
    """Creep per decade over the deflection, weighted, and its error, from the scatter over the levels if it is significant."""
    with_creep = [p for p in points if abs(p.drive_step) > LEVEL_TOLERANCE_V and p.creep_errors > 0]
    if len(with_creep) < 3:
        return None
    share = np.array([p.creep / p.deflection for p in with_creep])
    root = np.array([abs(p.deflection) / p.creep_errors for p in with_creep])
    (mean,), covariance = weighted_fit((np.ones(share.size),), share, root)
    return float(mean), math.sqrt(covariance[0, 0])


def repeatability(points: Sequence[Any]) -> tuple[float, float] | None:
    """Standard deviation of a deflection from repeat to repeat, pooled over levels and directions, and its error."""
    squares, freedom = 0.0, 0
    for group in _group_by(points, lambda p: (p.level, p.direction)).values():
        values = np.array([p.deflection for p in group])
        squares += float(np.sum((values - values.mean()) ** 2))
        freedom += len(group) - 1
    if not freedom:
        return None
    deviation = math.sqrt(squares / freedom)
    return deviation, deviation / math.sqrt(2 * freedom)


def loop_width(points: Sequence[Any]) -> tuple[float, float] | None:
    """Deflection with levels falling minus with levels rising, averaged over the levels that have both, and its error."""
    gaps, variances = [], []
    for group in _group_by(points, lambda p: p.level).values():
        up, down = ([p for p in group if p.direction == d] for d in (DIRECTION_CODES[UP], DIRECTION_CODES[DOWN]))
        if up and down:
            gaps.append(np.mean([p.deflection for p in down]) - np.mean([p.deflection for p in up]))
            errors = (mean_with_error([(p.deflection, p.deflection_errors) for p in row])[1] for row in (up, down))
            variances.append(sum(error**2 for error in errors))
    if not gaps:
        return None
    return float(np.mean(gaps)), math.sqrt(sum(variances)) / len(gaps)


def _group_by(points: Sequence[Any], key: Callable[[Any], Any]) -> dict[Any, list[Any]]:
    groups: dict[Any, list[Any]] = defaultdict(list)
    for point in points:
        groups[key(point)].append(point)
    return groups


SOURCE = "voltage steps"

CREEP_LIMIT = 0.2
"""Largest creep per decade over the deflection: MFCs creep by 2 to 10 %; more indicates clamp, glue or sensor."""

PAPER_LEVELS_V = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)

RAMP_V_PER_S = 5.0
"""Default slope of held levels in the bench file; only the expected duration depends on it."""

ZERO_GUARD_S = 0.01
"""Gap between the zero and the ramp: the ramp's begin is certain to a few milliseconds."""

CONDITIONING_S = 1.0
"""Duration of each end of the loop before the first level, after its ramp."""

RINGDOWN_S = 0.1
"""Time after the ramp before the fit of creep, in which the first mode has decayed."""


@dataclass(frozen=True, slots=True)
class StepPoint:
    """One level against the rest before it. Errors are standard and statistical; the sensor's gain is common to all."""

    level: Annotated[float, Unit("V"), "level commanded at the amplifier's input"]
    repeat: RepeatNumber
    direction: Annotated[float, Unit("1"), "levels rising (1), falling (-1) or in random order (0)"]
    drive: Annotated[float, Unit("V"), "level recorded by the card"]
    drive_step: Annotated[float, Unit("V"), "recorded level minus recorded rest"]
    deflection: Annotated[float, Unit("m"), "displacement against rest, at read_time"]
    deflection_errors: Annotated[float, Unit("m"), "standard uncertainty of the deflection, slow noise included"]
    read_time: Annotated[float, Unit("s"), "time of the reading after the end of the ramp"]
    ramp_time: Annotated[float, Unit("s"), "duration of the ramp, from the recorded drive"]
    creep: Annotated[float, Unit("m"), "growth of the deflection per decade of time"]
    creep_errors: Annotated[float, Unit("m"), "standard uncertainty of the creep"]
    zero: Annotated[float, Unit("m"), "sensor reading at rest, just before the level"]
    drift: Annotated[float, Unit("m/s"), "slope of the displacement at rest, just before the level"]
    reached: Annotated[float, Unit("s"), "time of the end of the ramp, since the first sample of the run"]
    ended: Annotated[float, Unit("s"), "time of the end of the recording, where the way back to rest begins, likewise"]
    rested: Annotated[float, Unit("s"), "time of the end of the way to rest before it, likewise"]
    conditioned: Annotated[
        float, Unit("1"), "1: highest and lowest level were held once before the first level; otherwise they were not"
    ]
    quality: QualityFlags

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        arrow = {1.0: "rising", -1.0: "falling"}.get(self.direction, "random")
        return (
            f"{self.level:.3g} V ({arrow}, {self.repeat:.0f}): "
            f"deflection {format_quantity(self.deflection, self.deflection_errors, 'm', signed=True)} after {self.read_time:g} s, creep {1e6 * self.creep:+.2f} µm per decade"
        )


class VoltageSteps(Protocol):
    """Static deflection under held voltages, each against rest just before; the paper's levels by default."""

    name: ClassVar[str] = "voltage-steps"
    title: ClassVar[str] = "Voltage steps"
    point_type: ClassVar[type] = StepPoint
    axes: ClassVar[tuple[str, str]] = ("level", "deflection")

    levels_v: Annotated[
        tuple[Annotated[float, Interval(ge=0, le=5)], ...], Unit("V"), Len(1, 200), "levels at the amplifier's input"
    ] = PAPER_LEVELS_V
    repeats: Annotated[int, Unit("1"), Interval(ge=1, le=100), "measurements of each level"] = 5
    order: Annotated[
        Literal["up-down", "up", "down", "random"],
        "order of the levels: up, down, alternately up and down (shows the loop), or random in each repeat",
    ] = "up-down"
    seed: Annotated[int, Unit("1"), Interval(ge=0, le=2**31), "seed of the random order"] = 1
    rest_s: Annotated[float, Unit("s"), Interval(ge=0.2, le=600), "time at rest before each level"] = 2.0
    read_s: Annotated[float, Unit("s"), Interval(gt=0, le=600), "time of the reading, after the end of the ramp"] = 1.0
    window_s: Annotated[
        float,
        Unit("s"),
        Interval(ge=0.04, le=10),
        "duration of the reading; 0.1 s is a whole number of cycles of 50 and 60 Hz",
    ] = 0.1
    hold_s: Annotated[
        float, Unit("s"), Interval(ge=0.5, le=3600), "duration of each level, over which its creep is fitted"
    ] = 5.0
    sample_rate_hz: SampleRate = 5000.0

    @model_validator(mode="after")
    def _check_read_window(self) -> Self:
        if not self.window_s / 2 <= self.read_s <= self.hold_s - self.window_s / 2:
            raise ValueError(
                f"read_s of {self.read_s:g} s must lie within hold_s of {self.hold_s:g} s, half of window_s "
                f"({self.window_s / 2:g} s) away from either end"
            )
        return self

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        first, *others = (
            PlanEntry(
                f"{level_v:g} V, repeat {repeat} {way}",
                (Hold(rest_v, self.rest_s + self.lead_s + 1.0), Hold(level_v, self.hold_s)),
                self.rest_s + self.lead_s + self.hold_s + 2 * abs(level_v - rest_v) / RAMP_V_PER_S + 0.1,
                (level_v, float(repeat), way),
            )
            for repeat in range(1, self.repeats + 1)
            for way, levels in (self._level_order(repeat),)
            for level_v in levels
        )
        high_v, low_v = self.conditioning_levels_v(rest_v)
        loop = tuple(Hold(level_v, CONDITIONING_S + 1.0) for level_v in (high_v, low_v))
        loop_s = 2 * CONDITIONING_S + 2 * (high_v - low_v) / RAMP_V_PER_S
        return replace(first, drives=(*loop, *first.drives), expected_s=first.expected_s + loop_s), *others

    def conditioning_levels_v(self, rest_v: float) -> tuple[float, float]:
        """Return the levels, V, that are held before the first level, in order: the highest and the lowest of all, rest included."""
        return max(*self.levels_v, rest_v), min(*self.levels_v, rest_v)

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        *loop, rest, level = entry.drives
        for drive in loop:
            yield Play(drive, CONDITIONING_S)
        yield Play(rest, self.rest_s)
        yield Record(self.hold_s, level, self.lead_s)

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> StepPoint:
        recording = recordings[-1]
        level_v, repeat, way = float(key[0]), float(key[1]), str(key[2])
        rate, moved = recording.rate_hz, recording.displacement_m
        ramp = find_ramp(recording.drive_v, rate, self.hold_s, self.window_s)
        seen = estimate_step(
            moved, rate, ramp.end_s, self.read_s, self.window_s, guard_s=ramp.duration_s + ZERO_GUARD_S,
            interference=recording.interference,
        )  # fmt: skip
        creep, creep_errors = self._creep(moved, rate, ramp, seen.before.value)
        drive_off = abs(ramp.end_level_v - level_v) > LEVEL_TOLERANCE_V
        return StepPoint(
            level=level_v,
            repeat=repeat,
            direction=DIRECTION_CODES[way],
            drive=ramp.end_level_v,
            drive_step=ramp.end_level_v - ramp.start_level_v,
            deflection=seen.value,
            deflection_errors=seen.standard_error,
            read_time=self.read_s,
            ramp_time=ramp.duration_s,
            creep=creep,
            creep_errors=creep_errors,
            zero=seen.before.value,
            drift=seen.before.drift_per_s,
            reached=recording.start_s + ramp.end_s,
            ended=recording.start_s + moved.size / rate,
            rested=recording.rested_s,
            conditioned=1.0,
            quality=point_quality((recording,), simulated, {Quality.DRIVE_OFF: drive_off}),
        )

    @classmethod
    def fit_lines(cls, points: Sequence[Any]) -> tuple[Series, ...]:
        """The deflection per volt above and below rest: lines through rest."""
        lines = []
        for sign, name in ((-1.0, "below"), (1.0, "above")):
            used = tuple(i for i in line_indices(points, *cls.axes) if sign * points[i].drive_step > LEVEL_TOLERANCE_V)
            if (line := deflection_per_volt([points[i] for i in used])) is not None:
                rest_v = float(np.mean([points[i].level - points[i].drive_step for i in used]))
                farthest_v = max((points[i].level for i in used), key=lambda level: sign * level)
                x = np.array(sorted((rest_v, farthest_v)))
                label = f"deflection per volt {name} rest"
                lines.append(Series(x, line[0] * (x - rest_v), role=Role.FIT, label=label, fitted_rows=used))
        return tuple(lines)

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        good = [point for point in points if Quality(point.quality).usable]
        above = [p for p in good if p.drive_step > LEVEL_TOLERANCE_V]
        below = [p for p in good if p.drive_step < -LEVEL_TOLERANCE_V]
        estimates = [
            EstimatedQuantity.listed(name, *value, SOURCE)
            for name, value in (
                ("static_gain_above_rest", deflection_per_volt(above)),
                ("static_gain_below_rest", deflection_per_volt(below)),
                ("creep_per_decade", relative_creep(good)),
                ("repeatability", repeatability(good)),
                ("loop_width", loop_width(good)),
            )
            if value is not None
        ]
        if len(good) > 1:
            error = math.hypot(good[0].deflection_errors, good[-1].deflection_errors) / math.sqrt(2)
            estimates.append(EstimatedQuantity.listed("zero_drift", good[-1].zero - good[0].zero, error, SOURCE))
        return tuple(estimates)

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = usable_points(points)
        moved = [p for p in good if abs(p.drive_step) > LEVEL_TOLERANCE_V]
        strongest = sorted(moved, key=lambda p: abs(p.drive_step))[len(moved) // 2 :]
        checks = list(
            signal_to_noise_check(
                "deflection, smallest",
                [(p.deflection, p.deflection_errors) for p in strongest],
                "the larger half of the steps",
            )
        )
        off = [p.drive - p.level for p in points if math.isfinite(p.drive - p.level)]
        if off:
            worst, limit = max(off, key=abs), LEVEL_TOLERANCE_V
            checks.append(CheckResult("drive read back - commanded, worst", worst, "V", -limit, limit, CABLE_REMEDY))
        if (creep := relative_creep(good)) is not None:
            remedy = "let the specimen rest between series, check the clamp, and check the sensor for drift"
            checks.append(
                CheckResult("creep per decade / deflection", creep[0], "1", -CREEP_LIMIT, CREEP_LIMIT, remedy)
            )
        remedy = "check the clamp and the sensor's mount; let the specimen rest longer between levels"
        groups = group_values(moved, lambda p: (p.level, p.direction), "deflection")
        return (*checks, *repeatability_check("deflection at one level", groups, remedy))

    def promised_estimates(self, points: Sequence[Any]) -> tuple[str, ...]:
        above = sum(p.drive_step > LEVEL_TOLERANCE_V for p in points)
        below = sum(p.drive_step < -LEVEL_TOLERANCE_V for p in points)
        sides = (("above", above), ("below", below))
        return tuple(f"static_gain_{side}_rest" for side, count in sides if count > 1)

    def _level_order(self, repeat: int) -> tuple[str, tuple[float, ...]]:
        """Return the levels of one repeat in order, and the name of the order."""
        if self.order == RANDOM:
            shuffled = np.random.default_rng([self.seed, repeat]).permutation(self.levels_v)
            return RANDOM, tuple(shuffled.tolist())
        falls = self.order == DOWN or (self.order == "up-down" and repeat % 2 == 0)
        return (DOWN if falls else UP), tuple(sorted(self.levels_v, reverse=falls))

    @property
    def lead_s(self) -> float:
        """Duration of the recording before the ramp: the window of the zero, and a margin."""
        return self.window_s + 0.05

    def _creep(self, moved: Any, rate: float, ramp: DetectedRamp, zero: float) -> tuple[float, float]:
        """Return growth per decade and its error; NaN if the hold is too short."""
        first = math.ceil((ramp.end_s + RINGDOWN_S) * rate)
        since_s = np.arange(first, moved.size) / rate - ramp.end_s
        try:
            creep = fit_creep(ramp.effective_time_s(since_s), moved[first:], zero)
        except ValueError:
            return math.nan, math.nan
        return creep.per_decade, creep.per_decade_error
