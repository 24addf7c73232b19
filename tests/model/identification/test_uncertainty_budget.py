"""Uncertainty budget of a fit: independent sources whose squares sum to the squared total uncertainty."""

import numpy as np
import pytest

from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import ObservationSet, SharedError, VoltageStepsObservation
from model.identification.uncertainty_budget import NOISE, uncertainty_budget
from model.parameters import Tactor
from model.response.statics import voltage_gain

LEVELS_V = np.array([0.5, 1.0, 1.5, 3.5, 4.0, 4.5])
SENSOR = SharedError("gain of the laser", "displacement", 0.004)


def steps(scatter: float, rng: np.random.Generator) -> ObservationSet:
    volts = np.where(LEVELS_V > 2.5, 600, 200) * (LEVELS_V - 2.5)
    w = voltage_gain(Tactor().beam) * volts
    errors = np.full(w.size, 1e-6)
    return ObservationSet(
        (VoltageStepsObservation("steps", LEVELS_V, w + scatter * errors * rng.standard_normal(w.size), errors, shared_errors=(SENSOR,)),)
    )  # fmt: skip


def test_the_squares_of_the_sources_sum_to_the_total() -> None:
    priors = {"L": (22e-3, 1e-4), "L1": (8e-3, 1e-4), "k2": (7e-3, 1e-4)}
    fit = joint_fit(steps(1.0, np.random.default_rng(1)), FitOptions(priors=priors))
    budget = uncertainty_budget(fit)
    errors = {e.name: e.standard_error for e in fit.estimates()}
    assert budget.sources == (NOISE, SENSOR.name, "L", "L1", "k2")
    assert budget.total == pytest.approx([errors[name] for name in budget.names], rel=1e-6)
    assert budget.shares.sum(axis=0) == pytest.approx(1)
    assert np.hypot(budget.statistical, budget.systematic) == pytest.approx(budget.total)
    # Eq. 8 is linear in mu, so that the gain acts in full, and k2 as far as it changes the deflection
    mu = budget.names.index("mu")
    share = dict(zip(budget.sources, budget.components[:, mu] / abs(fit.theta[fit.names.index("mu")]), strict=True))
    assert share[SENSOR.name] == pytest.approx(0.004, rel=0.02)
    low, high = (voltage_gain(Tactor(k2=k2).beam) for k2 in (6.9e-3, 7.1e-3))
    assert share["k2"] == pytest.approx(abs(high - low) / (high + low), rel=0.02)


def test_scatter_beyond_the_stated_errors_counts_as_statistical() -> None:
    budgets = [uncertainty_budget(joint_fit(steps(scatter, np.random.default_rng(1)))) for scatter in (1.0, 20.0)]
    quiet, loud = ([float(part[0]) for part in (b.statistical, b.systematic)] for b in budgets)
    assert loud[0] > 8 * quiet[0]
    assert loud[1] == pytest.approx(quiet[1], rel=0.05)
