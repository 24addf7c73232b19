"""Shape functions of the paper, stable at any order; convergence of Galerkin to the exact solution."""

import numpy as np
import pytest

from model.beam.basis import load_shape, moment_shape, shape_functions, symmetric_modes, wavenumbers
from model.beam.galerkin import gram
from model.beam.hermite import hermite_gram
from model.membrane import skin
from model.parameter_spec import ParameterError
from model.parameters import Membrane, Skin, Tactor
from model.response.harmonic_response import frequency_response
from model.response.modes import natural_frequencies
from model.response.shape_choice import choose_shapes
from model.studies.shape_function_convergence import convergence

XI = np.linspace(0, 1, 41)
ELONGATIONS_M = (0.0, 1.27e-3, 2.54e-3, 3.81e-3, 5.08e-3, 6.35e-3)
SKINS = [None, *(skin(Membrane(), e / Membrane().L_m) for e in ELONGATIONS_M)]


def test_only_symmetric_roots_belong_to_the_basis() -> None:
    b = wavenumbers(40)
    assert 2 * b[:3] == pytest.approx([4.730, 10.996, 17.279], abs=5e-4)
    assert np.cos(2 * b[:10]) == pytest.approx(1 / np.cosh(2 * b[:10]), abs=1e-13)
    assert np.tan(b) == pytest.approx(-1, abs=2e-2)


def test_shapes_are_equation_15_where_it_can_be_evaluated() -> None:
    b = wavenumbers(4)[:, None].astype(np.longdouble)
    x = b * XI
    ratio = (np.cos(2 * b) - np.cosh(2 * b)) / (np.sin(2 * b) - np.sinh(2 * b))
    printed = np.cos(x) - np.cosh(x) - ratio * (np.sin(x) - np.sinh(x))
    assert symmetric_modes(XI, 4) == pytest.approx(printed.astype(float), abs=1e-6)


def test_high_shapes_keep_their_digits() -> None:
    """Clamp, centre and norm of the 58th shape: with cosh and sinh nothing would be left of them."""
    assert symmetric_modes(np.array([0.0]), 58) == pytest.approx(0, abs=1e-12)
    assert symmetric_modes(np.array([0.0, 1.0]), 58, 1)[-1] == pytest.approx(0, abs=1e-9)
    assert abs(symmetric_modes(XI, 58)).max() < 2.01
    x, w = np.polynomial.legendre.leggauss(200)
    N = symmetric_modes((x + 1) / 2, 58)
    assert (N * w / 2) @ N.T == pytest.approx(np.eye(58), abs=1e-11)


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_derivatives_are_derivatives(derivative: int) -> None:
    x, h = np.array([0.1, 0.3, 0.5, 0.85]), 1e-6
    up, down = (shape_functions(x + s * h, 0.36, 0.68, 7, derivative) for s in (1, -1))
    exact = shape_functions(x, 0.36, 0.68, 7, derivative + 1)
    assert (up - down) / (2 * h) == pytest.approx(exact, rel=1e-5, abs=1e-5 * abs(exact).max())


def test_supplementary_shapes_solve_their_static_problems() -> None:
    """Eq. (16): no load but a moment at l1. Eq. (17): a uniform load over [l2, 1]. Both clamped and level at the centre."""
    l1, l2, h = 0.36, 0.68, 1e-9
    for shape, at in ((moment_shape, l1), (load_shape, l2)):
        assert shape([0.0], at) == pytest.approx(0)
        assert shape([0.0, 1.0], at, 1) == pytest.approx(0, abs=1e-12)
        assert shape([1.0], at) == pytest.approx(1)
        for d in (0, 1):
            assert shape([at - h], at, d) == pytest.approx(shape([at + h], at, d), abs=1e-6)
    assert moment_shape([0.1, 0.9], l1, 3) == pytest.approx(0)
    assert moment_shape([l1 + h], l1, 2) - moment_shape([l1 - h], l1, 2) == pytest.approx(
        -2 / (l1 * (1 - l1)), rel=1e-6
    )
    third = load_shape([0.1, 0.5, l2 + h, 0.84, 1.0], l2, 3)
    assert third[0] == pytest.approx(third[1])
    assert third[1] == pytest.approx(third[2])
    assert third[3] == pytest.approx((third[2] + third[4]) / 2)
    assert third[4] == pytest.approx(0)


def test_gram_integrals_do_not_depend_on_the_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    from model.beam import galerkin

    coarse = {n: gram(0.3601, 0.6802, n) for n in (3, 7, 20)}
    nodes, weights = np.polynomial.legendre.leggauss(300)
    monkeypatch.setattr(galerkin, "_gauss_legendre", lambda count: (nodes, weights))
    for n, g in coarse.items():
        fine = galerkin._integrate(np.asarray(0.3601), np.asarray(0.6802), n)
        assert g.parts == pytest.approx(fine.parts, abs=1e-8 * abs(fine.parts).max())


def test_many_geometries_at_once_are_the_single_ones() -> None:
    l1, l2 = np.array([0.2, 0.36, 0.5]), np.array([0.6, 0.68, 0.9])
    for i, (a, b) in enumerate(zip(l1.tolist(), l2.tolist(), strict=True)):
        for many, one in zip(gram(l1, l2, 7), gram(a, b, 7), strict=True):
            assert many[i] == pytest.approx(one, rel=1e-12, abs=1e-12)


