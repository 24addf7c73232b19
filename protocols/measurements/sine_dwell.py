"""Sine dwell: settled response at one frequency after the other; resonance (paper, Sec. IV-3).

A point has the paper's amplitude, max - min, and the fundamental of a least-squares sine fit: the amplifier's two slopes make
harmonics, and near half the resonance both amplitudes differ by a fifth. Several recordings under one sine are averaged.
"""

import math
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from drivers import Sine
from model import Complex, format_quantity, format_with_uncertainty
from protocols.base import (
    PART_SCANS,
    CheckResult,
    EstimatedQuantity,
    InterferenceLine,
    Log,
    PlanEntry,
    Protocol,
    Quality,
    Record,
    Recording,
    ReferenceModel,
    Settle,
    Step,
)
from protocols.measurements.fields import (
    DriveVpp,
    FittedFrequency,
    QualityFlags,
    check_sample_rate,
    modal_estimates,
    point_quality,
)
from protocols.measurements.result_checks import (
    RESONANCE_BAND,
    drive_ratio_check,
    membrane_absent_check,
    signal_to_noise_check,
    usable_points,
)
from protocols.signals import (
    MAINS_HZ,
    SEPARATION_BINS,
    MaxMin,
    SineFit,
    corner_errors,
    displacement_under_sine,
    estimate_max_min,
    fit_frequency,
    fit_sine,
)

HARMONIC_COUNT = 8
"""Number of fitted components; under a sine the amplifier generates 2, 4, 6, ... with 21, 4, 2, ... % of the fundamental."""

MIN_RESPONSE_SIGMAS = 5.0
"""Standard uncertainties of the smallest fundamental of a response."""


@dataclass(frozen=True, slots=True)
class SinePoint:
    """One frequency of a sine dwell. Uncertainties are standard and statistical; the sensor's gain is common to all."""

    frequency: FittedFrequency
    peak_to_peak: Annotated[
        float, Unit("m"), "max - min of the displacement, corrected for noise and sampling: the paper's amplitude"
    ]
    peak_to_peak_errors: Annotated[float, Unit("m"), "standard uncertainty of max - min"]
    fundamental: Annotated[float, Unit("m"), "peak amplitude of the fundamental by least-squares sine fit"]
    fundamental_errors: Annotated[float, Unit("m"), "standard uncertainty of the fundamental"]
    phase: Annotated[float, Unit("rad"), "phase of the fundamental against the recorded drive, sensor delay removed"]
    phase_errors: Annotated[float, Unit("rad"), "standard uncertainty of the phase, drive channel included"]
    thd: Annotated[float, Unit("1"), "total harmonic distortion of the displacement"]
    harmonics: Annotated[tuple[float, ...], Unit("m"), "peak amplitudes of orders 1..8 (NaN beyond the sample rate)"]
    drive_amplitude: Annotated[float, Unit("V"), "peak amplitude of the recorded drive at the amplifier's input"]
    drive_offset: Annotated[float, Unit("V"), "mean of the recorded drive"]
    offset: Annotated[float, Unit("m"), "mean displacement; NaN with a vibrometer"]
    drift: Annotated[float, Unit("m/s"), "slope of the mean displacement; NaN with a vibrometer"]
    noise: Annotated[float, Unit("m"), "standard deviation of the fit's residuals"]
    cycles: Annotated[float, Unit("1"), "cycles recorded"]
    quality: QualityFlags

    @property
    def relative_uncertainty(self) -> float:
        """Standard uncertainty of the fundamental over the fundamental."""
        return self.fundamental_errors / self.fundamental if self.fundamental > 0 else math.inf

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        return amplitude_text(self)


def amplitude_text(point: SinePoint) -> str:
    """Return frequency, amplitudes, phase and distortion of a point in a line."""
    phase = format_with_uncertainty(math.degrees(point.phase), math.degrees(point.phase_errors))
    return (
        f"{point.frequency:.3f} Hz: max - min {format_quantity(point.peak_to_peak, point.peak_to_peak_errors, 'm')}, "
        f"2 × fundamental {format_quantity(2 * point.fundamental, 2 * point.fundamental_errors, 'm')}, phase {phase}°, "
        f"THD {format_with_uncertainty(100 * point.thd, 0.0, '%', digits=3)}"
    )


