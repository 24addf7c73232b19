"""Frequency response as a series, with a check that there is a response at all."""

import numpy as np

from model import Array, Complex
from protocols.base import Series, SeriesAxis
from protocols.signals import FrequencyResponse

FREQUENCY_RESPONSE = "frequency response"
"""Name of the series."""

MIN_RESPONSE_SIGMAS = 5.0
"""A response with weaker lines counts as no response."""

ModeLine = tuple[Array, Complex]
"""Frequencies of the lines to which a mode was fitted, Hz, and the fit there."""


def frequency_response_series(response: FrequencyResponse, label: str = "", mode: ModeLine | None = None) -> Series:
    """Return the response with errors, coherence and the fitted mode."""
    fitted = None
    if mode is not None:
        fitted = np.full(response.frequency_hz.size, np.nan)
        lines_hz, line = mode
        fitted[(response.frequency_hz >= lines_hz[0]) & (response.frequency_hz <= lines_hz[-1])] = np.abs(line)
    return Series(
        response.frequency_hz,
        response.response,
        response.standard_error,
        fit=fitted,
        fit_description="one mode fitted around the peak, modulus",
        coherence=response.coherence,
        x_axis=SeriesAxis("frequency", "Hz", "frequency"),
        y_axis=SeriesAxis("response", "m/V", "displacement per volt at the amplifier's input, modulus"),
        name=FREQUENCY_RESPONSE,
        label=label,
    )


def check_response_present(response: FrequencyResponse) -> None:
    """Reject a response that is noise.

    Raises:
        ValueError: hardly a line exceeds its own error.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = np.nan_to_num(response.modulus / response.standard_error)
    if float(np.percentile(seen, 90)) < MIN_RESPONSE_SIGMAS:
        raise ValueError(
            f"no response: nine tenths of the lines lie within {MIN_RESPONSE_SIGMAS:g} standard errors of nothing. Check that the "
            "amplifier's high voltage is on and the laser meets the tactor"
        )
