"""Displacement from a vibrometer's velocity: integration of periodic responses in closed form, with its errors.

Integration divides a component at f by 2 pi i f. Components are divided after their fit, in place of samples: white noise of a
velocity is not white in its integral, whose samples would have too small errors at low frequencies, and whose mean is unknown. A high
pass of first order in the vibrometer, 1 / (1 - i fc / f), is removed too; its corner is uncertain.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from model import Array, Complex
from protocols.base import Recording
from protocols.signals.interference import remove_lines
from protocols.signals.response import FrequencyResponse
from protocols.signals.sine import fit_sine, line_samples

CORNER_RELATIVE_UNCERTAINTY = 0.2
"""Standard uncertainty of the corner of a vibrometer's high pass, relative; data sheets state a nominal one."""

WAVEFORM_HARMONICS = 16
"""Number of integrated components of a periodic velocity; of higher ones, integration leaves hundredths of a percent."""


def integral_factor(frequency_hz: Array, corner_hz: float) -> Complex:
    """Return displacement over the output of a vibrometer at frequencies above 0, in seconds."""
    f = np.asarray(frequency_hz, float)
    return np.asarray((1 - 1j * corner_hz / f) / (2j * np.pi * f))


def corner_errors(frequency_hz: float, corner_hz: float) -> tuple[float, float]:
    """Return the standard uncertainties by the corner at a frequency: of the amplitude, relative, and of the phase in radians."""
    r = corner_hz / frequency_hz
    return CORNER_RELATIVE_UNCERTAINTY * r * r / (1 + r * r), CORNER_RELATIVE_UNCERTAINTY * r / (1 + r * r)


def displacement_under_sine(recording: Recording, frequency_hz: float) -> tuple[Array, Mapping[int, float]]:
    """Return the displacement of a recording under a sine without separable interference, and the inseparable one by order, in metres.

    The displacement by a velocity has its integrated harmonics, no mean, and as white noise the noise of the fundamental.
    """
    rate_hz = recording.rate_hz
    samples, coincident = remove_lines(recording.displacement_m, rate_hz, frequency_hz, recording.interference)
    if (corner_hz := recording.velocity_corner_hz) is None:
        return samples, coincident
    moved = fit_sine(samples, rate_hz, frequency_hz, WAVEFORM_HARMONICS)
    f, n = moved.frequencies_hz, samples.size
    residual = samples - line_samples(moved.components, f, n, rate_hz) - moved.offset
    residual -= moved.drift_per_s / rate_hz * (np.arange(n) - 0.5 * (n - 1))
    factors = integral_factor(f, corner_hz)
    integrated = line_samples(moved.components * factors, f, n, rate_hz) + residual * abs(factors[0])
    sizes = np.abs(integral_factor(frequency_hz * np.array([*coincident, 1]), corner_hz))
    return integrated, {
        order: size * float(each) for (order, size), each in zip(coincident.items(), sizes, strict=False)
    }


def integrated_response(response: FrequencyResponse, corner_hz: float | None) -> FrequencyResponse:
    """Return the response of the displacement from the response of a velocity; unchanged without a corner: of a displacement."""
    if corner_hz is None:
        return response
    factor, r = integral_factor(response.x, corner_hz), corner_hz / response.x
    y = response.y * factor
    corner = CORNER_RELATIVE_UNCERTAINTY * np.abs(y) * r / np.sqrt(1 + r * r) / math.sqrt(2)
    return replace(response, y=y, errors=np.hypot(response.errors * np.abs(factor), corner))