@dataclass(frozen=True, slots=True)
class _RecordingFit:
    """Fits of drive and displacement of one recording. `components` are rotated so that the drive has phase 0; (K,), m."""

    frequency: float
    components: np.ndarray
    driven: SineFit
    moved: SineFit
    extremes: MaxMin
    samples: int
    coincident: Mapping[int, float]
    """Amplitude of inseparable interference by order of the drive's harmonic."""

    @property
    def drive_amplitude(self) -> float:
        """Peak amplitude of the recorded drive."""
        return abs(self.driven.fundamental)

    @property
    def drive_error(self) -> float:
        """Relative standard error of the drive; 0 without a drive."""
        return self.driven.standard_error / self.drive_amplitude if self.drive_amplitude else 0.0


def sine_point(recordings: Sequence[Recording], simulated: bool) -> SinePoint:
    """Return the point of recordings under one sine; several, or parts of a long one, are averaged as vectors against their drives.

    Raises:
        ValueError: a recording was not made under a sine, or is too short for the fit.
    """
    drive, rate = recordings[-1].drive, recordings[-1].rate_hz
    if not isinstance(drive, Sine):
        raise ValueError(f"a sine dwell cannot use a recording under {drive.kind}")
    each = [_fit_recording(part, drive.frequency_hz) for recording in recordings for part in recording.parts()]

    def mean(name: str) -> float:
        return float(np.mean([attrgetter(name)(one) for one in each]))

    def error_of_mean(name: str) -> float:
        return math.sqrt(sum(attrgetter(name)(one) ** 2 for one in each)) / len(each)

    components = np.mean([one.components for one in each], axis=0)
    fundamental = float(abs(components[0]))
    statistical = error_of_mean("moved.standard_error")
    # Interference at the frequency of the drive has a measured amplitude and an unknown phase; averaging may not help.
    interference = {order: size / math.sqrt(2) for one in each for order, size in one.coincident.items()}
    frequency, corner_hz = mean("frequency"), recordings[-1].velocity_corner_hz
    by_corner, phase_by_corner = corner_errors(frequency, corner_hz or 0.0)
    error = math.hypot(statistical, interference.get(1, 0.0), by_corner * fundamental)
    # The phase is against the recorded drive, whose channel has noise of its own.
    phase_error = (
        math.hypot(error / fundamental, error_of_mean("drive_error"), phase_by_corner) if fundamental > 0 else math.inf
    )
    detected = {
        Quality.NO_RESPONSE: fundamental < MIN_RESPONSE_SIGMAS * error,
        Quality.INTERFERENCE: interference.get(1, 0.0) > statistical,
        Quality.FOLDED: any(
            is_folded_onto(r.interference, drive.frequency_hz, (r.rows[1] - r.rows[0]) / r.rate_hz) for r in recordings
        ),
    }
    turn = np.angle(components[0]) + 2 * np.pi * frequency * recordings[-1].sensor_delay_s
    return SinePoint(
        frequency=frequency,
        peak_to_peak=mean("extremes.value"),
        peak_to_peak_errors=math.hypot(
            error_of_mean("extremes.scatter"),
            max(one.extremes.systematic for one in each),
            2 * math.hypot(*interference.values()),
            2 * by_corner * fundamental,
        ),
        fundamental=fundamental,
        fundamental_errors=error,
        phase=float(np.angle(np.exp(1j * turn))),
        phase_errors=min(phase_error, math.pi / math.sqrt(3)),
        thd=float(np.linalg.norm(components[1:]) / fundamental) if fundamental > 0 else math.nan,
        harmonics=harmonic_amplitudes(components),
        drive_amplitude=mean("drive_amplitude"),
        drive_offset=mean("driven.offset"),
        offset=mean("moved.offset") if corner_hz is None else math.nan,
        drift=mean("moved.drift_per_s") if corner_hz is None else math.nan,
        noise=math.sqrt(sum(one.moved.noise**2 for one in each) / len(each)),
        cycles=sum(one.samples for one in each) * frequency / rate,
        quality=point_quality(recordings, simulated, detected),
    )


