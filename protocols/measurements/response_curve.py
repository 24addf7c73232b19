"""Frequency response as a result curve, with a check that there is a response at all."""

import numpy as np

from protocols.base import CurveColumn, ResultCurve
from protocols.signals import FrequencyResponse

MIN_RESPONSE_SIGMAS = 5.0
"""A response with weaker lines counts as no response."""


def frequency_response_curve(response: FrequencyResponse, label: str = "") -> ResultCurve:
    """Modulus, its error, phase and coherence over frequency: what any reader can draw."""
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
