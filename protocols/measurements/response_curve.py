"""A frequency response as a curve of the run file, and whether there is any response in it at all."""

import numpy as np

from protocols.base.records import Column, Curve
from protocols.signals.response import FrequencyResponse

SEEN_SIGMAS = 5.0
"""A response whose strongest lines stand out by less than this is none."""


def response_curve(response: FrequencyResponse, label: str = "") -> Curve:
    """Modulus, its error, phase and coherence over frequency: what any reader can draw."""
    return Curve(
        name="frequency response",
        label=label,
        x="frequency",
        y="response",
        columns={
            "frequency": Column(response.frequency_hz, "Hz", "frequency"),
            "response": Column(response.modulus, "m/V", "displacement per volt at the amplifier's input, modulus"),
            "response_errors": Column(response.standard_error, "m/V", "standard error of the modulus"),
            "phase": Column(response.phase, "rad", "phase against the recorded drive, delay removed"),
            "coherence": Column(response.coherence, "1", "share of the displacement's power that follows the drive"),
        },
    )


def must_respond(response: FrequencyResponse) -> None:
    """Refuse to find a resonance in noise.

    Raises:
        ValueError: hardly a line stands out of its own error.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = np.nan_to_num(response.modulus / response.standard_error)
    if float(np.percentile(seen, 90)) < SEEN_SIGMAS:
        raise ValueError(
            f"no response: nine tenths of the lines lie within {SEEN_SIGMAS:g} standard errors of nothing. Check that the "
            "amplifier's high voltage is on and the laser meets the tactor"
        )
