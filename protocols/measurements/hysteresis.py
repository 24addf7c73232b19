"""Hysteresis: displacement-voltage loops at several frequencies, several cycles each.

A loop has two causes: rate-independent hysteresis, and damping, whose loop grows with the frequency. A line through the
loop widths at several frequencies separates them: the width at frequency zero is hysteresis.
"""

import math
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from drivers import Drive, Sine
from model import QUANTITIES, Array, format_quantity, format_with_uncertainty
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
    SeriesAxis,
    Step,
)
from protocols.measurements.fields import (
    DriveVpp,
    FittedFrequency,
    QualityFlags,
    SampleRate,
    check_sample_rate,
    point_quality,
)
from protocols.measurements.fit_lines import line_indices
from protocols.measurements.result_checks import signal_to_noise_check, usable_points
from protocols.signals import fit_frequency, fit_sine, fold, measure_loops, remove_lines, weighted_fit

SOURCE = "line through the loop widths of this run over frequency"

MIN_FREQUENCIES = 3
"""Smallest number of frequencies for a line that separates hysteresis from damping."""

PHASES_PER_CYCLE = 128
"""Parts of a cycle, each the mean of at least two samples."""


@dataclass(frozen=True, slots=True)
class LoopPoint:
    """The loop at one frequency, over volts at the amplifier's input. Errors are standard, from cycle to cycle."""

    frequency: FittedFrequency
    share: Annotated[float, Unit("1"), QUANTITIES["share"].definition]
    share_errors: Annotated[float, Unit("1"), "standard uncertainty of the share"]
    width: Annotated[float, Unit("m"), "falling minus rising branch in the middle of the drive"]
    width_errors: Annotated[float, Unit("m"), "standard uncertainty of the width"]
    largest: Annotated[float, Unit("m"), "largest width of the loop"]
    largest_errors: Annotated[float, Unit("m"), "standard uncertainty of the largest width"]
    stroke: Annotated[float, Unit("m"), "displacement at the highest drive minus displacement at the lowest"]
    stroke_errors: Annotated[float, Unit("m"), "standard uncertainty of the stroke"]
    area: Annotated[float, Unit("m V"), "area of the loop; positive where the displacement lags"]
    area_errors: Annotated[float, Unit("m V"), "standard uncertainty of the area"]
    asymmetry: Annotated[float, Unit("1"), "area above the middle minus area below it, over the area"]
    asymmetry_errors: Annotated[float, Unit("1"), "standard uncertainty of the asymmetry"]
    cycles: Annotated[float, Unit("1"), "loops that were averaged"]
    quality: QualityFlags

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        return (
            f"{self.frequency:.4g} Hz: loop {format_quantity(self.width, self.width_errors, 'm')} wide, "
            f"{format_quantity(self.share, self.share_errors, '1', 'share')} of the stroke of {format_quantity(self.stroke, self.stroke_errors, 'm')}, "
            f"asymmetry {format_with_uncertainty(self.asymmetry, self.asymmetry_errors, signed=True)}"
        )


@dataclass(frozen=True, slots=True)
class FoldedCycles:
    """The cycles of a recording, each in `PHASES_PER_CYCLE` parts, the sensor's delay removed; arrays are (cycles, PHASES)."""

    frequency_hz: float
    drive_v: Array
    displacement_m: Array
    interference_m: Mapping[int, float]
    """Amplitude of interference by harmonic of the loop's rate, which repeats in every cycle; other interference is removed."""


