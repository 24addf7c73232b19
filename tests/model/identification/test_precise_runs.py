"""Joint fit of runs that are precise to a part in a hundred thousand: the minimum is found from Table I."""

from dataclasses import replace

import numpy as np
import pytest

from app.identification import SpecimenSheet
from model.identification.fit_options import FitOptions
from model.identification.forward_model import with_predictions
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import MassResonanceObservation, Observation, ObservationSet
from model.identification.residuals import LeastSquaresProblem
from tests.helpers.laboratory import Laboratory, measure

TRUTH = {
    "L": 22.4e-3, "L1": 7.7e-3, "L2": 15.3e-3, "h_Al": 0.212e-3, "rho1": 1.15e-2, "rho2": 2.46e-2, "k2": 7.9e-3, "mu": -1.2e-5, "c0": 190.0,
    "creep": 0.02, "hysteresis": 0.12, "asymmetry": 0.03, "mass_fraction": 0.7, "elongation_slip": 0.01, "gain_below_rest": -0.006,
}  # fmt: skip


def precise(run: Observation) -> Observation:
    """Return the run with errors of a thousandth."""
    name = "errors_hz" if isinstance(run, MassResonanceObservation) else "errors_m"
    return replace(run, **{name: getattr(run, name) / 1000})


@pytest.mark.deep
def test_the_minimum_of_precise_runs_is_found_from_table_one() -> None:
    runs = ObservationSet(tuple(map(precise, measure(Laboratory(), 1).runs)))
    options = SpecimenSheet().fit_options(FitOptions(n=7), runs)
    problem = LeastSquaresProblem(runs, options)
    truth = np.array([TRUTH.get(name, start) for name, start in zip(problem.names, problem.start, strict=True)])
    exact = with_predictions(runs, problem.forward_model, truth)
    fit = joint_fit(exact, options, max_starts=1)
    at_truth = LeastSquaresProblem(exact, options).evaluate(truth)[0]
    assert fit.converged
    assert fit.cost <= at_truth @ at_truth + 1e-3
    errors = np.sqrt(np.diag(fit.covariance))
    z = dict(zip(fit.names, (fit.theta - truth) / errors, strict=True))
    assert max(abs(z[name]) for name in fit.free_parameters) < 2.5, z
