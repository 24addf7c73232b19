"""Sweep: frequency response within seconds, with coherence, standard errors, Q and decay time.

A fast linear sweep is repeated without a pause, with alternating sign. Even-order products - above all the amplifier's second
harmonic, 21 % of the fundamental - fall between the lines of the response. The first period, in which the response becomes
periodic, is recorded but not used; the spread of the others gives the standard errors. If the waveform memory is too small for
the band, octaves of it are swept one after the other (`pieces`).
"""

import math
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Interval, Unit
from pydantic import model_validator

from drivers import Drive, PeriodicSweep
from model import format_quantity, format_with_uncertainty, quality_factor
from protocols.base import (
    CheckResult,
    EstimatedQuantity,
    PlanEntry,
    Protocol,
    Quality,
    Record,
    Recording,
    ReferenceModel,
    Series,
    Step,
    first_adapted,
)
from protocols.measurements.dwelt_response import check_response_present, with_fitted_mode
from protocols.measurements.fields import (
    DampingRatio,
    DampingRatioError,
    DriveVpp,
    NaturalFrequency,
    NaturalFrequencyError,
    QualityFlags,
    SampleRate,
    modal_columns,
    modal_estimates,
    point_quality,
)
from protocols.measurements.fit_lines import mean_line
from protocols.measurements.result_checks import (
    coherence_check,
    drive_ratio_check,
    membrane_absent_check,
    repeatability_check,
    signal_to_noise_check,
    usable_points,
)
from protocols.measurements.sweep_pieces import (
    MIN_PERIODS,
    SETTLED_S,
    adapted_pieces,
    fewest_pieces,
    merge_pieces,
    piece_bands,
)
from protocols.signals import FREQUENCY_RESPONSE, FrequencyResponse, ModalFit

SOURCE = "one mode fitted to the response of a periodic sweep"

DRIVE_MARGIN_S = 0.5
"""Spare duration of the drive for its start, and for the delivery by the card."""

MIN_LINES = 30
"""Fewest lines in the band of a faster sweep for a small waveform memory: the scatter of fewer lines does not show repeating
errors (see `repeating_error_share`)."""

FASTER = tuple(1.1**k for k in range(1, 50))
"""Factors of faster sweeps, tried in turn."""

REFERENCE_LINES = 201
"""Number of lines for the maximum of the reference's response."""

FIT_BAND = (0.5, 1.8)
"""Range of the fit of one mode below and above the peak, as a share of its frequency: its half-power width for damping up to 0.5."""


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """Resonance from one sweep. Uncertainties are standard, and include the residual of one mode.

    Resonance and damping are NaN if no single mode fits the response, as under a membrane.
    """

    repeat: Annotated[float, Unit("1"), "number of the repeat, from 1"]
    natural_frequency: NaturalFrequency
    natural_frequency_errors: NaturalFrequencyError
    damping: DampingRatio
    damping_errors: DampingRatioError
    peak_frequency: Annotated[float, Unit("Hz"), "frequency of the line with the largest response"]
    peak_response: Annotated[float, Unit("m/V"), "largest response, per volt at the amplifier's input"]
    coherence: Annotated[float, Unit("1"), "lowest coherence within the resonance's half-power width"]
    lines: Annotated[float, Unit("1"), "number of lines of the response"]
    drive_amplitude: Annotated[float, Unit("V"), "half of the recorded drive, peak to peak"]
    quality: QualityFlags

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        if not math.isfinite(self.natural_frequency):
            return f"no resonance of one mode; largest response {format_quantity(self.peak_response, 0.0, 'm/V')} at {self.peak_frequency:.4g} Hz"
        return (
            f"natural frequency {format_with_uncertainty(self.natural_frequency, self.natural_frequency_errors)} Hz, damping ratio "
            f"{format_with_uncertainty(self.damping, self.damping_errors)}, "
            f"Q {0.5 / self.damping:.2f}, coherence at least {self.coherence:.5f}"
        )


def fit_one_mode(response: FrequencyResponse) -> tuple[FrequencyResponse, ModalFit | None]:
    """Return the lines around the peak, and the mode fitted to them; None if no single mode fits."""
    from protocols.signals import fit_sdof

    peak_hz = float(response.x[response.plotted.argmax()])
    near = response.within(FIT_BAND[0] * peak_hz, FIT_BAND[1] * peak_hz)
    try:
        return near, fit_sdof(near.x, near.y, near.errors, near.correlation)
    except ValueError:
        return near, None