def test_better_conditioned_basis_spans_the_same_space() -> None:
    """Plain N of Eqs. (15)-(17), matrices written out as in Eq. (14), solved at one frequency."""
    t, omega = Tactor(), 2 * np.pi * 140
    l1, l2 = t.L1 / t.L, t.L2 / t.L
    x, w = np.polynomial.legendre.leggauss(60)
    M = C = K = 0
    for a, b, rho, k in ((0, l1, t.rho1, t.k1), (l1, l2, t.rho2, t.k2), (l2, 1, t.rho2 + t.eta, t.k2)):
        xi, dx = (a + b) / 2 + (b - a) / 2 * x, (b - a) / 2 * w * t.L
        N, N2 = shape_functions(xi, l1, l2, 7), shape_functions(xi, l1, l2, 7, 2) / t.L**2
        M, C, K = M + rho * (N * dx) @ N.T, C + t.c0 * (N * dx) @ N.T, K + k * (N2 * dx) @ N2.T
    B = -shape_functions(np.array(l1), l1, l2, 7, 1) / t.L * t.mu
    q = np.linalg.solve(K + 1j * omega * C - omega**2 * M, B)
    w_L = shape_functions(np.array(1.0), l1, l2, 7) @ q
    assert frequency_response(t, 140.0)[0] == pytest.approx(w_L, rel=1e-9)


def test_forty_shapes_leave_the_mass_matrix_well_conditioned() -> None:
    assert np.linalg.cond(gram(8 / 22, 15 / 22, 40).parts[:3].sum(0)) < 10


@pytest.mark.parametrize("on", SKINS)
def test_convergence_to_forty_shapes(on: Skin | None) -> None:
    """The worst error over 1..500 Hz falls with every step; 40 shapes are within 2e-5 at every frequency, phase included."""
    c = convergence(Tactor(), on, n=(3, 5, 7, 10, 14, 20, 28, 40))
    assert (np.diff(c.max_error) < 0).all()
    assert (np.diff(c.max_amplitude_error) < 0).all()
    assert c.max_error[-1] < 2e-5


def test_the_table_of_the_theory_page() -> None:
    c = convergence(Tactor(), n=(3, 5, 7, 8, 10, 14, 20, 28, 40))
    complex_error = [0.18, 0.010, 4.9e-3, 2.3e-3, 1.3e-3, 4.1e-4, 1.4e-4, 4.4e-5, 1.6e-5]
    amplitude = [0.15, 8.2e-3, 3.6e-3, 1.9e-3, 9.7e-4, 3.3e-4, 1.1e-4, 3.6e-5, 1.3e-5]
    assert c.max_error == pytest.approx(complex_error, rel=0.05)
    assert c.max_amplitude_error == pytest.approx(amplitude, rel=0.05)


@pytest.mark.deep
def test_convergence_does_not_end_at_forty() -> None:
    c = convergence(Tactor(), None, np.arange(1.0, 501, 25), n=(40, 80, 150))
    assert (np.diff(c.max_error) < 0).all()
    assert c.max_error[-1] < 3e-7


@pytest.mark.deep
def test_every_further_shape_lowers_the_first_frequency() -> None:
    """Rayleigh-Ritz, n by n, down to the eleventh digit."""
    f = np.array([natural_frequencies(Tactor(), n=n)[0] for n in range(3, 61)])
    assert (np.diff(f) < 1e-9).all()
    assert f[4] / f[-1] - 1 == pytest.approx(0.94e-3, abs=0.01e-3)
    assert 0 < f[37] / f[-1] - 1 < 5e-6


@pytest.mark.parametrize(("on", "amplitude"), [(on, 0.0037 if on is None else 0.003) for on in SKINS])
def test_seven_shapes_over_1_to_500_hz(on: Skin | None, amplitude: float) -> None:
    """With every membrane within 0.3 %. Free, 0.36 % just above the resonance, which lies 0.09 % high: w'' has a kink at L1.

    Eight shapes do it, and so do seven away from the flank of the free resonance.
    """
    c = convergence(Tactor(), on, n=(7, 8))
    assert c.max_amplitude_error[0] < amplitude
    assert c.max_amplitude_error[1] < 0.003
    flank = (c.frequency_hz > 155) & (c.frequency_hz < 225)
    assert c.amplitude_error[0, ~flank].max() < 0.003


def test_the_kink_at_the_stiffness_step_is_what_limits_seven_shapes() -> None:
    even = Tactor(k2=Tactor().k1)
    assert convergence(even, n=(7,)).max_error[0] < 6e-4 < 4.9e-3 < convergence(Tactor(), n=(7,)).max_error[0] < 5e-3


def test_hermite_integrals_of_many_geometries_are_those_of_each() -> None:
    l1, l2 = np.array([0.3, 0.45, 0.2]), np.array([0.6, 0.7, 0.9])
    many = hermite_gram(l1, l2, 11)
    for at in range(3):
        one = hermite_gram(float(l1[at]), float(l2[at]), 11)
        for each, single in zip(many, one, strict=True):
            assert (each[at] == single).all()


@pytest.mark.parametrize("n", [3, 7, 12, 305])
def test_hermite_unknowns_are_5_11_17(n: int) -> None:
    with pytest.raises(ParameterError, match=rf"^{n} unknowns: Hermite elements have 5, 11, 17"):
        hermite_gram(0.3, 0.6, n)


def test_hermite_elements_are_chosen_where_the_papers_seven_do_not_suffice() -> None:
    chosen = [choose_shapes(Tactor(), accuracy=accuracy, hermite=True) for accuracy in (1e-2, 1e-3, 2e-5)]
    assert [(each.n, each.hermite) for each in chosen] == [(7, False), (11, True), (23, True)]
    assert all(each.error <= each.accuracy for each in chosen)
    assert not choose_shapes(Tactor(), accuracy=1e-3).hermite
