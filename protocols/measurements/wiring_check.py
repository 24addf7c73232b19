"""Wiring check: verifies cables, gains and noise of the bench with a tenth of a volt.

Rest, a small step to each side and a small sine are recorded and compared with limits, which are parameters; `checks` is the
table that `tactor-bench check` prints.
"""

import math
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Interval, Unit
from pydantic import model_validator

from drivers import Drive, Hold, Sine
from model import QUANTITIES, Array
from protocols.base import (
    CheckResult,
    EstimatedQuantity,
    Outcome,
    PlanEntry,
    Play,
    Protocol,
    Quality,
    Record,
    Recording,
    Step,
)
from protocols.measurements.fields import FittedFrequency, QualityFlags, SampleRate, check_sample_rate, point_quality
from protocols.signals import (
    Connection,
    ConnectionLimits,
    ExpectedBending,
    ExpectedCapacitance,
    LargestLoss,
    Polarity,
    SmallestCapacitance,
    SmallestShare,
    connection_columns,
    fit_frequency,
    fit_sine,
)

SOURCE = "wiring check"

RECORDINGS = 4
"""Purposes of the recordings: rest, both sides and the sine."""

_limit = partial(CheckResult, consequence=Outcome.DID_NOT_PASS)


@dataclass(frozen=True, slots=True)
class WiringPoint:
    """Figures of one small drive. A held level has no frequency, amplitude and latency (NaN)."""

    commanded: Annotated[float, Unit("V"), "level or offset commanded at the amplifier's input"]
    commanded_amplitude: Annotated[float, Unit("V"), "peak amplitude commanded; 0 for a held level"]
    commanded_frequency: Annotated[float, Unit("Hz"), "frequency commanded"]
    drive: Annotated[float, Unit("V"), "mean of the recorded drive"]
    drive_amplitude: Annotated[float, Unit("V"), "peak amplitude of the recorded drive"]
    drive_noise: Annotated[float, Unit("V"), "standard deviation of the residuals of the recorded drive"]
    frequency: FittedFrequency
    displacement: Annotated[float, Unit("m"), "mean displacement"]
    displacement_errors: Annotated[float, Unit("m"), "standard uncertainty of the mean displacement"]
    amplitude: Annotated[float, Unit("m"), "peak amplitude of the displacement's fundamental"]
    latency: Annotated[
        float, Unit("s"), "delay of the displacement behind the drive, the sensor's configured delay removed"
    ]
    latency_errors: Annotated[float, Unit("s"), "standard uncertainty of the latency"]
    noise: Annotated[float, Unit("m"), "standard deviation of the residuals of the displacement"]
    quality: QualityFlags
    capacitance: Annotated[float, Unit("F"), QUANTITIES["capacitance"].definition] = field(
        default=math.nan, kw_only=True
    )
    loss: Annotated[float, Unit("1"), QUANTITIES["loss_factor"].definition] = field(default=math.nan, kw_only=True)
    bending: Annotated[float, Unit("m/V"), "in-phase displacement per volt on the specimen"] = field(
        default=math.nan, kw_only=True
    )
    bending_errors: Annotated[float, Unit("m/V"), "standard uncertainty of the bending"] = field(
        default=math.nan, kw_only=True
    )

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        drive = f"{self.commanded:.3f} V" if math.isnan(self.frequency) else f"sine of {self.commanded_frequency:g} Hz"
        seen = f"drive reads back {self.drive:.4f} V, displacement {1e6 * self.displacement:+.2f} µm"
        return f"{drive}: {seen}, noise {1e6 * self.noise:.2f} µm"


