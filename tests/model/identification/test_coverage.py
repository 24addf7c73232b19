"""Coverage of the standard errors; a small version of benchmarks/coverage/fit.py, without mass resonances."""

import numpy as np
import pytest

from benchmarks.campaigns import SHARED, Noise, World, perfect
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import MassResonanceObservation, ObservationSet
from tests.helpers.model.redrawn import resample

TRUE = {"k2": 7e-3, "mu": -1.33e-5, "m_add": 7.73e-3, "c0": 159.0, "E_m": 6.95e6, "c_s_0": 165.0, "c_s_delta": 5.48e4}
CAMPAIGNS = 25


@pytest.mark.deep
def test_campaigns_miss_the_truth_by_their_standard_errors() -> None:
    """Mean within 3.3 of its own error (0.2), spread within 3.3 of its (0.14)."""
    source = perfect(World(), Noise(), SHARED)
    source = ObservationSet(tuple(r for r in source.runs if not isinstance(r, MassResonanceObservation)))
    z = []
    for seed in range(CAMPAIGNS):
        fit = joint_fit(resample(source, np.random.default_rng((7, seed)))[0], FitOptions(n=10))
        z.append([(e.value - TRUE[e.name]) / e.standard_error for e in fit.estimates()])
        assert fit.error_scale == 1
    table = np.array(z)
    assert table.shape == (CAMPAIGNS, len(TRUE))
    assert np.abs(table.mean(0)).max() < 0.66
    assert 0.53 < table.std(0).min() <= table.std(0).max() < 1.47
    assert 0.90 < np.mean(np.abs(table) < 1.96) < 0.99
