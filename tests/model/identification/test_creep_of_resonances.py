"""Resonances with added masses of a specimen that creeps: the peak is lower and, in the measured response, found without bias."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from model import Tactor
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import MassResonanceObservation, ObservationSet
from model.identification.residuals import LeastSquaresProblem
from model.response.closed_form import exact_response
from protocols.signals.peak import response_peak
from protocols.signals.response import FrequencyResponse

CREEP = 0.03
"""A share of the deflection per decade of time."""


def crept(tactor: Tactor, frequency_hz: np.ndarray, creep: float = CREEP) -> np.ndarray:
    """The closed form times the transform of log10(t / t0) per decade, t0 being the time constant of 100 Hz (Euler's integral)."""
    late = (np.log(frequency_hz / 100.0) + np.euler_gamma + 0.5j * np.pi) / np.log(10)
    return exact_response(tactor, frequency_hz) * (1 - creep * late)


def peak_hz(tactor: Tactor, creep: float = CREEP) -> float:
    found = minimize_scalar(
        lambda f: -abs(crept(tactor, np.array([f]), creep)[0]),
        bounds=(100, 300),
        method="bounded",
        options={"xatol": 1e-6},
    )
    return float(found.x)


def resonances(masses_kg: np.ndarray) -> MassResonanceObservation:
    f = np.array([peak_hz(Tactor(m_add=float(m))) for m in masses_kg])
    return MassResonanceObservation("masses", masses_kg, f, np.full(f.size, 0.01), meaning="peak")


def test_creep_lowers_the_resonances_as_the_closed_form_has_it() -> None:
    run = resonances(np.array([1.75e-3, 5.75e-3, 9.75e-3]))
    problem = LeastSquaresProblem(ObservationSet((run,)), FitOptions(free=("k2",), fixed={"creep": CREEP}, n=40))
    (predicted,) = problem.forward_model.predict(problem.start)
    assert predicted.values == pytest.approx(run.frequency_hz, abs=2e-3)
    assert peak_hz(Tactor(m_add=1.75e-3), 0.0) - run.frequency_hz[0] > 0.9


def test_resonances_of_a_crept_specimen_identify_its_stiffness() -> None:
    run = resonances(np.linspace(1.75e-3, 9.75e-3, 9))
    fit = joint_fit(ObservationSet((run,)), FitOptions(free=("k2", "c0", "creep"), n=20))
    values = dict(zip(fit.names, fit.theta, strict=True))
    assert values["k2"] == pytest.approx(Tactor().k2, rel=2e-3)
    assert values["c0"] == pytest.approx(Tactor().c0, rel=1e-2)


@pytest.mark.parametrize("grams", [1.75, 9.75])
def test_a_measured_peak_of_a_crept_response_has_no_bias(grams: float) -> None:
    tactor = Tactor(m_add=1e-3 * grams)
    f = np.arange(125.0, 500.0, 0.5)
    lines = FrequencyResponse(
        f,
        crept(tactor, f),
        errors=np.full(f.size, 1e-9),
        coherence=np.ones(f.size),
        degrees_of_freedom=100.0,
        resolution_hz=0.5,
        correlation=0.1,
    )
    assert response_peak(lines).frequency_hz == pytest.approx(peak_hz(tactor), abs=1e-3)