def harmonic_amplitudes(components: Complex) -> tuple[float, ...]:
    """Return the peak amplitudes of the orders 1..8, NaN beyond the sample rate."""
    harmonics = np.full(HARMONIC_COUNT, np.nan)
    harmonics[: len(components)] = np.abs(components)
    return tuple(harmonics.tolist())


def _fit_recording(recording: Recording, frequency_hz: float) -> _RecordingFit:
    rate, drive_v = recording.rate_hz, recording.drive_v  # each access may read the file
    frequency = fit_frequency(drive_v, rate, frequency_hz)
    driven = fit_sine(drive_v, rate, frequency)
    displacement, coincident = displacement_under_sine(recording, frequency)
    moved = fit_sine(displacement, rate, frequency, HARMONIC_COUNT)
    orders = np.arange(1, len(moved.components) + 1)
    return _RecordingFit(
        frequency=frequency,
        components=moved.components * np.exp(-1j * orders * np.angle(driven.fundamental)),
        driven=driven,
        moved=moved,
        extremes=estimate_max_min(displacement, rate, frequency),
        samples=len(displacement),
        coincident=coincident,
    )


def is_folded_onto(lines: Sequence[InterferenceLine], frequency_hz: float, duration_s: float) -> bool:
    """Return whether an aliased line lies at a frequency, in a recording of this duration."""
    return any(
        line.folded and line.significant and abs(line.frequency_hz - frequency_hz) * duration_s < SEPARATION_BINS
        for line in lines
    )


MIN_SAMPLES_PER_CYCLE = 20
"""Fewest samples per cycle, as in the paper at 250 Hz and 5 kS/s."""

MAX_RECORDINGS = 20
"""Largest number of averaged recordings of one frequency without a time budget."""

FREQUENCY_TOLERANCE_HZ = 0.05
"""Distance below which frequencies count as equal."""

SETTLING_LIMIT = 0.05
"""Largest change of the mean displacement during a recording, over the amplitude: creep or drift."""

MIN_POINTS_OF_RESONANCE = 5
"""Smallest number of usable points for which a peak must give a resonance."""

LOOK_SCANS = 1 << 17
"""Number of scans for a first test of the response, before the point is computed."""

PAPER_FREQUENCIES_HZ = (25, 50, 75, 100, 125, 150, 155, 160, 165, 170, 175, 180, 185, 190, 195, 200, 225, 250)


