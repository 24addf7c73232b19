"""Frequency response from sines at single frequencies, the frequencies that resolve its peak, and responses as series."""

import math
from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from model import Complex
from protocols.base import Recording, Series
from protocols.signals import FrequencyResponse, ModalFit, displacement_under_sine, fit_frequency, fit_sine

HARMONIC_COUNT = 8
"""Components fitted to the displacement, so that the amplifier's harmonics do not disturb the fundamental."""

LINES_IN_PEAK = 13
"""Required frequencies within the half-power width, the range of the peak's fit."""

MIN_RESPONSE_SIGMAS = 5.0
"""Smallest median ratio of a line to its error for a response."""

FINEST = 1e-3
"""Smallest distance of two frequencies, as a share of them."""


def coarse_frequencies(low_hz: float, high_hz: float, count: int) -> tuple[float, ...]:
    """Return frequencies at equal ratios over a band."""
    return tuple(round(f, 2) for f in np.geomspace(low_hz, high_hz, count).tolist())


def next_frequencies(frequencies_hz: Sequence[float], responses: Sequence[float]) -> tuple[float, ...]:
    """Return the middles of the gaps within the half-power width of the largest response; none if it has enough frequencies."""
    order = np.argsort(frequencies_hz)
    f, height = np.asarray(frequencies_hz)[order], np.asarray(responses)[order]
    top = int(height.argmax())
    below = height < height[top] / math.sqrt(2)
    before, after = np.flatnonzero(below[:top]), np.flatnonzero(below[top:])
    first, last = (int(before[-1]) if before.size else 0), (top + int(after[0]) if after.size else f.size - 1)
    if last - first - 1 >= LINES_IN_PEAK:
        return ()
    gaps = zip(f[first:last].tolist(), f[first + 1 : last + 1].tolist(), strict=True)
    return tuple(round(0.5 * (low + high), 3) for low, high in gaps if high - low > 2 * FINEST * high)


def dwelt_response(recordings: Sequence[Recording]) -> FrequencyResponse:
    """Return the response at the frequency of each recording's sine, against the recorded drive, delay removed.

    The coherence is of one average with this standard error.

    Raises:
        ValueError: fewer than two recordings, or a recording is too short.
    """
    lines = sorted((_line(recording) for recording in recordings), key=lambda line: line[0])
    if len(lines) < 2:
        raise ValueError(f"{len(lines)} frequency gives no response: at least two are needed")
    f, real, imaginary, errors = (np.array(column) for column in zip(*lines, strict=True))
    response: Complex = real + 1j * imaginary
    with np.errstate(divide="ignore"):
        noise_share = 2 * (errors / np.abs(response)) ** 2
    return FrequencyResponse(
        f,
        response,
        errors=errors,
        coherence=1 / (1 + noise_share),
        degrees_of_freedom=float(min(recording.drive_v.size for recording in recordings)),
        resolution_hz=float(np.diff(f).min()),
    )


def _line(recording: Recording) -> tuple[float, float, float, float]:
    """Frequency in hertz, real and imaginary part of the response and their standard error."""
    rate = recording.rate_hz
    frequency = fit_frequency(recording.drive_v, rate, getattr(recording.drive, "frequency_hz", math.nan))
    driven = fit_sine(recording.drive_v, rate, frequency)
    clean, coincident = displacement_under_sine(recording, frequency)
    moved = fit_sine(clean, rate, frequency, HARMONIC_COUNT)
    turned = np.exp(2j * np.pi * frequency * recording.sensor_delay_s)
    response = complex(moved.fundamental / driven.fundamental * turned)
    drive_v = abs(driven.fundamental)
    moved_error = math.hypot(moved.standard_error, coincident.get(1, 0.0) / math.sqrt(2))
    error = math.hypot(moved_error / drive_v, abs(response) * driven.standard_error / drive_v)
    return frequency, response.real, response.imag, error


def with_fitted_mode(response: FrequencyResponse, near: FrequencyResponse, mode: ModalFit | None, label: str) -> Series:
    """Return the response as a series, with the mode fitted to the lines `near` its peak."""
    fitted = None
    if mode is not None:
        fitted = np.full(response.x.size, np.nan)
        fitted[(response.x >= near.x[0]) & (response.x <= near.x[-1])] = np.abs(mode.fitted)
    columns = {each.name: getattr(response, each.name) for each in fields(Series)}
    return Series(**columns | {"label": label, "fit": fitted})


def check_response_present(response: FrequencyResponse) -> None:
    """Reject a response that is noise.

    Raises:
        ValueError: hardly a line exceeds its error.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = np.nan_to_num(response.plotted / response.errors)
    if float(np.percentile(seen, 90)) < MIN_RESPONSE_SIGMAS:
        raise ValueError(
            f"no response: nine tenths of the lines lie within {MIN_RESPONSE_SIGMAS:g} standard errors of nothing. Check that the "
            "amplifier's high voltage is on and the laser meets the tactor"
        )
