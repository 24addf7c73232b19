"""Mass resonance: peak of the displacement spectrum for several added masses (paper, Sec. IV-1).

A sweep too long for the waveform memory is played in pieces, from rest to rest, each over its share of the band at the same sweep
rate; the responses of the pieces overlap and are joined. A card's analogue output plays it in one piece (`piece_s` = `sweep_s`).
If the memory is too small for pieces, sines at single frequencies replace the sweep, closer together within the peak (`method` =
`dwell`).
"""

import contextlib
import itertools
import math
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from drivers import Drive, LinearSweep, Sine
from model import format_with_uncertainty
from protocols.base import (
    CheckResult,
    EstimatedQuantity,
    PlanEntry,
    Prompt,
    Protocol,
    Record,
    Recording,
    Role,
    Series,
    Settle,
    Step,
    first_adapted,
)
from protocols.measurements.dwelt_response import (
    LINES_IN_PEAK,
    check_response_present,
    coarse_frequencies,
    dwelt_response,
    next_frequencies,
    with_fitted_mode,
)
from protocols.measurements.fields import DriveVpp, QualityFlags, SampleRate, modal_columns, point_quality
from protocols.measurements.fit_lines import CURVE_POINTS, line_indices
from protocols.measurements.result_checks import (
    added_mass_checks,
    coherence_check,
    signal_to_noise_check,
    usable_points,
)
from protocols.signals import FREQUENCY_RESPONSE, MIN_BINS_PER_LINE, FrequencyResponse, ModalFit

RINGDOWN_S = 0.3
"""Duration of the recording after a sweep, until the free vibration has decayed."""

OVERLAP_LINES = 6
"""Overlap of neighbouring pieces in lines, half of it beyond the share of each: begin and end of a piece disturb its outermost
lines."""

FADE_WIDTHS = 1.5
"""Duration of the fade at the begin and the end of a piece, in units of the inverse root of its rate: the width of the ends of its
spectrum. A faster fade has a ripple in the spectrum, a slower one is longer than the overlap of the pieces."""

MAX_OVERLAP = 0.5
"""Largest total overlap of adapted pieces, as a share of the band: overlaps reduce the time per line."""

SWEEP = "sweep"

SETTLE_TOLERANCE, SETTLE_LIMIT_S = 0.002, 1.5
"""Largest relative change between windows of a settled response to a sine, and the longest wait for it."""

DWELL_RECORD_S, DWELL_CYCLES, DWELL_MARGIN_S = 0.3, 20, 1.0
"""Shortest recording of a sine, its fewest cycles, and the spare duration of the drive."""

DWELL_S, MAX_DWELLS = 1.2, 120
"""Typical duration of one frequency, and the largest number of frequencies of a mass."""

EDGE_MARGIN = 0.1
"""Distance of a peak from the band's edge, as a share of its frequency, below which it is reported."""


@dataclass(frozen=True, slots=True)
class MassPoint:
    """One added mass. Uncertainties are standard and statistical."""

    mass: Annotated[float, Unit("kg"), "added mass"]
    frequency: Annotated[float, Unit("Hz"), "frequency of the largest response: the paper's resonance"]
    frequency_errors: Annotated[float, Unit("Hz"), "standard uncertainty of the peak's frequency"]
    spectrum_peak: Annotated[
        float,
        Unit("Hz"),
        "frequency of the peak in the spectrum of the displacement over that of the drive, all pieces joined",
    ]
    spectrum_peak_errors: Annotated[float, Unit("Hz"), "standard uncertainty of the spectrum's peak"]
    natural_frequency: Annotated[float, Unit("Hz"), "undamped natural frequency of one mode fitted to the response"]
    natural_frequency_errors: Annotated[float, Unit("Hz"), "standard uncertainty of the natural frequency"]
    damping: Annotated[float, Unit("1"), "damping ratio of the fitted mode"]
    damping_errors: Annotated[float, Unit("1"), "standard uncertainty of the damping ratio"]
    height: Annotated[float, Unit("m/V"), "response at the peak, per volt at the amplifier's input"]
    coherence: Annotated[float, Unit("1"), "lowest coherence within the peak's half-power width"]
    resolution: Annotated[float, Unit("Hz"), "full width of a line"]
    quality: QualityFlags

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        return (
            f"{1e3 * self.mass:.2f} g: peak {format_with_uncertainty(self.frequency, self.frequency_errors)} Hz, natural frequency "
            f"{format_with_uncertainty(self.natural_frequency, self.natural_frequency_errors)} Hz, damping ratio {format_with_uncertainty(self.damping, self.damping_errors)}"
        )