class SineDwell(Protocol):
    """Frequencies one at a time, settled, whole cycles; the paper's 18 by default."""

    name: ClassVar[str] = "sine-dwell"
    title: ClassVar[str] = "Sine dwell"
    point_type: ClassVar[type] = SinePoint
    axes: ClassVar[tuple[str, str]] = ("frequency", "peak_to_peak")
    max_recording_scans: ClassVar[float] = math.inf
    integrates_velocity: ClassVar[bool] = True

    frequencies_hz: Annotated[
        tuple[Annotated[float, Interval(ge=1, le=2000)], ...], Unit("Hz"), Len(1, 500), "frequencies, in order"
    ] = PAPER_FREQUENCIES_HZ
    peak_to_peak_v: DriveVpp = 5.0
    record_s: Annotated[float, Unit("s"), Interval(ge=0.05, le=600), "shortest recording per frequency"] = 0.5
    min_cycles: Annotated[int, Unit("1"), Interval(ge=3, le=100_000), "fewest whole cycles per recording"] = 20
    settle_tolerance: Annotated[
        float, Unit("1"), Interval(gt=0, le=0.1), "largest relative change between windows of a settled response"
    ] = 0.005
    settle_limit_s: Annotated[
        float,
        Unit("s"),
        Interval(ge=0.5, le=600),
        "longest wait for settling; then the point is recorded and flagged as unsettled",
    ] = 5.0
    decay_s: Annotated[
        float,
        Unit("s"),
        Interval(ge=0, le=10),
        "decay time of the resonance, from a sweep: shortest window of the settling test; 0: unknown",
    ] = 0.0
    target_relative_uncertainty: Annotated[
        float,
        Unit("1"),
        Interval(ge=0, le=0.5),
        "average until this relative uncertainty of the fundamental; 0: one recording",
    ] = 0.0
    refine_to_hz: Annotated[
        float,
        Unit("Hz"),
        Interval(ge=0, le=100),
        "add points around the peak until their spacing is this small; 0: do not refine",
    ] = 0.0
    budget_s: Annotated[
        float,
        Unit("s"),
        Interval(ge=0, le=36_000),
        "limit of the bench time for averaging and added points; 0: no limit",
    ] = 0.0
    mains_shift_hz: Annotated[
        float,
        Unit("Hz"),
        Interval(ge=0, le=5),
        "measure this far below a multiple of 50 or 60 Hz instead of nearer to it (3 separates it from hum); 0: no shift",
    ] = 0.0
    sample_rate_hz: Annotated[
        float,
        Unit("Hz"),
        Interval(ge=500, le=500_000),
        "scans per second; at most 250 kHz with two channels of a USB-6341",
    ] = 5000.0

    @model_validator(mode="after")
    def _check_parameters(self) -> Self:
        highest = max(self.frequencies_hz)
        # Fewer samples per cycle would miss the extremes, and fold the amplifier's harmonics onto the fundamental.
        check_sample_rate(self.sample_rate_hz, MIN_SAMPLES_PER_CYCLE * highest, f"for a sine of {highest:g} Hz")
        for f in self.dwell_frequencies_hz:
            if self.settle_limit_s < 3 * self._window_s(f) - 1e-9:
                raise ValueError(
                    f"settle_limit_s of {self.settle_limit_s:g} s holds no three windows of {self._window_s(f):.3g} s at "
                    f"{f:g} Hz, and two changes are needed to see that nothing changes; at least "
                    f"{3 * self._window_s(f):.3g} s is needed"
                )
        least_s = sum(map(self._expected_s, self.dwell_frequencies_hz))
        if 0 < self.budget_s < least_s:
            raise ValueError(
                f"budget_s of {self.budget_s:g} s is too short: {len(self.frequencies_hz)} frequencies take about "
                f"{least_s:.0f} s; measure fewer, or leave the budget at 0"
            )
        return self

    @property
    def dwell_frequencies_hz(self) -> tuple[float, ...]:
        """The measured frequencies in order: the list, shifted off the mains by `mains_shift_hz`."""
        return tuple(self._off_mains(f) for f in self.frequencies_hz)

    def _off_mains(self, f: float) -> float:
        for mains_hz in MAINS_HZ:
            multiple = round(f / mains_hz) * mains_hz
            if multiple and abs(f - multiple) < self.mains_shift_hz:
                return multiple - self.mains_shift_hz
        return f

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        return tuple(self._plan_entry(f, rest_v) for f in self.dwell_frequencies_hz)

    def refine(self, points: Sequence[Any], rest_v: float) -> tuple[PlanEntry, ...]:
        """Halve the gaps on both sides of the highest point while they are wider than `refine_to_hz`."""
        if not self.refine_to_hz:
            return ()
        added, left_s = [], self.budget_s - sum(self._expected_s(p.frequency) for p in points)
        for f in refinement_frequencies(points, self.refine_to_hz):
            left_s -= self._expected_s(f)
            if left_s >= 0 or not self.budget_s:
                added.append(self._plan_entry(f, rest_v))
        return tuple(added)

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        f = float(entry.key[-1])
        yield Settle(entry.drives[0], self._window_s(f), self.settle_tolerance, self.settle_limit_s)
        # The card is not read during this computation, and the point follows: a first part of a long recording suffices.
        looked_at = PART_SCANS if self.target_relative_uncertainty else LOOK_SCANS
        have = [(yield Record(self._record_s(f))).parts(looked_at)[0]]
        point = sine_point(have, simulated=False)
        most = self._max_recordings(f)
        while (
            self.target_relative_uncertainty
            and point.relative_uncertainty > self.target_relative_uncertainty
            and len(have) < most
        ):
            needed = math.ceil(len(have) * (point.relative_uncertainty / self.target_relative_uncertainty) ** 2)
            missing = max(min(needed, most) - len(have), 1)
            limit = "" if needed <= most else f" of {needed - len(have)}, as many as the time allows,"
            yield Log(
                f"{entry.label}: {format_percent(point.relative_uncertainty)} after {len(have)}; {missing} more{limit} "
                f"to reach {format_percent(self.target_relative_uncertainty)}"
            )
            for _ in range(missing):
                again = yield Record(self._record_s(f))
                have.append(again.parts(looked_at)[0])
            point = sine_point(have, simulated=False)
        if Quality.NO_RESPONSE in Quality(point.quality):
            yield Log(
                f"{entry.label}: no response. The displacement's fundamental is {1e6 * point.fundamental:.2g} µm, within 5 "
                f"standard uncertainties of nothing ({1e6 * point.fundamental_errors:.2g} µm each), while the drive reads back "
                f"{point.drive_amplitude:.3g} V. Check that the amplifier's high voltage is on and the laser meets the tactor"
            )

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> Any:
        return sine_point(recordings, simulated)

    def folded_onto(self, point: Any, lines: Sequence[InterferenceLine]) -> bool:
        return is_folded_onto(lines, point.frequency, self._record_s(point.frequency))

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        usable = [p for p in points if Quality(p.quality).usable]
        return *fit_resonance(usable), *find_peak(usable)

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = usable_points(points)
        checks = signal_to_noise_check("fundamental, smallest", [(p.fundamental, p.fundamental_errors) for p in good])
        checks += drive_ratio_check([p.drive_amplitude for p in points], 0.5 * self.peak_to_peak_v)
        moved = [abs(p.drift) * p.cycles / p.frequency / p.fundamental for p in good if p.fundamental > 0]
        moved = [each for each in moved if math.isfinite(each)]
        if moved:
            name = "move of the mean while recording / amplitude, largest"
            remedy = "wait longer after switching high voltage on, and check the clamp and the sensor's mount"
            checks += (CheckResult(name, max(moved), "1", None, SETTLING_LIMIT, remedy),)
        return checks + self._resonance_check(good)

    def _resonance_check(self, good: Sequence[Any]) -> tuple[CheckResult, ...]:
        """Return the check that one mode fits points that bracket a peak."""
        by_frequency = sorted(good, key=lambda p: p.frequency)
        response = [p.fundamental / p.drive_amplitude for p in by_frequency]
        if len(response) < MIN_POINTS_OF_RESONANCE or not all(map(math.isfinite, response)):
            return ()
        if response.index(max(response)) in (0, len(response) - 1) or not all(math.isfinite(p.phase) for p in good):
            return ()
        count = float(len(fit_resonance(good)) > 0)
        remedy = "look at the points around the peak; measure more of them there"
        return (CheckResult("modes fitted to the peak", count, "1", 1.0, None, remedy),)

    def reference_checks(self, points: Sequence[Any], reference: ReferenceModel) -> tuple[CheckResult, ...]:
        return self._membrane_absent(usable_points(points), reference)

    def _membrane_absent(self, free: Sequence[Any], reference: ReferenceModel) -> tuple[CheckResult, ...]:
        top_hz = reference.resonance_hz
        near = [p for p in free if RESONANCE_BAND[0] * top_hz <= p.frequency <= RESONANCE_BAND[1] * top_hz]
        near = [p for p in near if math.isfinite(p.fundamental) and p.drive_amplitude > 0]
        if not near:
            return ()
        expected = reference.response([p.frequency for p in near], 0.5 * self.peak_to_peak_v)
        ratios = [p.fundamental / p.drive_amplitude / float(one) for p, one in zip(near, expected, strict=True)]
        return membrane_absent_check(ratios, reference.calibrated, reference.source)

    def _plan_entry(self, f: float, rest_v: float) -> PlanEntry:
        return PlanEntry(f"{f:g} Hz", (self._drive(f, rest_v),), self._expected_s(f), (f,))

    def _expected_s(self, f: float) -> float:
        return 0.4 + 4 * self._window_s(f) + self._record_s(f)

    def _max_recordings(self, f: float) -> int:
        if not self.target_relative_uncertainty:
            return 1
        if not self.budget_s:
            return MAX_RECORDINGS
        spare_s = self.budget_s - sum(map(self._expected_s, self.dwell_frequencies_hz))
        return 1 + math.floor(spare_s / len(self.frequencies_hz) / self._record_s(f))

    def _drive(self, frequency_hz: float, rest_v: float) -> Sine:
        # Long enough for the worst case, finite so that a generator left alone comes to rest.
        longest_s = self.settle_limit_s + self._max_recordings(frequency_hz) * self._record_s(frequency_hz) + 3.0
        cycles = math.ceil(longest_s * frequency_hz)
        return Sine(float(frequency_hz), self.peak_to_peak_v / 2, rest_v, cycles)

    def _window_s(self, frequency_hz: float) -> float:
        # In a window much shorter than the decay a ringing response hardly changes and looks steady.
        return max(2, math.ceil(max(0.04, self.decay_s) * frequency_hz)) / frequency_hz

    def _record_s(self, frequency_hz: float) -> float:
        return max(self.min_cycles, math.ceil(self.record_s * frequency_hz)) / frequency_hz


