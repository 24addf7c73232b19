"""Accepted calibration for tests."""

from collections.abc import Mapping

import numpy as np

from model.identification.calibration import Calibration
from model.identification.fit_options import FitOptions
from model.quantities import EstimatedQuantity


def calibration(version: int, found: Mapping[str, tuple[float, float]]) -> Calibration:
    """Of specimen T7, with a value and a standard error for each name, and the paper's values for the rest."""
    estimates = tuple(EstimatedQuantity(name, value, error, "1", ("run",)) for name, (value, error) in found.items())
    covariance = np.diag([error**2 for _, error in found.values()])
    return Calibration(
        specimen="T7",
        version=version,
        estimates=estimates,
        covariance=tuple(map(tuple, covariance.tolist())),
        method="joint",
        runs=("run",),
        code="0.1.0",
        accepted_at="2026-11-21T12:00:00+00:00",
        accepted_by="somebody",
        simulated=True,
        fixed=FitOptions().base_values(),
    )