def sweep_point(repeat: float, response: FrequencyResponse, amplitude_v: float, quality: int) -> SweepPoint:
    """Return the point of a frequency response: resonance and damping of one mode, if it fits, and the highest line."""
    top = int(response.plotted.argmax())
    near, mode = fit_one_mode(response)
    core = near.coherence
    if mode is not None:  # otherwise the measured peak is kept: its height shows whether a membrane is on the tactor
        half = mode.natural_hz * min(mode.damping_ratio, 0.5)
        core = response.within(mode.natural_hz - half, mode.natural_hz + half).coherence
    return SweepPoint(
        repeat=repeat,
        **modal_columns(mode),
        peak_frequency=float(response.x[top]),
        peak_response=float(response.plotted[top]),
        coherence=float(core.min()) if core.size else math.nan,
        lines=float(response.x.size),
        drive_amplitude=amplitude_v,
        quality=quality,
    )


class Sweep(Protocol):
    """The frequency response within seconds, with coherence and error bars; resonance, Q and decay time."""

    name: ClassVar[str] = "sweep"
    title: ClassVar[str] = "Sweep"
    point_type: ClassVar[type] = SweepPoint
    axes: ClassVar[tuple[str, str]] = ("repeat", "natural_frequency")
    default_plot: ClassVar[str] = FREQUENCY_RESPONSE
    substitutes: ClassVar[tuple[str, ...]] = ("sine-dwell",)
    integrates_velocity: ClassVar[bool] = True

    start_hz: Annotated[float, Unit("Hz"), Interval(ge=1, le=5000), "lowest frequency"] = 25.0
    stop_hz: Annotated[float, Unit("Hz"), Interval(ge=2, le=5000), "highest frequency, rounded to a line"] = 525.0
    peak_to_peak_v: DriveVpp = 5.0
    sweep_s: Annotated[
        float,
        Unit("s"),
        Interval(ge=0.02, le=60),
        "duration of one pass through the band, or through its highest piece; spacing of the lines: 1 / sweep_s",
    ] = 0.5
    periods: Annotated[
        int, Unit("1"), Interval(ge=2, le=1000), "analysed periods, of two sweeps each; one more is played"
    ] = 6
    pieces: Annotated[
        int,
        Unit("1"),
        Interval(ge=1, le=60),
        "number of bands swept one after the other, for a generator with a memory too small for the whole band; 1: whole band",
    ] = 1
    repeats: Annotated[int, Unit("1"), Interval(ge=1, le=100), "repeats of the whole measurement"] = 1
    sample_rate_hz: SampleRate = 5000.0

    @model_validator(mode="after")
    def _check_parameters(self) -> Self:
        if self.pieces > 1:
            self._check_pieces()
        elif self.stop_hz <= self.start_hz + 5 / self.sweep_s:
            raise ValueError(
                f"stop_hz of {self.stop_hz:g} Hz must lie at least five lines, {5 / self.sweep_s:g} Hz, above start_hz"
            )
        if self.sample_rate_hz < 4 * self.stop_hz:
            raise ValueError(f"sample_rate_hz must be at least four times stop_hz, {4 * self.stop_hz:g} Hz")
        samples = 2 * self.sweep_s * self.sample_rate_hz
        if abs(samples - round(samples)) > 1e-6:
            raise ValueError(f"two sweeps of {self.sweep_s:g} s are {samples:g} samples: it must be a whole number")
        return self

    def _check_pieces(self) -> None:
        octaves = fewest_pieces(self.start_hz, self.stop_hz)
        if self.stop_hz < 2 * self.start_hz:
            raise ValueError(
                f"pieces are octaves, and the band from {self.start_hz:g} to {self.stop_hz:g} Hz is none: use pieces = 1"
            )
        if self.pieces < octaves:
            raise ValueError(
                f"{self.pieces} pieces of an octave do not cover {self.start_hz:g} to {self.stop_hz:g} Hz: "
                f"at least {octaves} are needed"
            )
        lines = self.pieces * self.sweep_s * self.stop_hz / 2
        if lines < MIN_LINES:
            raise ValueError(
                f"{self.pieces} pieces of {self.sweep_s:g} s hold about {lines:.0f} lines together, at least {MIN_LINES} are needed: "
                "use more pieces or a longer sweep_s"
            )

    def adapted(self, rest_v: float, reason_unsupported: Callable[[Drive], str]) -> Self:
        """Sweep faster and more often if the source's memory is small; or in pieces, each for its share of the time."""
        most = self.sweep_s * (self.stop_hz - self.start_hz) / MIN_LINES
        rate = 2 * self.sample_rate_hz
        faster = [(divisor, math.floor(self.sweep_s * rate / divisor) / rate) for divisor in FASTER]
        used_s = self.periods * self.sweep_s
        changes = [{"sweep_s": s, "periods": math.ceil(used_s / s)} for divisor, s in faster if divisor <= most]
        if self.stop_hz >= 2 * self.start_hz:
            octave_s = used_s / math.log2(self.stop_hz / self.start_hz)
            pieces = max(adapted_pieces(self.start_hz, self.stop_hz), self.pieces)
            changes += [
                {"sweep_s": s, "periods": max(math.ceil(octave_s / s), MIN_PERIODS), "pieces": pieces}
                for _, s in faster
                if s > 0
            ]
        return first_adapted(changes, self, rest_v, reason_unsupported)

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        drives = self.drives(rest_v)
        seconds = sum(drive.duration_s + 0.5 for drive in drives)
        return tuple(PlanEntry(f"sweep {i}", drives, seconds, (i,)) for i in range(1, self.repeats + 1))

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        for drive in entry.drives:
            if isinstance(drive, PeriodicSweep):
                yield Record(sum(self._played_periods(drive.sweep_s)) * drive.period_s, drive)

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> SweepPoint:
        response = self.response(recordings)
        check_response_present(response)
        commanded_v = 0.5 * self.peak_to_peak_v
        amplitudes = [0.5 * float(np.ptp(recording.drive_v)) for recording in self._last(recordings)]
        amplitude_v = max(amplitudes, key=lambda volts: abs(volts - commanded_v))
        return sweep_point(float(key[0]), response, amplitude_v, point_quality(self._last(recordings), simulated, {}))

    def series(self, key: tuple[float | str, ...], recordings: Sequence[Recording]) -> tuple[Series, ...]:
        response = self.response(recordings)
        label = f"of sweep {key[0]:g}" if self.repeats > 1 else ""
        return (with_fitted_mode(response, *fit_one_mode(response), label),)

    @classmethod
    def fit_lines(cls, points: Sequence[Any]) -> tuple[Series, ...]:
        return mean_line(points, *cls.axes, "mean natural frequency")

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        usable = [p for p in points if Quality(p.quality).usable and math.isfinite(p.natural_frequency)]
        if not usable:
            return ()
        natural, natural_error = _mean_with_error(
            [p.natural_frequency for p in usable], [p.natural_frequency_errors for p in usable]
        )
        zeta, zeta_error = _mean_with_error([p.damping for p in usable], [p.damping_errors for p in usable])
        decay_s = 1 / (2 * math.pi * natural * zeta)
        relative = zeta_error / zeta
        return (
            *modal_estimates(natural, natural_error, zeta, zeta_error, SOURCE),
            quality_factor(EstimatedQuantity.listed("damping_ratio", zeta, zeta_error, SOURCE)),
            EstimatedQuantity.listed(
                "decay_time", decay_s, decay_s * math.hypot(relative, natural_error / natural), SOURCE
            ),
            EstimatedQuantity.listed("lowest_coherence", min(p.coherence for p in usable), 0.0, SOURCE),
        )

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = usable_points(points)
        remedy = "check the clamp, and that nothing touches the tactor"
        return (
            *signal_to_noise_check(
                "natural frequency, smallest", [(p.natural_frequency, p.natural_frequency_errors) for p in good]
            ),
            *signal_to_noise_check("damping ratio, smallest", [(p.damping, p.damping_errors) for p in good]),
            *drive_ratio_check([p.drive_amplitude for p in points], 0.5 * self.peak_to_peak_v),
            *coherence_check([p.coherence for p in good]),
            *repeatability_check(
                "natural frequency", [[p.natural_frequency for p in good if math.isfinite(p.natural_frequency)]], remedy
            ),
        )

    def promised_estimates(self, points: Sequence[Any]) -> tuple[str, ...]:
        return "natural_frequency", "damping_ratio"

    def reference_checks(self, points: Sequence[Any], reference: ReferenceModel) -> tuple[CheckResult, ...]:
        if not self.start_hz < reference.resonance_hz < self.stop_hz:
            return ()
        highest = float(
            reference.response(
                np.linspace(self.start_hz, self.stop_hz, REFERENCE_LINES).tolist(), 0.5 * self.peak_to_peak_v
            ).max()
        )
        ratios = [p.peak_response / highest for p in usable_points(points) if math.isfinite(p.peak_response)]
        return membrane_absent_check(ratios, reference.calibrated, reference.source)

    def _last(self, recordings: Sequence[Recording]) -> Sequence[Recording]:
        """Return the recordings of the last sweep, one per piece."""
        return recordings[-self.pieces :]

    def response(self, recordings: Sequence[Recording]) -> FrequencyResponse:
        """Return the frequency response of the last sweep."""
        parts = [self._piece_response(recording) for recording in self._last(recordings)]
        return parts[0] if self.pieces == 1 else merge_pieces(parts)

    def _piece_response(self, recording: Recording) -> FrequencyResponse:
        from protocols.signals import estimate_periodic_response, integrated_response

        drive = recording.drive
        if not isinstance(drive, PeriodicSweep):
            raise ValueError(f"a sweep cannot use a recording under {drive.kind}")
        # Samples before the drive belong to the dropped periods.
        dropped, used = self._played_periods(drive.sweep_s)
        surplus = len(recording.drive_v) - round((dropped + used) * drive.period_s * recording.rate_hz)
        response = estimate_periodic_response(
            recording.drive_v[max(surplus, 0) :],
            recording.displacement_m[max(surplus, 0) :],
            recording.rate_hz,
            drive.period_s,
            (drive.start_hz, drive.stop_hz),
            dropped,
            delay_s=recording.sensor_delay_s,
            interference=recording.interference,
        )
        return integrated_response(response, recording.velocity_corner_hz)

    def _played_periods(self, sweep_s: float) -> tuple[int, int]:
        """Return the numbers of dropped and of used periods of a piece: about equal times for all pieces."""
        if self.pieces == 1:
            return 1, self.periods
        used = max(round(self.periods * self.sweep_s / sweep_s), MIN_PERIODS)
        return math.ceil(SETTLED_S / (2 * sweep_s)), used

    def drives(self, rest_v: float) -> tuple[PeriodicSweep, ...]:
        """Return the sweep of each piece."""
        if self.pieces == 1:
            return (self._drive(self.start_hz, self.stop_hz, self.sweep_s, rest_v),)
        rate = 2 * self.sample_rate_hz  # duration of a period, two sweeps, in a whole number of samples
        return tuple(
            self._drive(low, top, math.floor(self.sweep_s * self.stop_hz / top * rate + 1e-6) / rate, rest_v)
            for low, top in piece_bands(self.start_hz, self.stop_hz, self.pieces)
        )

    def _drive(self, start_hz: float, top_hz: float, sweep_s: float, rest_v: float) -> PeriodicSweep:
        # A whole number of cycles: the top changes by less than a line, because the period must not change.
        cycles = round(0.5 * (start_hz + top_hz) * sweep_s)
        stop_hz = 2 * cycles / sweep_s - start_hz
        periods = sum(self._played_periods(sweep_s)) + math.ceil(DRIVE_MARGIN_S / (2 * sweep_s))
        return PeriodicSweep(start_hz, stop_hz, sweep_s, periods, self.peak_to_peak_v / 2, rest_v)


def _mean_with_error(values: Sequence[float], errors: Sequence[float]) -> tuple[float, float]:
    """Return the mean of repeats and its error: the larger of their own errors, which they share in part, and their spread."""
    spread = float(np.std(values, ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else 0.0
    return float(np.mean(values)), max(float(np.mean(errors)), spread)