def refinement_frequencies(points: Sequence[Any], resolution_hz: float) -> list[float]:
    """Return the middles between the highest usable point and its neighbours that are not close enough."""
    usable = sorted((p for p in points if Quality(p.quality).usable), key=lambda p: p.frequency)
    if len(usable) < 3:
        return []
    top = max(range(len(usable)), key=lambda i: usable[i].fundamental / usable[i].drive_amplitude)
    neighbours = [usable[i].frequency for i in (top - 1, top + 1) if 0 <= i < len(usable)]
    middles = [
        round(0.5 * (frequency + usable[top].frequency), 1)
        for frequency in neighbours
        if abs(frequency - usable[top].frequency) > resolution_hz + FREQUENCY_TOLERANCE_HZ
    ]
    # A frequency that was measured without a response is not measured again.
    return [m for m in middles if all(abs(p.frequency - m) > FREQUENCY_TOLERANCE_HZ for p in points)]


def format_percent(fraction: float) -> str:
    """`2 %`, `0.031 %`."""
    return f"{100 * fraction:.2g} %" if math.isfinite(fraction) else "no response"


SOURCE = "complex fit of one mode and the residual of higher modes to the fundamentals of this run"


def fit_resonance(points: Sequence[Any]) -> tuple[EstimatedQuantity, ...]:
    """Fit one resonant mode and the residual of higher modes by weighted least squares; see `fit_sdof`.

    Args:
        points: with `frequency`, `fundamental`, `fundamental_errors`, `phase`, `drive_amplitude` (see SinePoint); all usable. Errors
            that are not all known make no weights.

    Returns:
        Natural and damped frequency in hertz and damping ratio; empty if the points do not span a resonance.
    """
    from protocols.signals import fit_sdof  # imported here: slow to load

    f = np.array([p.frequency for p in points])
    response = np.array([p.fundamental / p.drive_amplitude * np.exp(1j * p.phase) for p in points])
    errors = np.array([p.fundamental_errors / p.drive_amplitude for p in points])
    known = bool(np.all(np.isfinite(errors) & (errors > 0)))
    try:
        mode = fit_sdof(f, response, errors if known else None)
    except ValueError:
        return ()
    return modal_estimates(mode.natural_hz, mode.natural_error_hz, mode.damping_ratio, mode.damping_error, SOURCE)


def find_peak(points: Sequence[Any]) -> tuple[EstimatedQuantity, ...]:
    """Return the frequency of the largest fundamental, from the highest of usable points and its neighbours; empty at an end."""
    from protocols.signals import dwell_peak  # imported here: slow to load

    columns = [
        np.array([getattr(p, name) for p in points]) for name in ("frequency", "fundamental", "fundamental_errors")
    ]
    if (peak := dwell_peak(*columns)) is None:
        return ()
    source = "resonance through the four highest fundamentals of this run"
    return (EstimatedQuantity.listed("peak_frequency", peak.frequency_hz, peak.frequency_error_hz, source),)