class WiringCheck(Protocol):
    """Small voltages before high voltage: polarity, gain, latency, noise, sensor in range, recorded drive."""

    name: ClassVar[str] = "wiring-check"
    rest_record_s: ClassVar[float] = 0.0
    title: ClassVar[str] = "Wiring check"
    point_type: ClassVar[type] = WiringPoint
    axes: ClassVar[tuple[str, str]] = ("commanded", "displacement")
    diagnosed_levels: ClassVar[tuple[str, ...]] = ("laser_lost", "no_response")
    passes_or_fails: ClassVar[bool] = True

    level_v: Annotated[
        float, Unit("V"), Interval(gt=0, le=0.5), "height of the steps to both sides of rest, and peak of the sine"
    ] = 0.1
    frequency_hz: Annotated[float, Unit("Hz"), Interval(ge=2, le=100), "frequency of the sine, far below resonance"] = (
        20.0
    )
    wait_s: Annotated[float, Unit("s"), Interval(ge=0.1, le=60), "wait before each recording"] = 0.3
    record_s: Annotated[float, Unit("s"), Interval(ge=0.5, le=60), "duration of each recording"] = 1.0
    sample_rate_hz: SampleRate = 5000.0
    polarity: Polarity = 1
    smallest_f: SmallestCapacitance = 2e-10
    largest_loss: LargestLoss = 0.5
    expected_f: ExpectedCapacitance = 0.0
    expected_bending: ExpectedBending = 0.0
    smallest_share: SmallestShare = 0.7
    drive_limit_v: Annotated[float, Unit("V"), Interval(gt=0), "largest deviation of the recorded drive"] = 0.02
    drive_noise_limit_v: Annotated[float, Unit("V"), Interval(gt=0), "largest noise of the recorded drive"] = 0.01
    gain_low_m_per_v: Annotated[float, Unit("m/V"), Interval(gt=0), "smallest displacement per volt at the input"] = (
        1e-6
    )
    gain_high_m_per_v: Annotated[float, Unit("m/V"), Interval(gt=0), "largest displacement per volt at the input"] = (
        1e-3
    )
    slopes_low: Annotated[float, Unit("1"), Interval(gt=0), "smallest ratio of the gains above and below rest"] = 1.5
    slopes_high: Annotated[float, Unit("1"), Interval(gt=0), "largest ratio of the gains above and below rest"] = 6.0
    latency_limit_s: Annotated[float, Unit("s"), Interval(gt=0), "largest latency beyond the sensor's own"] = 5e-3
    noise_limit_m: Annotated[float, Unit("m"), Interval(gt=0), "largest noise of the displacement"] = 5e-6
    frequency_limit: Annotated[
        float, Unit("1"), Interval(gt=0), "largest relative difference of the clocks of source and card"
    ] = 2e-4

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        purpose = f"to see the latency of a sine of {self.frequency_hz:g} Hz"
        check_sample_rate(self.sample_rate_hz, 20 * self.frequency_hz, purpose)
        for low, high in (("gain_low_m_per_v", "gain_high_m_per_v"), ("slopes_low", "slopes_high")):
            if getattr(self, low) >= getattr(self, high):
                raise ValueError(f"{low} must lie below {high}")
        return self

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        each_s = self.wait_s + self.record_s + 0.2
        return tuple(PlanEntry(label, (drive,), each_s, (label,)) for label, drive in self._drives(rest_v))

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        yield Play(entry.drives[0], self.wait_s)
        yield Record(self._record_duration_s)

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> WiringPoint:
        recording = recordings[-1]
        drive, rate, n = recording.drive, recording.rate_hz, len(recording.drive_v)
        seen_v, moved = float(recording.drive_v.mean()), float(recording.displacement_m.mean())
        drive_noise, noise = float(recording.drive_v.std()), float(recording.displacement_m.std())
        amplitude_v = amplitude = 0.0
        commanded_v, commanded_amplitude_v, commanded_hz = drive.end_levels_v[0], 0.0, math.nan
        frequency = latency = latency_errors = math.nan
        connection: dict[str, float] = {}
        if isinstance(drive, Sine):
            commanded_v, commanded_amplitude_v, commanded_hz = drive.offset_v, drive.amplitude_v, drive.frequency_hz
            driven = fit_sine(recording.drive_v, rate, commanded_hz)
            amplitude_v = abs(driven.fundamental)
            if amplitude_v > 0.5 * drive.amplitude_v:  # a drive that is too small has no phase
                frequency = fit_frequency(recording.drive_v, rate, commanded_hz)
                driven = fit_sine(recording.drive_v, rate, frequency)
                answer = fit_sine(recording.displacement_m, rate, frequency, 4)
                amplitude, noise, drive_noise = abs(answer.fundamental), answer.noise, driven.noise
                # A tactor that moves away from the sensor, or a swapped sign, gives half a turn, which is no latency.
                turn = float(np.angle(driven.fundamental / answer.fundamental))
                turn -= 2 * math.pi * frequency * recording.sensor_delay_s
                latency = math.remainder(turn, math.pi) / (2 * math.pi * frequency)
                latency_errors = answer.standard_error / max(amplitude, 1e-12) / (2 * math.pi * frequency)
                connection = connection_columns(recording)
        drive_off = abs(seen_v - commanded_v) > self.drive_limit_v
        return WiringPoint(
            commanded=commanded_v,
            commanded_amplitude=commanded_amplitude_v,
            commanded_frequency=commanded_hz,
            drive=seen_v,
            drive_amplitude=amplitude_v,
            drive_noise=drive_noise,
            frequency=frequency,
            displacement=moved,
            displacement_errors=noise / math.sqrt(n),
            amplitude=amplitude,
            latency=latency,
            latency_errors=latency_errors,
            noise=noise,
            quality=point_quality((recording,), simulated, {Quality.DRIVE_OFF: drive_off}),
            **connection,
        )

    def with_history(self, points: Mapping[str, Array]) -> Self:
        return self.model_copy(update=ConnectionLimits.of(self).expected(points))

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        measured = _CheckMeasurements.from_points(list(points))
        if measured is None:
            return ()
        return (
            EstimatedQuantity.listed("static_gain_above_rest", *measured.above, SOURCE),
            EstimatedQuantity.listed("static_gain_below_rest", *measured.below, SOURCE),
            EstimatedQuantity.listed("bench_latency", measured.sine.latency, measured.sine.latency_errors, SOURCE),
            EstimatedQuantity.listed("noise_floor", measured.rest.noise, 0.0, SOURCE),
        )

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        """Return the table; if recordings are missing, only their number."""
        measured = _CheckMeasurements.from_points(points)
        if measured is None:
            remedy = "look at the recordings without a point, and check again"
            return (_limit("recordings with a point", float(len(points)), "1", RECORDINGS, None, remedy),)
        rest, sine = measured.rest, measured.sine
        cable = "check the cable from the generator to the amplifier and to the card's drive channel"
        optics = "check the sensor's distance and wiring, that its output is not stuck, [sensor] in the bench file, and that high voltage is on"
        worst = max(points, key=lambda p: abs(p.drive - p.commanded))
        flagged = sum(bool(Quality(p.quality) & (Quality.OUT_OF_RANGE | Quality.CLIPPED)) for p in points)
        gains = [abs(measured.above[0]), abs(measured.below[0])]
        agreed = measured.above[0] * measured.below[0] > 0 and self.polarity * measured.above[0] >= 0
        moves = min(gains) >= self.gain_low_m_per_v  # without motion there is no polarity, ratio or latency
        limit = self.drive_limit_v
        return (
            _limit("rest, read back", rest.drive, "V", rest.commanded - limit, rest.commanded + limit, cable),
            _limit("drive read back - commanded, worst", worst.drive - worst.commanded, "V", -limit, limit, cable),
            _limit("sine read back / commanded", sine.drive_amplitude / sine.commanded_amplitude, "1", 0.95, 1.05, cable),
            _limit("drive noise", rest.drive_noise, "V", None, self.drive_noise_limit_v, f"{cable}; check for a loose shield"),
            _limit(
                "clock difference", sine.frequency / sine.commanded_frequency - 1, "1", -self.frequency_limit,
                self.frequency_limit, "compare the generator's reference clock with the card's",
            ),
            _limit("recordings out of range", float(flagged), "1", None, 0.0, "move the sensor until its target is in range"),
            _limit("noise floor", rest.noise, "m", None, self.noise_limit_m, "check for vibration, light, a loose shield"),
            _limit(
                "polarity (1 right, -1 wrong)", (1.0 if agreed else -1.0) if moves else math.nan, "1", 1.0, None,
                "swap the sign of the bench's gain of the sensor, or the tactor's wires with high voltage off" if moves else optics,
            ),
            _limit("gain above rest", gains[0], "m/V", self.gain_low_m_per_v, self.gain_high_m_per_v, optics),
            _limit("gain below rest", gains[1], "m/V", self.gain_low_m_per_v, self.gain_high_m_per_v, optics),
            _limit(
                "gain above / below", gains[0] / gains[1] if moves else math.nan, "1", self.slopes_low,
                self.slopes_high, "check the amplifier's range, and its slopes on the page Bench" if moves else optics,
            ),
            *self._connection_checks(sine),
            _limit(
                "latency beyond the sensor's", sine.latency if moves else math.nan, "s", -0.2 * self.latency_limit_s, self.latency_limit_s,
                "check the sensor's averaging, and its delay on the page Bench" if moves else optics,
            ),
        )  # fmt: skip

    def _connection_checks(self, sine: WiringPoint) -> tuple[CheckResult, ...]:
        """Return the checks of the specimen's connection; none for a bench without current and charge."""
        if math.isnan(sine.capacitance):
            return ()
        return Connection(sine.capacitance, sine.loss, sine.bending, sine.bending_errors).checks(
            ConnectionLimits.of(self)
        )

    def _drives(self, rest_v: float) -> tuple[tuple[str, Drive], ...]:
        hold_s = self.wait_s + self._record_duration_s + 1.0
        cycles = math.ceil(hold_s * self.frequency_hz)
        return (
            ("rest", Hold(rest_v, hold_s)),
            ("above rest", Hold(rest_v + self.level_v, hold_s)),
            ("below rest", Hold(rest_v - self.level_v, hold_s)),
            ("sine", Sine(self.frequency_hz, self.level_v, rest_v, cycles)),
        )

    @property
    def _record_duration_s(self) -> float:
        """Whole cycles of the sine."""
        return math.ceil(self.record_s * self.frequency_hz) / self.frequency_hz


@dataclass(frozen=True, slots=True)
class _CheckMeasurements:
    """The recordings by purpose, and displacement per volt on either side with its standard error."""

    rest: WiringPoint
    sine: WiringPoint
    above: tuple[float, float]
    below: tuple[float, float]

    @classmethod
    def from_points(cls, points: Sequence[Any]) -> "_CheckMeasurements | None":
        if len(points) < RECORDINGS:
            return None
        rest, above, below, sine = points[:RECORDINGS]
        gains = []
        for point in (above, below):
            step_v = point.drive - rest.drive
            error = math.hypot(point.displacement_errors, rest.displacement_errors)
            gains.append(
                ((point.displacement - rest.displacement) / step_v, error / abs(step_v)) if step_v else (math.nan,) * 2
            )
        return cls(rest, sine, *gains)
