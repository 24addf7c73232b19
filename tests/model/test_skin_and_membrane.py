"""Skin stiffness, continuous at zero pre-stretch; sag of the membrane between its two limits."""

import numpy as np
import pytest

from model.membrane import _g, point_stiffness, sag, skin
from model.parameters import Membrane, Tactor

M = Membrane()


def k_point(delta: object) -> np.ndarray:
    return point_stiffness(M.L_m, M.b_m, M.h_m, M.E_m, delta)


def test_stiffness_is_smooth_down_to_no_pre_stretch() -> None:
    assert k_point(0.0) == pytest.approx(192 * M.E_m * M.b_m * M.h_m**3 / 12 / M.L_m**3)
    delta = np.logspace(-12, 0, 4000)
    k = k_point(delta)
    assert (np.diff(k) > -1e-12 * k[1:]).all()
    assert abs(np.diff(np.log(k), 2)).max() < 3e-4


@pytest.mark.parametrize("delta", [1e-8, 1e-6, 9e-7, 1.2e-6, 1e-4, 0.05])
def test_stiffness_solves_the_tensioned_beam(delta: float) -> None:
    """E I w'''' - T w'' = 0 on the left half, clamped, level at the centre, half a newton of shear: by a linear solve."""
    I_m = M.b_m * M.h_m**3 / 12
    T, s = M.E_m * M.b_m * M.h_m * delta, M.L_m / 2
    lam = np.sqrt(T / (M.E_m * I_m))
    a = lam * s
    # w = c0 + c1 x + c2 exp(-lam x) + c3 exp(-lam (s - x)), written with decaying exponentials
    A = np.array([[1, 0, 1, np.exp(-a)], [0, 1, -lam, lam * np.exp(-a)], [0, 1, -lam * np.exp(-a), lam], [0, T, 0, 0]])
    scale = abs(A).max(axis=0)
    c = np.linalg.solve(A / scale, [0, 0, 0, 0.5]) / scale
    centre = c @ [1, s, np.exp(-a), 1]
    assert k_point(delta) == pytest.approx(1 / centre, rel=1e-3 if delta < 1e-5 else 1e-8)


def test_membrane_of_another_tactor_is_spread_over_its_contact() -> None:
    wide = Tactor(L2=1.1e-2)
    assert skin(M, 0.01, tactor=wide).k_s == pytest.approx(skin(M, 0.01, contact_length=1.1e-2).k_s)


@pytest.mark.deep
def test_sag_solves_the_stretched_beam_by_finite_differences() -> None:
    """Clamped-clamped E I w'''' - T w'' = q on a grid, the tension closed by its own stretch."""
    q, n = 0.906, 400
    h, EI, EA = M.L_m / n, M.E_m * M.b_m * M.h_m**3 / 12, M.E_m * M.b_m * M.h_m
    D2 = (np.diag(-2.0 * np.ones(n + 1)) + np.diag(np.ones(n), 1) + np.diag(np.ones(n), -1)) / h**2
    D4 = D2 @ D2
    D4[1, 1] += 1 / h**4  # the mirrored point beyond the clamp
    D4[-2, -2] += 1 / h**4
    T = 0.5
    for _ in range(60):
        w = np.zeros(n + 1)
        inner = slice(1, n)
        w[inner] = np.linalg.solve((EI * D4 - T * D2)[inner, inner], np.full(n - 1, q))
        T = 0.5 * T + 0.5 * EA * ((np.diff(w) / h) ** 2).sum() * h / (2 * M.L_m)
    got = sag(M, q)
    assert got.centre_m == pytest.approx(w.max(), rel=2e-3)
    assert got.tension_n == pytest.approx(T, rel=2e-3)


def test_linear_limit_of_the_sag() -> None:
    """A light load or a thick membrane bends only."""
    light = sag(M, 1e-4)
    assert light.centre_m == pytest.approx(light.linear_theory_m, rel=1e-3)
    EI = M.E_m * M.b_m * M.h_m**3 / 12
    assert light.linear_theory_m == pytest.approx(1e-4 * M.L_m**4 / (384 * EI))
    assert sag(M, 0.0).centre_m == 0


def test_membrane_limit_of_the_sag() -> None:
    """A heavy load on a thin membrane only stretches: w^3 = 3 q L^4 / (64 E A), a parabola's."""
    thin = Membrane(h_m=1e-5)
    got = sag(thin, 1.0)
    parabola = (3 * 1.0 * thin.L_m**4 / (64 * thin.E_m * thin.b_m * thin.h_m)) ** (1 / 3)
    assert got.centre_m == pytest.approx(parabola, rel=0.01)


def test_pre_stretch_carries_the_weight() -> None:
    taut = sag(M, delta=0.03)
    assert taut.centre_m == pytest.approx(taut.linear_theory_m, rel=1e-3)
    assert taut.centre_m < 0.05 * sag(M).centre_m


def test_series_meets_the_closed_form() -> None:
    """Both sides of u = 0.1 against tanh itself, to the digits that tanh leaves."""
    for u2 in (4e-3, 9.9e-3, 1.01e-2, 3e-2):
        u = np.sqrt(np.longdouble(u2))
        assert float(_g(np.asarray(u2))) == pytest.approx(float(3 * (1 - np.tanh(u) / u) / u**2), rel=3e-12)


@pytest.mark.parametrize(("load", "delta"), [(0.01, 0.037), (1e-5, 0.0075), (0.0, 0.0), (1e-9, 0.0), (0.906, 0.0373)])
def test_a_taut_or_hardly_loaded_membrane_has_a_sag_too(load: float, delta: float) -> None:
    """Its own stretch is lost in rounding beside the pre-stretch."""
    found = sag(Membrane(), load, delta)
    assert found.stretch >= delta
    assert 0 <= found.centre_m <= found.linear_theory_m * (1 + 1e-12)
