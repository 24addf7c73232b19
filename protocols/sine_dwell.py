"""Sine dwell: one frequency at a time, settled, whole cycles (paper, Sec. IV-3).

Each point carries the paper's amplitude, max - min, beside the fundamental of a least-squares sine fit: the
amplifier's two slopes make harmonics, and near half the resonance the two differ by a fifth.
"""

import math
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from drivers.drive import Sine
from protocols.protocol import Protocol
from protocols.quality import Quality
from protocols.signals import SettlingDetector, fit_frequency, fit_sine
from protocols.steps import Record, Settle, Step
from protocols.values import Estimate, Planned, Recording

HARMONICS = 8
"""Components fitted; under a sine the amplifier gives 2, 4, 6, ... with 21, 4, 2, ... % of the fundamental."""

SAMPLES_A_CYCLE = 20
"""Least samples in a cycle: what the paper has at 250 Hz and 5 kS/s."""

PAPER_FREQUENCIES_HZ = (25, 50, 75, 100, 125, 150, 155, 160, 165, 170, 175, 180, 185, 190, 195, 200, 225, 250)


@dataclass(frozen=True, slots=True)
class SinePoint:
    """One frequency of a sine dwell. Uncertainties are standard and statistical; the sensor's gain is common to all."""

    frequency: Annotated[float, Unit("Hz"), "frequency, fitted to the recorded drive"]
    peak_to_peak: Annotated[float, Unit("m"), "max - min of the displacement: the paper's amplitude"]
    peak_to_peak_errors: Annotated[
        float, Unit("m"), "standard uncertainty of max - min: noise widens it, sampling narrows it"
    ]
    fundamental: Annotated[float, Unit("m"), "peak amplitude of the fundamental by least-squares sine fit"]
    fundamental_errors: Annotated[float, Unit("m"), "standard uncertainty of the fundamental"]
    phase: Annotated[float, Unit("rad"), "phase of the fundamental against the recorded drive, sensor delay removed"]
    phase_errors: Annotated[float, Unit("rad"), "standard uncertainty of the phase"]
    thd: Annotated[float, Unit("1"), "total harmonic distortion of the displacement"]
    harmonics: Annotated[tuple[float, ...], Unit("m"), "peak amplitudes of orders 1..8 (NaN beyond the sample rate)"]
    drive_amplitude: Annotated[float, Unit("V"), "peak amplitude of the recorded drive at the amplifier's input"]
    drive_offset: Annotated[float, Unit("V"), "mean of the recorded drive"]
    offset: Annotated[float, Unit("m"), "mean displacement"]
    drift: Annotated[float, Unit("m/s"), "slope of the mean displacement"]
    noise: Annotated[float, Unit("m"), "standard deviation of what the fit leaves"]
    cycles: Annotated[float, Unit("1"), "cycles recorded"]
    quality: Annotated[int, Unit("1"), "flags, see protocols.quality"]


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
    sample_rate_hz: Annotated[
        float, Unit("Hz"), Interval(ge=500, le=500_000), "scans per second; a USB-6341 makes 250 kHz of two channels"
    ] = 5000.0

    @model_validator(mode="after")
    def _rate_suffices(self) -> Self:
        highest = max(self.frequencies_hz)
        # Fewer samples a cycle would miss the extremes, and fold the amplifier's harmonics onto the fundamental.
        if self.sample_rate_hz < SAMPLES_A_CYCLE * highest:
            raise ValueError(
                f"sample_rate_hz of {self.sample_rate_hz:g} Hz is too low for a sine of {highest:g} Hz; "
                f"at least {SAMPLES_A_CYCLE * highest:g} Hz is needed"
            )
        return self

    def plan(self, rest_v: float) -> tuple[Planned, ...]:
        return tuple(
            Planned(f"{f:g} Hz", (self._drive(f, rest_v),), 0.4 + 4 * self._window_s(f) + self._record_s(f), (f,))
            for f in self.frequencies_hz
        )

    def measure(self, entry: Planned, rest_v: float) -> Generator[Step, Any, None]:
        (f,) = (float(value) for value in entry.key)
        yield Settle(entry.drives[0], self._window_s(f), self.settle_tolerance, self.settle_limit_s)
        yield Record(self._record_s(f))

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> SinePoint:
        recording = recordings[-1]
        drive = recording.drive
        if not isinstance(drive, Sine):
            raise ValueError(f"a sine dwell cannot use a recording under {type(drive).__name__}")
        rate = recording.rate_hz
        frequency = fit_frequency(recording.drive_v, rate, drive.frequency_hz)
        driven = fit_sine(recording.drive_v, rate, frequency)
        moved = fit_sine(recording.displacement_m, rate, frequency, HARMONICS)
        turn = np.angle(moved.fundamental / driven.fundamental) + 2 * np.pi * frequency * recording.sensor_delay_s
        quality = recording.quality | (Quality.SIMULATED if simulated else Quality.GOOD)
        if abs(abs(driven.fundamental) - drive.amplitude_v) > SettlingDetector.DRIVE_TOLERANCE * drive.amplitude_v:
            quality |= Quality.DRIVE_OFF
        n = len(recording.displacement_m)
        harmonics = np.full(HARMONICS, np.nan)
        harmonics[: len(moved.components)] = np.abs(moved.components)
        return SinePoint(
            frequency=frequency,
            peak_to_peak=float(np.ptp(recording.displacement_m)),
            # The extremes of n noisy samples lie up to sigma sqrt(2 ln n) outside on either side, and up to half a
            # sample beside the true extremes; both taken as rectangular.
            peak_to_peak_errors=2
            * math.hypot(
                moved.noise * math.sqrt(2 * math.log(n)),
                abs(moved.fundamental) * (1 - math.cos(math.pi * frequency / rate)),
            )
            / math.sqrt(3),
            fundamental=abs(moved.fundamental),
            fundamental_errors=moved.standard_error,
            phase=float(np.angle(np.exp(1j * turn))),
            phase_errors=moved.standard_error / abs(moved.fundamental),
            thd=moved.thd,
            harmonics=tuple(harmonics.tolist()),
            drive_amplitude=abs(driven.fundamental),
            drive_offset=driven.offset,
            offset=moved.offset,
            drift=moved.drift_per_s,
            noise=moved.noise,
            cycles=n * frequency / rate,
            quality=int(quality),
        )

    def estimates(self, points: Iterable[Any]) -> tuple[Estimate, ...]:
        from protocols.resonance import fit_resonance

        return fit_resonance([p for p in points if Quality(p.quality).usable])

    def _drive(self, frequency_hz: float, rest_v: float) -> Sine:
        # Long enough for the worst case, finite so that a generator left alone comes to rest.
        longest_s = self.settle_limit_s + self._record_s(frequency_hz) + 3.0
        cycles = math.ceil(longest_s * frequency_hz)
        return Sine(float(frequency_hz), self.peak_to_peak_v / 2, rest_v, cycles)

    def _window_s(self, frequency_hz: float) -> float:
        return max(2, math.ceil(0.04 * frequency_hz)) / frequency_hz

    def _record_s(self, frequency_hz: float) -> float:
        return max(self.min_cycles, math.ceil(self.record_s * frequency_hz)) / frequency_hz