class MassResonance(Protocol):
    """Resonance against added mass: a slow sweep for each mass, and the peak of its response."""

    name: ClassVar[str] = "mass-resonance"
    title: ClassVar[str] = "Mass resonance"
    point_type: ClassVar[type] = MassPoint
    axes: ClassVar[tuple[str, str]] = ("mass", "frequency")
    default_plot: ClassVar[str] = FREQUENCY_RESPONSE
    uses_weights: ClassVar[bool] = True

    masses_kg: Annotated[
        tuple[Annotated[float, Interval(ge=0, le=0.1)], ...], Unit("kg"), Len(1, 100), "added masses, in order"
    ] = (1.75e-3, 2.75e-3, 3.75e-3, 4.75e-3, 5.75e-3, 6.75e-3, 7.75e-3, 8.75e-3, 9.75e-3)
    start_hz: Annotated[float, Unit("Hz"), Interval(ge=1, le=2000), "first frequency of the sweep"] = 25.0
    stop_hz: Annotated[float, Unit("Hz"), Interval(ge=2, le=2000), "last frequency of the sweep"] = 525.0
    sweep_s: Annotated[
        float,
        Unit("s"),
        Interval(ge=5, le=3600),
        "duration of one sweep, all pieces together; a peak narrower than 320 / piece_s (in Hz) needs longer pieces",
    ] = 300.0
    piece_s: Annotated[
        float,
        Unit("s"),
        Interval(ge=1, le=3600),
        "longest piece, limited by the generator's memory (docs/generators.md)",
    ] = 20.0
    method: Annotated[
        Literal["sweep", "dwell"],
        "sweep, or dwell: sines at single frequencies, for a generator with a memory too small for a piece of the sweep",
    ] = "sweep"
    dwells: Annotated[
        int,
        Unit("1"),
        Interval(ge=8, le=200),
        "frequencies over the band, before the refinement of the peak; counts with the method dwell",
    ] = 16
    peak_to_peak_v: DriveVpp = 5.0
    low_hz: Annotated[float, Unit("Hz"), Interval(ge=1, le=2000), "lower end of the search band of the peak"] = 125.0
    high_hz: Annotated[float, Unit("Hz"), Interval(ge=2, le=2000), "upper end of the search band of the peak"] = 500.0
    sample_rate_hz: SampleRate = 5000.0

    @model_validator(mode="after")
    def _check_parameters(self) -> Self:
        if not self.start_hz < self.low_hz < self.high_hz < self.stop_hz:
            raise ValueError(
                f"the peak's band {self.low_hz:g}..{self.high_hz:g} Hz must rise and lie within the sweep, "
                f"{self.start_hz:g}..{self.stop_hz:g} Hz"
            )
        if self.sample_rate_hz < 4 * self.stop_hz:
            raise ValueError(f"sample_rate_hz must be at least four times stop_hz, {4 * self.stop_hz:g} Hz")
        if len(set(self.masses_kg)) != len(self.masses_kg):
            raise ValueError("masses_kg names a mass twice")
        if self.method == SWEEP and self._resolution_hz > 0.1 * self.low_hz:
            raise ValueError(
                f"pieces of {self._piece_duration_s:.3g} s give lines of {self._resolution_hz:.3g} Hz, too coarse for a peak at "
                f"{self.low_hz:g} Hz; sweep longer, or in longer pieces"
            )
        return self

    def adapted(self, rest_v: float, reason_unsupported: Callable[[Drive], str]) -> Self:
        """Play shorter pieces if the source's memory is small, or single frequencies if the overlaps become too long."""
        counts = (math.ceil(self._piece_count * 1.2**k) for k in range(1, 40))
        pieces = (self.sweep_s / count for count in counts)
        most = MAX_OVERLAP * (self.stop_hz - self.start_hz)
        changes: list[dict[str, Any]] = [
            {"piece_s": s} for s in pieces if (self.sweep_s / s - 1) * OVERLAP_LINES * _resolution_hz(s) <= most
        ]
        return first_adapted([*changes, {"method": "dwell"}], self, rest_v, reason_unsupported)

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        drives: tuple[Drive, ...]
        if self.method == SWEEP:
            drives = self._sweeps(rest_v)
            seconds = sum(drive.duration_s + RINGDOWN_S + 0.5 for drive in drives)
            how = f"{self.sweep_s:g} s, lines of {self._resolution_hz:.2g} Hz"
        else:
            frequencies = coarse_frequencies(self.start_hz, self.stop_hz, self.dwells)
            drives = tuple(self._sine(f, rest_v) for f in frequencies)
            seconds = DWELL_S * (len(drives) + 2 * LINES_IN_PEAK)
            how = f"{self.dwells} frequencies and the frequencies of the peak"
        return tuple(
            PlanEntry(
                f"{1e3 * mass:g} g, {how}",
                drives,
                seconds,
                (mass,),
                Prompt(
                    "fix-mass",
                    f"Fix an added mass of {1e3 * mass:g} g in the cylinder." if mass else "Take the added mass off.",
                    {"mass_kg": mass},
                    hands_on=True,
                ),
            )
            for mass in self.masses_kg
        )

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        if self.method == SWEEP:
            for drive in entry.drives:
                yield Record(drive.duration_s + RINGDOWN_S, drive)
            return
        recordings: list[Recording] = []
        left = [drive for drive in entry.drives if isinstance(drive, Sine)]
        while left and len(recordings) < MAX_DWELLS:
            for sine in left:
                yield Settle(sine, self._window_s(sine.frequency_hz), SETTLE_TOLERANCE, SETTLE_LIMIT_S)
                recordings.append((yield Record(self._dwell_record_s(sine.frequency_hz))))
            response = dwelt_response(recordings)
            inside = response.within(self.low_hz, self.high_hz)
            more = next_frequencies(inside.x.tolist(), inside.plotted.tolist())
            left = [self._sine(f, rest_v) for f in more]

    def warnings(self, points: Sequence[Any]) -> tuple[str, ...]:
        return tuple(
            f"{1e3 * point.mass:g} g: the peak at {point.frequency:.1f} Hz lies near the edge of the band in which it is "
            f"searched, {self.low_hz:g} to {self.high_hz:g} Hz; widen it (low and high) before more mass is added"
            for point in points
            if min(point.frequency / self.low_hz, self.high_hz / point.frequency) < 1 + EDGE_MARGIN
        )

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> MassPoint:
        return self._point(key, recordings, simulated, self._response(recordings))

    def series(self, key: tuple[float | str, ...], recordings: Sequence[Recording]) -> tuple[Series, ...]:
        response = self._response(recordings)
        return (with_fitted_mode(response, *self._fit_mode(response), f"with {1e3 * float(key[0]):g} g"),)

    def results(
        self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool
    ) -> Generator[Any, None, None]:
        response = self._response(recordings)
        yield self._point(key, recordings, simulated, response)
        yield with_fitted_mode(response, *self._fit_mode(response), f"with {1e3 * float(key[0]):g} g")

    def _fit_mode(self, response: FrequencyResponse) -> tuple[FrequencyResponse, ModalFit]:
        """Return the lines around the peak, and the mode fitted to them."""
        from protocols.signals import fit_sdof, response_peak

        peak = response_peak(response, (self.low_hz, self.high_hz))
        near = response.within(0.5 * peak.frequency_hz, 1.8 * peak.frequency_hz)
        return near, fit_sdof(near.x, near.y, near.errors, near.correlation)

    def _point(
        self,
        key: tuple[float | str, ...],
        recordings: Sequence[Recording],
        simulated: bool,
        response: FrequencyResponse,
    ) -> MassPoint:
        from protocols.signals import joined_spectrum_peak, response_peak

        check_response_present(response)
        peak = response_peak(response, (self.low_hz, self.high_hz))
        _, mode = self._fit_mode(response)
        spectrum = math.nan, math.nan
        # Single frequencies have no spectrum, and a spectrum may lack the peak that the response has.
        with contextlib.suppress(ValueError):
            if self.method != SWEEP:
                raise ValueError("single frequencies make no spectrum")
            of_spectrum = joined_spectrum_peak(
                [recording.displacement_m for recording in recordings],
                recordings[0].rate_hz,
                self._shares_hz(recordings),
                (self.low_hz, self.high_hz),
                drives=[recording.drive_v for recording in recordings],
            )
            spectrum = of_spectrum.frequency_hz, of_spectrum.standard_error_hz
        return MassPoint(
            mass=float(key[0]),
            frequency=float(peak.frequency_hz),
            frequency_errors=float(peak.standard_error_hz),
            spectrum_peak=spectrum[0],
            spectrum_peak_errors=spectrum[1],
            **modal_columns(mode),
            height=float(peak.height),
            coherence=float(response.within(*peak.band_hz).coherence.min()),
            resolution=response.resolution_hz,
            quality=point_quality(recordings, simulated, {}),
        )

    @classmethod
    def fit_lines(cls, points: Sequence[Any]) -> tuple[Series, ...]:
        """Return the line of a constant stiffness: 1/f² is linear in the added mass."""
        used = line_indices(points, *cls.axes)
        mass, f, error = (
            np.array([getattr(points[i], n) for i in used]) for n in ("mass", "frequency", "frequency_errors")
        )
        if np.unique(mass).size < 3 or not (error > 0).all():
            return ()
        slope, intercept = np.polyfit(mass, f**-2, 1, w=f**3 / (2 * error))
        drawn = np.linspace(mass.min(), mass.max(), CURVE_POINTS)
        squared = intercept + slope * drawn
        if not (squared > 0).all():
            return ()
        label = "stiffness constant: 1/f² linear in the mass"
        return (Series(drawn, squared**-0.5, role=Role.FIT, label=label, fitted_rows=used),)

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        """Return the peak of each mass; the damping ratios are in the points, and k2 needs the model, see `identify`."""
        source = (
            f"largest response from {self.low_hz:g} to {self.high_hz:g} Hz, sines or sweep of {self.peak_to_peak_v:g} V"
        )
        return tuple(
            EstimatedQuantity.listed(f"peak_frequency, {1e3 * p.mass:g} g", p.frequency, p.frequency_errors, source)
            for p in usable_points(tuple(points))
            if math.isfinite(p.frequency)
        )

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = [p for p in usable_points(points) if math.isfinite(p.natural_frequency) and p.natural_frequency > 0]
        errors = [p.natural_frequency_errors if math.isfinite(p.natural_frequency_errors) else 0.0 for p in good]
        return (
            *signal_to_noise_check(
                "natural frequency, smallest", [(p.natural_frequency, p.natural_frequency_errors) for p in good]
            ),
            *coherence_check([p.coherence for p in good]),
            *added_mass_checks([p.mass for p in good], [p.natural_frequency for p in good], errors),
        )

    @property
    def _piece_count(self) -> int:
        return math.ceil(self.sweep_s / self.piece_s - 1e-9)

    @property
    def _piece_duration_s(self) -> float:
        return self.sweep_s / self._piece_count

    @property
    def _resolution_hz(self) -> float:
        return _resolution_hz(self._piece_duration_s)

    def _window_s(self, frequency_hz: float) -> float:
        return max(2, math.ceil(0.04 * frequency_hz)) / frequency_hz

    def _dwell_record_s(self, frequency_hz: float) -> float:
        return max(DWELL_CYCLES, math.ceil(DWELL_RECORD_S * frequency_hz)) / frequency_hz

    def _sine(self, frequency_hz: float, rest_v: float) -> Sine:
        longest_s = SETTLE_LIMIT_S + self._dwell_record_s(frequency_hz) + DWELL_MARGIN_S
        return Sine(frequency_hz, self.peak_to_peak_v / 2, rest_v, math.ceil(longest_s * frequency_hz))

    def _sweeps(self, rest_v: float) -> tuple[LinearSweep, ...]:
        """Return the pieces: equal in duration and sweep rate, `sweep_s` in total with their overlaps."""
        count, overlap = self._piece_count, OVERLAP_LINES * self._resolution_hz
        duration_s, peak_v = self._piece_duration_s, 0.5 * self.peak_to_peak_v
        width = (self.stop_hz - self.start_hz + (count - 1) * overlap) / count
        starts = [self.start_hz + i * (width - overlap) for i in range(count)]
        fade_s = min(FADE_WIDTHS * math.sqrt(duration_s / width), duration_s / 8)
        return tuple(LinearSweep(start, start + width, duration_s, peak_v, rest_v, fade_s) for start in starts)

    def _shares_hz(self, recordings: Sequence[Recording]) -> tuple[tuple[float, float], ...]:
        """Return the share of the band of each piece: between the middles of its overlaps with its neighbours.

        Raises:
            ValueError: a recording is not of a sweep.
        """
        drives = [recording.drive for recording in recordings]
        joints = []
        for drive, following in itertools.pairwise(drives):
            if not (isinstance(drive, LinearSweep) and isinstance(following, LinearSweep)):
                raise ValueError(f"a mass resonance cannot use recordings under {drive.kind} and {following.kind}")
            joints.append(0.5 * (drive.stop_hz + following.start_hz))
        return tuple(itertools.pairwise([self.start_hz, *joints, self.stop_hz]))

    def _response(self, recordings: Sequence[Recording]) -> FrequencyResponse:
        from protocols.signals import concatenate_responses, estimate_swept_response

        if self.method != SWEEP:
            return dwelt_response(recordings)
        parts = []
        for recording, (low, high) in zip(recordings, self._shares_hz(recordings), strict=True):
            drive = recording.drive
            if not isinstance(drive, LinearSweep):
                raise ValueError(f"a mass resonance cannot use a recording under {drive.kind}")
            whole = estimate_swept_response(
                recording.drive_v,
                recording.displacement_m,
                recording.rate_hz,
                (drive.start_hz, drive.stop_hz),
                self._resolution_hz,
                recording.sensor_delay_s,
                recording.interference,
                drive.fade_s,
            )
            parts.append(whole.within(low, np.nextafter(high, low)) if len(recordings) > 1 else whole)
        return concatenate_responses(parts)


def _resolution_hz(piece_s: float) -> float:
    """Return the width of the lines of pieces of a duration."""
    return max(0.5, 1.1 * MIN_BINS_PER_LINE / piece_s)