class Hysteresis(Protocol):
    """Loops at several frequencies: width, area and asymmetry; separates hysteresis from damping."""

    name: ClassVar[str] = "hysteresis"
    title: ClassVar[str] = "Hysteresis"
    point_type: ClassVar[type] = LoopPoint
    axes: ClassVar[tuple[str, str]] = ("frequency", "share")
    default_plot: ClassVar[str] = "loop"
    substitutes: ClassVar[tuple[str, ...]] = ("voltage-steps",)

    frequencies_hz: Annotated[
        tuple[Annotated[float, Interval(ge=0.01, le=100)], ...],
        Unit("Hz"),
        Len(1, 100),
        "loop frequencies, in order; far below resonance",
    ] = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
    peak_to_peak_v: DriveVpp = 5.0
    cycles: Annotated[int, Unit("1"), Interval(ge=2, le=1000), "number of averaged loops"] = 5
    dropped: Annotated[
        int, Unit("1"), Interval(ge=1, le=100), "loops discarded at the start; the first loop is never closed"
    ] = 1
    sample_rate_hz: SampleRate = 5000.0

    @model_validator(mode="after")
    def _check_sample_rate(self) -> Self:
        highest = max(self.frequencies_hz)
        check_sample_rate(self.sample_rate_hz, 2.2 * PHASES_PER_CYCLE * highest, f"for loops at {highest:g} Hz")
        return self

    def adapted(self, rest_v: float, reason_unsupported: Callable[[Drive], str]) -> Self:
        """Omit the rates that the source cannot play, if enough are left to separate hysteresis from damping."""
        played = tuple(f for f in self.frequencies_hz if not reason_unsupported(self._drive(f, rest_v)))
        return self.model_copy(update={"frequencies_hz": played}) if len(set(played)) >= MIN_FREQUENCIES else self

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        return tuple(
            PlanEntry(f"{f:g} Hz", (self._drive(f, rest_v),), (self.dropped + self.cycles + 0.5) / f + 0.4, (f,))
            for f in self.frequencies_hz
        )

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        f = float(entry.key[0])
        yield Play(entry.drives[0], self.dropped / f)
        yield Record((self.cycles + 0.5) / f)  # the sensor has a delay, and the clocks differ slightly

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> LoopPoint:
        return self._loop_point(recordings[-1], self._fold_cycles(recordings[-1]), simulated)

    def series(self, key: tuple[float | str, ...], recordings: Sequence[Recording]) -> tuple[Series, ...]:
        return (self._loop_curve(key, self._fold_cycles(recordings[-1])),)

    def results(
        self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool
    ) -> Generator[Any, None, None]:
        folded = self._fold_cycles(recordings[-1])
        yield self._loop_point(recordings[-1], folded, simulated)
        yield self._loop_curve(key, folded)

    def _fold_cycles(self, recording: Recording) -> FoldedCycles:
        drive, rate = recording.drive, recording.rate_hz
        if not isinstance(drive, Sine):
            raise ValueError(f"a loop cannot be taken from a recording under {drive.kind}")
        frequency = fit_frequency(recording.drive_v, rate, drive.frequency_hz)
        clean, coincident = remove_lines(recording.displacement_m, rate, frequency, recording.interference)
        moved = _advance(clean, recording.sensor_delay_s * rate)
        volts = recording.drive_v[: moved.size]
        first = _first_sample(volts, rate, frequency)
        drive_v, displacement_m = (
            _unaveraged(fold(x[first:], rate, 1 / frequency, PHASES_PER_CYCLE, 0)[: self.cycles])
            for x in (volts, moved)
        )
        return FoldedCycles(frequency, drive_v, displacement_m, coincident)

    def _loop_curve(self, key: tuple[float | str, ...], folded: FoldedCycles) -> Series:
        """Return the closed mean loop; its errors refer to the shape alone, because its position drifts between cycles."""
        centre = folded.displacement_m.mean()
        shapes = folded.displacement_m - folded.displacement_m.mean(axis=1, keepdims=True)
        errors = shapes.std(axis=0, ddof=1) / math.sqrt(len(shapes))
        return Series(
            _close_loop(folded.drive_v.mean(axis=0)),
            _close_loop(centre + shapes.mean(axis=0)),
            _close_loop(errors),
            x_axis=SeriesAxis("drive", "V", "volts at the amplifier's input"),
            y_axis=SeriesAxis("displacement", "m", "displacement, mean of the cycles"),
            name=self.default_plot,
            label=f"{float(key[0]):g} Hz",
        )

    def _loop_point(self, recording: Recording, folded: FoldedCycles, simulated: bool) -> LoopPoint:
        loop = measure_loops(folded.drive_v, folded.displacement_m, folded.interference_m)
        interfered = math.hypot(*folded.interference_m.values()) > loop.noise
        return LoopPoint(
            frequency=folded.frequency_hz,
            share=loop.relative_width,
            share_errors=math.hypot(loop.width_error, loop.relative_width * loop.stroke_error) / loop.stroke,
            width=loop.width,
            width_errors=loop.width_error,
            largest=loop.max_width,
            largest_errors=loop.max_width_error,
            stroke=loop.stroke,
            stroke_errors=loop.stroke_error,
            area=loop.area,
            area_errors=loop.area_error,
            asymmetry=loop.asymmetry,
            asymmetry_errors=loop.asymmetry_error,
            cycles=loop.degrees_of_freedom + 1.0,
            quality=point_quality((recording,), simulated, {Quality.INTERFERENCE: interfered}),
        )

    @classmethod
    def fit_lines(cls, points: Sequence[Any]) -> tuple[Series, ...]:
        """The loop's width over frequency: hysteresis where it meets zero, damping and delay in its slope."""
        used = line_indices(points, *cls.axes)
        if (fit := _width_over_frequency([points[i] for i in used])) is None:
            return ()
        ends = np.array([0.0, max(points[i].frequency for i in used)])
        line = fit[0][0] + fit[0][1] * ends
        label = "hysteresis + loop width per frequency"
        return (Series(ends, line, role=Role.FIT, label=label, fitted_rows=used),)

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        if (fit := _width_over_frequency(points)) is None:
            return ()
        line, errors = fit
        return (
            EstimatedQuantity.listed("loop_hysteresis", float(line[0]), float(errors[0]), SOURCE),
            EstimatedQuantity.listed("loop_width_per_frequency", float(line[1]), float(errors[1]), SOURCE),
        )

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = usable_points(points)
        return signal_to_noise_check("stroke, smallest", [(p.stroke, p.stroke_errors) for p in good])

    def promised_estimates(self, points: Sequence[Any]) -> tuple[str, ...]:
        return ("loop_hysteresis",) if len(set(self.frequencies_hz)) >= MIN_FREQUENCIES else ()

    def _drive(self, frequency_hz: float, rest_v: float) -> Sine:
        # Two spare loops; finite, so that a generator left alone comes to rest.
        cycles = self.dropped + self.cycles + 2 + math.ceil(frequency_hz)
        return Sine(float(frequency_hz), self.peak_to_peak_v / 2, rest_v, cycles)


