"""One frequency of a sine dwell: its point, from one recording or the average of several under the same sine."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Unit

from drivers.drive import Sine
from protocols.quality import Quality
from protocols.signals import SettlingDetector, fit_frequency, fit_sine
from protocols.values import Recording

HARMONICS = 8
"""Components fitted; under a sine the amplifier gives 2, 4, 6, ... with 21, 4, 2, ... % of the fundamental."""

SEEN_SIGMAS = 5.0
"""A fundamental of fewer standard uncertainties than this is no response."""


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

    @property
    def relative_uncertainty(self) -> float:
        """Standard uncertainty of the fundamental over the fundamental."""
        return self.fundamental_errors / self.fundamental if self.fundamental > 0 else math.inf


@dataclass(frozen=True, slots=True)
class _One:
    """What one recording gives. `components` are turned so that the drive has phase 0; (K,), m."""

    frequency: float
    components: np.ndarray
    standard_error: float
    drive_v: float
    drive_offset_v: float
    offset: float
    drift: float
    noise: float
    peak_to_peak: float
    samples: int


def sine_point(recordings: Sequence[Recording], simulated: bool) -> SinePoint:
    """The point of recordings under one sine; several are averaged as vectors, each against its own drive.

    Raises:
        ValueError: a recording was not made under a sine, or is too short for the fit.
    """
    drive, rate = recordings[-1].drive, recordings[-1].rate_hz
    if not isinstance(drive, Sine):
        raise ValueError(f"a sine dwell cannot use a recording under {drive.kind}")
    each = [_one(recording, drive.frequency_hz) for recording in recordings]
    quality = Quality.SIMULATED if simulated else Quality.GOOD
    for recording, one in zip(recordings, each, strict=True):
        quality |= recording.quality
        if abs(one.drive_v - drive.amplitude_v) > SettlingDetector.DRIVE_TOLERANCE * drive.amplitude_v:
            quality |= Quality.DRIVE_OFF
    components = np.mean([one.components for one in each], axis=0)
    fundamental, error = float(abs(components[0])), math.sqrt(sum(one.standard_error**2 for one in each)) / len(each)
    if fundamental < SEEN_SIGMAS * error:
        quality |= Quality.NO_RESPONSE
    frequency = float(np.mean([one.frequency for one in each]))
    noise = math.sqrt(sum(one.noise**2 for one in each) / len(each))
    turn = np.angle(components[0]) + 2 * np.pi * frequency * recordings[-1].sensor_delay_s
    harmonics = np.full(HARMONICS, np.nan)
    harmonics[: len(components)] = np.abs(components)
    return SinePoint(
        frequency=frequency,
        peak_to_peak=float(np.mean([one.peak_to_peak for one in each])),
        # The extremes of n noisy samples lie up to sigma sqrt(2 ln n) outside on either side, and up to half a
        # sample beside the true extremes; both taken as rectangular. Averaging lessens neither.
        peak_to_peak_errors=2
        * math.hypot(
            noise * math.sqrt(2 * math.log(each[-1].samples)), fundamental * (1 - math.cos(math.pi * frequency / rate))
        )
        / math.sqrt(3),
        fundamental=fundamental,
        fundamental_errors=error,
        phase=float(np.angle(np.exp(1j * turn))),
        phase_errors=min(error / fundamental, math.pi / math.sqrt(3)) if fundamental > 0 else math.pi / math.sqrt(3),
        thd=float(np.linalg.norm(components[1:]) / fundamental) if fundamental > 0 else math.nan,
        harmonics=tuple(harmonics.tolist()),
        drive_amplitude=float(np.mean([one.drive_v for one in each])),
        drive_offset=float(np.mean([one.drive_offset_v for one in each])),
        offset=float(np.mean([one.offset for one in each])),
        drift=float(np.mean([one.drift for one in each])),
        noise=noise,
        cycles=sum(one.samples for one in each) * frequency / rate,
        quality=int(quality),
    )


def _one(recording: Recording, frequency_hz: float) -> _One:
    rate = recording.rate_hz
    frequency = fit_frequency(recording.drive_v, rate, frequency_hz)
    driven = fit_sine(recording.drive_v, rate, frequency)
    moved = fit_sine(recording.displacement_m, rate, frequency, HARMONICS)
    orders = np.arange(1, len(moved.components) + 1)
    return _One(
        frequency=frequency,
        components=moved.components * np.exp(-1j * orders * np.angle(driven.fundamental)),
        standard_error=moved.standard_error,
        drive_v=abs(driven.fundamental),
        drive_offset_v=driven.offset,
        offset=moved.offset,
        drift=moved.drift_per_s,
        noise=moved.noise,
        peak_to_peak=float(np.ptp(recording.displacement_m)),
        samples=len(recording.displacement_m),
    )
