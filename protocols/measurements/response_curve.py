"""Frequency response as a result curve, with a check that there is a response at all."""

import numpy as np

from model import Array, Complex
from protocols.base import CurveColumn, ResultCurve
from protocols.signals import FrequencyResponse

MIN_RESPONSE_SIGMAS = 5.0
"""A response with weaker lines counts as no response."""

ModeLine = tuple[Array, Complex]
"""Frequencies of the lines to which a mode was fitted, Hz, and the fit there."""


def frequency_response_curve(response: FrequencyResponse, label: str = "", mode: ModeLine | None = None) -> ResultCurve:
    """Modulus, its error, phase and coherence over frequency, and the fitted mode: what any reader can draw."""
    columns = {}
    if mode is not None:
        fitted = np.full(response.frequency_hz.size, np.nan)
        lines_hz, line = mode
        fitted[(response.frequency_hz >= lines_hz[0]) & (response.frequency_hz <= lines_hz[-1])] = np.abs(line)
        columns = {"response_fit": CurveColumn(fitted, "m/V", "one mode fitted around the peak, modulus")}
    return ResultCurve(
        name="frequency response",
        label=label,
        x="frequency",
        y="response",
        columns={
            "frequency": CurveColumn(response.frequency_hz, "Hz", "frequency"),
            "response": CurveColumn(response.modulus, "m/V", "displacement per volt at the amplifier's input, modulus"),
            "response_errors": CurveColumn(response.standard_error, "m/V", "standard error of the modulus"),
            "phase": CurveColumn(response.phase, "rad", "phase against the recorded drive, delay removed"),
            "coherence": CurveColumn(
                response.coherence, "1", "share of the displacement's power that follows the drive"
            ),
            **columns,
        },
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
