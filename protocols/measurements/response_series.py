"""Frequency response as a series to show and store, with a check that there is a response."""

from dataclasses import fields

import numpy as np

from protocols.base import Series
from protocols.signals import FrequencyResponse, ModalFit

MIN_RESPONSE_SIGMAS = 5.0
"""Smallest median ratio of a line to its error for a response."""


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