def _first_sample(drive_v: Array, rate_hz: float, frequency_hz: float) -> int:
    """Return the first sample from which the extremes of the drive lie in the middle of a phase, which otherwise miss them."""
    to_extreme = 0.25 - float(np.angle(fit_sine(drive_v, rate_hz, frequency_hz).fundamental)) / (2 * math.pi)
    phases = (to_extreme * PHASES_PER_CYCLE - 0.5) % 1.0
    return round(phases / PHASES_PER_CYCLE / frequency_hz * rate_hz)


def _unaveraged(cycles: Array) -> Array:
    """Return folded cycles, (cycles, PHASES), without the loss of the fundamental by the average over a phase."""
    mean = cycles.mean(axis=1, keepdims=True)
    return np.asarray(mean + (cycles - mean) / np.sinc(1 / PHASES_PER_CYCLE))


def _close_loop(loop: Array) -> Array:
    """Return the loop closed by its first value."""
    return np.append(loop, loop[0])


def _advance(samples: Array, shift: float) -> Array:
    """Return the samples shifted `by` samples earlier by linear interpolation; shorter at the end."""
    at = np.arange(samples.size, dtype=float) + shift
    inside = at[(at >= 0) & (at <= samples.size - 1)]
    return np.asarray(np.interp(inside, np.arange(samples.size), samples))


def _width_over_frequency(points: Iterable[Any]) -> tuple[Array, Array] | None:
    """Return intercept and slope of the loops' relative width over frequency, and their standard errors; None for too few frequencies."""
    good = [p for p in points if Quality(p.quality).usable and p.share_errors > 0]
    if len({round(p.frequency, 3) for p in good}) < MIN_FREQUENCIES:
        return None
    f, share = np.array([p.frequency for p in good]), np.array([p.share for p in good])
    line, covariance = weighted_fit((np.ones_like(f), f), share, 1 / np.array([p.share_errors for p in good]))
    return line, np.sqrt(np.diag(covariance))
