"""Square dwell: response to a square wave beside the response to a sine, at one frequency after the other.

A wearable device drives the tactor with an astable multivibrator (paper, Sec. II): a square wave with a duty cycle and the edges
of an RC circuit. At each frequency the sine is settled and recorded first, then the square wave, for at least the same time; both
have the same volts peak to peak. The ratio of the fundamentals of displacement and drive is equal for both if the tactor is
linear and the duty is 0.5; otherwise the amplifier's two slopes add to the square wave's fundamental.
"""

import math
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from drivers import Sine, SquareWave
from model import format_quantity, format_with_uncertainty
from protocols.base import (
    CheckResult,
    EstimatedQuantity,
    PlanEntry,
    Play,
    Protocol,
    Quality,
    Record,
    Recording,
    Series,
    SeriesAxis,
    Settle,
    SettlingResult,
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
from protocols.measurements.result_checks import signal_to_noise_check, usable_points
from protocols.measurements.sine_dwell import HARMONIC_COUNT, MIN_RESPONSE_SIGMAS, harmonic_amplitudes, sine_point
from protocols.signals import estimate_max_min, fit_frequency, fit_sine, fold, remove_lines

SETTLE_TOLERANCE, SETTLE_LIMIT_S = 0.005, 2.0
"""Largest relative change between windows of a settled response to the sine, and the longest wait for it."""

MIN_CYCLES = 20
DRIVE_MARGIN_S = 1.5
"""Spare duration of a drive; finite, so that a generator left alone comes to rest."""

MIN_SAMPLES_PER_CYCLE = 20
MAX_PHASES = 128
"""Number of values of a period in its series."""
CLOCK_TOLERANCE = 0.01
"""Relative amount by which a period may be shorter than commanded."""
ALL_HARMONICS = 1000
"""Number of fitted harmonics, more than there are below half the sample rate: those left out would count as noise."""
SYMMETRIC_DUTY = 0.5
"""The duty for which the amplifier's two slopes generate only even harmonics."""

LINEARITY_LIMIT = 0.05
"""Largest deviation from 1 of the response per volt under the square wave over that under the sine."""


@dataclass(frozen=True, slots=True)
class SquarePoint:
    """One frequency under a square wave and under a sine. Uncertainties are standard; the sensor's gain is common to all."""

    frequency: FittedFrequency
    peak_to_peak: Annotated[float, Unit("m"), "max - min of the displacement under the square wave"]
    peak_to_peak_errors: Annotated[float, Unit("m"), "standard uncertainty of the max - min under the square wave"]
    sine_peak_to_peak: Annotated[float, Unit("m"), "max - min under the sine of the same volts peak to peak"]
    sine_peak_to_peak_errors: Annotated[float, Unit("m"), "standard uncertainty of the max - min under the sine"]
    ratio: Annotated[float, Unit("1"), "max - min under the square wave over max - min under the sine"]
    ratio_errors: Annotated[float, Unit("1"), "standard uncertainty of the ratio"]
    fundamental: Annotated[float, Unit("m"), "peak amplitude of the fundamental under the square wave"]
    fundamental_errors: Annotated[float, Unit("m"), "standard uncertainty of the square wave's fundamental"]
    sine_fundamental: Annotated[float, Unit("m"), "peak amplitude of the fundamental under the sine"]
    sine_fundamental_errors: Annotated[float, Unit("m"), "standard uncertainty of the sine's fundamental"]
    linearity: Annotated[
        float,
        Unit("1"),
        "fundamental per volt of the drive's fundamental, square wave over sine; 1 for a linear tactor and a duty of 0.5",
    ]
    linearity_errors: Annotated[float, Unit("1"), "standard uncertainty of the linearity"]
    harmonics: Annotated[tuple[float, ...], Unit("m"), "peak amplitudes of orders 1..8 (NaN beyond the sample rate)"]
    drive_fundamental: Annotated[float, Unit("V"), "peak amplitude of the recorded square wave's fundamental"]
    drive_peak_to_peak: Annotated[float, Unit("V"), "max - min of the recorded square wave"]
    duty: Annotated[float, Unit("1"), "share of the time in which the recorded square wave is above its offset"]
    quality: QualityFlags

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        return (
            f"{self.frequency:.3f} Hz: max - min {format_quantity(self.peak_to_peak, self.peak_to_peak_errors, 'm')} under the "
            f"square wave, {format_quantity(self.sine_peak_to_peak, self.sine_peak_to_peak_errors, 'm')} under the sine, "
            f"ratio {format_with_uncertainty(self.ratio, self.ratio_errors)}"
        )


class SquareDwell(Protocol):
    """Response to a square wave with a duty cycle and RC edges, compared with a sine of the same volts."""

    name: ClassVar[str] = "square-dwell"
    title: ClassVar[str] = "Square dwell"
    point_type: ClassVar[type] = SquarePoint
    axes: ClassVar[tuple[str, str]] = ("frequency", "peak_to_peak")
    substitutes: ClassVar[tuple[str, ...]] = ("sine-dwell",)

    frequencies_hz: Annotated[
        tuple[Annotated[float, Interval(ge=1, le=500)], ...], Unit("Hz"), Len(1, 500), "frequencies, in order"
    ] = (50.0, 75.0, 100.0, 125.0, 150.0, 160.0, 175.0, 200.0, 225.0, 250.0)
    peak_to_peak_v: Annotated[
        DriveVpp,
        "drive at the amplifier's input, peak to peak: of the sine, and between the final levels of the square wave",
    ] = 4.5
    duty: Annotated[float, Unit("1"), Interval(ge=0.1, le=0.9), "fraction of a period at the upper level"] = 0.5
    edge_s: Annotated[float, Unit("s"), Interval(ge=1e-5, le=0.01), "time constant of the edges (R times C)"] = 5e-4
    record_s: Annotated[float, Unit("s"), Interval(ge=0.05, le=60), "shortest recording of each drive"] = 0.5
    sample_rate_hz: SampleRate = 10_000.0

    @model_validator(mode="after")
    def _check_parameters(self) -> Self:
        highest = max(self.frequencies_hz)
        check_sample_rate(self.sample_rate_hz, MIN_SAMPLES_PER_CYCLE * highest, f"for a square wave of {highest:g} Hz")
        for f in self.frequencies_hz:
            self._square(f, 0.0)  # the wave must cross its offset
        return self

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        return tuple(
            PlanEntry(
                f"{f:g} Hz",
                (self._sine(f, rest_v), self._square(f, rest_v)),
                1.0 + 8 * self._window_s(f) + 2 * self._record_duration_s(f),
                (f,),
            )
            for f in self.frequencies_hz
        )

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        f = float(entry.key[0])
        sine, square = entry.drives
        settled: SettlingResult = yield Settle(sine, self._window_s(f), SETTLE_TOLERANCE, SETTLE_LIMIT_S)
        yield Record(self._record_duration_s(f))
        yield Play(square, max(settled.after_s, 4 * self._window_s(f)))
        yield Record(self._record_duration_s(f))

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> SquarePoint:
        drive = recordings[-1].drive
        if len(recordings) < 2 or not isinstance(drive, SquareWave):
            raise ValueError(f"{key[0]} Hz: a recording under a sine and one under a square wave are needed")
        sine, square = sine_point(recordings[:-1], simulated), recordings[-1]
        rate = square.rate_hz
        # The clock's error is taken from the sine: aliased harmonics bias a fit to the square wave, and a wrong frequency
        # makes its high harmonics look like noise.
        sine_drive = recordings[0].drive
        nominal_hz = sine_drive.frequency_hz if isinstance(sine_drive, Sine) else drive.frequency_hz
        frequency = drive.frequency_hz * sine.frequency / nominal_hz
        driven = fit_sine(square.drive_v, rate, frequency, ALL_HARMONICS)
        clean, coincident = remove_lines(square.displacement_m, rate, frequency, square.interference)
        moved = fit_sine(clean, rate, frequency, ALL_HARMONICS)
        extremes = estimate_max_min(clean, rate, frequency)
        # Interference at a harmonic has a measured amplitude and an unknown phase.
        error = math.hypot(extremes.scatter, extremes.systematic, math.sqrt(2) * math.hypot(*coincident.values()))
        fundamental_error = math.hypot(moved.standard_error, coincident.get(1, 0.0) / math.sqrt(2))
        ratio = extremes.value / sine.peak_to_peak
        fundamental, drive_v = abs(moved.fundamental), abs(driven.fundamental)
        linearity = fundamental / drive_v / (sine.fundamental / sine.drive_amplitude)
        detected = {
            Quality.NO_RESPONSE: fundamental < MIN_RESPONSE_SIGMAS * fundamental_error,
            Quality.INTERFERENCE: fundamental_error > math.sqrt(2) * moved.standard_error,
        }
        return SquarePoint(
            frequency=frequency,
            peak_to_peak=extremes.value,
            peak_to_peak_errors=error,
            sine_peak_to_peak=sine.peak_to_peak,
            sine_peak_to_peak_errors=sine.peak_to_peak_errors,
            ratio=ratio,
            ratio_errors=ratio * math.hypot(error / extremes.value, sine.peak_to_peak_errors / sine.peak_to_peak),
            fundamental=fundamental,
            fundamental_errors=fundamental_error,
            sine_fundamental=sine.fundamental,
            sine_fundamental_errors=sine.fundamental_errors,
            linearity=linearity,
            linearity_errors=linearity
            * math.hypot(fundamental_error / fundamental, driven.standard_error / drive_v, sine.relative_uncertainty),
            harmonics=harmonic_amplitudes(moved.components[:HARMONIC_COUNT]),
            drive_fundamental=drive_v,
            drive_peak_to_peak=float(np.ptp(square.drive_v)),
            duty=float(np.mean(square.drive_v > drive.offset_v)),
            quality=point_quality((square,), simulated, detected) | sine.quality,
        )

    def series(self, key: tuple[float | str, ...], recordings: Sequence[Recording]) -> tuple[Series, ...]:
        """Return drive and displacement over a period from the rising edge on, each the mean of the cycles."""
        sine, square = recordings[0], recordings[-1]
        if not isinstance(sine.drive, Sine) or not isinstance(square.drive, SquareWave):
            raise ValueError(f"{key[0]} Hz: a recording under a sine and one under a square wave are needed")
        rate, nominal_hz = square.rate_hz, sine.drive.frequency_hz
        frequency = square.drive.frequency_hz * fit_frequency(sine.drive_v, rate, nominal_hz) / nominal_hz
        phases = min(MAX_PHASES, int(rate / frequency / 2 * (1 - CLOCK_TOLERANCE)))
        clean, _ = remove_lines(square.displacement_m, rate, frequency, square.interference)
        drive_v, moved = (fold(samples, rate, 1 / frequency, phases, 0) for samples in (square.drive_v, clean))
        first = int(np.argmax(np.diff(drive_v.mean(axis=0), append=drive_v.mean(axis=0)[0])))
        time = np.arange(phases) / phases / frequency
        label = f"{float(key[0]):g} Hz"
        return tuple(
            Series(
                time - late_s,
                np.roll(cycles.mean(axis=0), -first),
                np.roll((cycles - cycles.mean(axis=1, keepdims=True)).std(axis=0, ddof=1), -first)
                / math.sqrt(len(cycles)),
                x_axis=SeriesAxis("time", "s", "time since the rising edge, the sensor's delay removed"),
                y_axis=axis,
                name=name,
                label=label,
            )
            for name, cycles, late_s, axis in (
                ("square wave of the drive", drive_v, 0.0, SeriesAxis("drive", "V", "volts at the amplifier's input")),
                (
                    "square wave",
                    moved,
                    square.sensor_delay_s,
                    SeriesAxis("displacement", "m", "displacement, mean of the cycles"),
                ),
            )
        )

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        """Largest max - min under the square wave."""
        good = usable_points(list(points))
        if not good:
            return ()
        top = max(good, key=lambda p: p.peak_to_peak)
        source = f"highest of the square dwell, at {top.frequency:.4g} Hz"
        return (EstimatedQuantity.listed("square_wave_amplitude", top.peak_to_peak, top.peak_to_peak_errors, source),)

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = usable_points(points)
        if not good:
            return ()
        checks = signal_to_noise_check("fundamental, smallest", [(p.fundamental, p.fundamental_errors) for p in good])
        if self.duty != SYMMETRIC_DUTY:
            return checks
        worst = max((p.linearity - 1 for p in good), key=abs)
        remedy = (
            "look at the drive's trace and at the amplifier's current limit: an edge needs more current than a sine"
        )
        name = "response per volt, square wave / sine - 1, worst"
        return (*checks, CheckResult(name, worst, "1", -LINEARITY_LIMIT, LINEARITY_LIMIT, remedy))

    def _window_s(self, frequency_hz: float) -> float:
        return max(2, math.ceil(0.04 * frequency_hz)) / frequency_hz

    def _record_duration_s(self, frequency_hz: float) -> float:
        return max(MIN_CYCLES, math.ceil(self.record_s * frequency_hz)) / frequency_hz

    def _cycles(self, frequency_hz: float) -> int:
        longest_s = max(SETTLE_LIMIT_S, 4 * self._window_s(frequency_hz)) + self._record_duration_s(frequency_hz)
        return math.ceil((longest_s + DRIVE_MARGIN_S) * frequency_hz)

    def _sine(self, frequency_hz: float, rest_v: float) -> Sine:
        return Sine(frequency_hz, self.peak_to_peak_v / 2, rest_v, self._cycles(frequency_hz))

    def _square(self, frequency_hz: float, rest_v: float) -> SquareWave:
        amplitude_v = self.peak_to_peak_v / 2
        return SquareWave(frequency_hz, amplitude_v, rest_v, self.duty, self.edge_s, self._cycles(frequency_hz))
