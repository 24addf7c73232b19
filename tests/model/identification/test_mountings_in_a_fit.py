"""Differences between mountings in a fit: found with honest errors, and none where each part was mounted once.

The data come from the closed form, which shares nothing with the model of the fit.
"""

from dataclasses import replace

import numpy as np
import pytest

from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import FrequencyResponseObservation, ObservationSet
from model.identification.priors.mountings import (
    mounting_differences,
    mounting_repeatabilities,
    unrecorded_parts,
    with_mountings,
)
from model.identification.uncertainty_budget import uncertainty_budget
from model.parameters import Tactor
from model.response.closed_form import exact_response

T = Tactor()
FREQUENCIES = np.array([60.0, 100.0, 130.0, 150.0, 165.0, 180.0, 210.0])
NOISE_M = 1e-7
OPTIONS = FitOptions(free=("mu", "m_add", "c0"), n=20)


def dwells(rng: np.random.Generator, masses_kg: np.ndarray, scales: np.ndarray) -> ObservationSet:
    """Two dwells under each mass, which was glued anew together with a new place of the laser."""
    runs = []
    for number, (mass_kg, scale) in enumerate(zip(masses_kg, scales, strict=True)):
        for repeat in range(2):
            y = 1000 * (1 + scale) * exact_response(replace(T, m_add=mass_kg), FREQUENCIES)
            y = y + NOISE_M * (rng.standard_normal(y.size) + 1j * rng.standard_normal(y.size))
            mounted = {
                "mass": f"2026-03-0{number + 1}T09:00:00+00:00",
                "laser": f"2026-03-0{number + 1}T08:00:00+00:00",
            }
            runs.append(
                FrequencyResponseObservation(
                    f"{number} {repeat}", FREQUENCIES, y, np.full(y.size, NOISE_M), mountings=mounted
                )
            )
    return ObservationSet(tuple(runs))


@pytest.mark.deep
def test_differences_and_their_errors_hold_over_many_draws() -> None:
    z, chi_squares, found, expected = [], [], [], 1e-4
    for seed in range(12):
        rng = np.random.default_rng(seed)
        masses, scales = T.m_add + expected * rng.standard_normal(4), 2e-3 * rng.standard_normal(4)
        fit = joint_fit(with_mountings(dwells(rng, masses, scales), {"mass": expected}), OPTIONS)
        rows = {(d.part, d.time[9]): d for d in mounting_differences(fit)}
        for number in range(3):
            mass, laser = rows["mass", str(number + 1)], rows["laser", str(number + 1)]
            z.append((mass.value - (masses[number] - masses[3])) / mass.standard_error)
            true = (1 + scales[number]) / (1 + scales[3]) - 1
            z.append((laser.value - true) / laser.standard_error)
        at = fit.names.index("m_add")
        z.append((fit.theta[at] - masses[3]) / fit.enlarged_covariance[at, at] ** 0.5)
        chi_squares.append(fit.chi_square / fit.degrees_of_freedom)
        found.append(next(each.found for each in mounting_repeatabilities(fit) if each.part == "mass"))
    assert 0.8 < np.std(z) < 1.25
    assert abs(np.mean(z)) < 0.35
    assert np.mean(chi_squares) == pytest.approx(1.0, abs=0.15)
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(expected, rel=0.35)  # 36 degrees of freedom: 12 %
    assert uncertainty_budget(fit).sources == ("noise", "mountings of the mass", "mountings of the laser")


def test_without_the_differences_the_same_runs_contradict_the_model() -> None:
    rng = np.random.default_rng(1)
    observations = dwells(rng, T.m_add + np.array([0.0, 1e-4, -1e-4]), np.zeros(3))
    plain, own = joint_fit(observations, OPTIONS), joint_fit(with_mountings(observations, {}), OPTIONS)
    assert plain.chi_square > 100 * plain.degrees_of_freedom
    assert own.chi_square < 1.6 * own.degrees_of_freedom


def test_mountings_that_differ_by_more_than_was_stated_are_contradicted() -> None:
    rng = np.random.default_rng(2)
    observations = dwells(rng, T.m_add + np.array([0.0, 1e-4, -1e-4]), np.zeros(3))
    judged = {
        size: mounting_repeatabilities(joint_fit(with_mountings(observations, {"mass": size}), OPTIONS))[0]
        for size in (1e-4, 1e-5)
    }
    assert not judged[1e-4].is_contradicted
    assert judged[1e-5].is_contradicted
    assert judged[1e-5].expected == pytest.approx(1e-5)


def test_a_part_that_was_mounted_once_adds_no_parameter() -> None:
    observations = dwells(np.random.default_rng(3), np.array([T.m_add]), np.zeros(1))
    assert with_mountings(observations, {}) is observations
    assert list(unrecorded_parts(observations)) == ["plate"]
    fit = joint_fit(observations, OPTIONS)
    assert mounting_differences(fit) == ()
    assert mounting_repeatabilities(fit) == ()
