"""Physical properties of every admissible tactor: conservation laws, and independent solutions compared."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from numpy.polynomial.legendre import leggauss

from model.beam.galerkin import gram, matrices
from model.beam.hermite import hermite_gram
from model.beam.poles import modal_form, receptance
from model.parameters import NO_SKIN, Skin, Tactor
from model.response.closed_form import exact_response
from model.response.harmonic_response import frequency_response, system_matrices, tactor_modal_form
from model.response.modes import natural_frequencies
from model.response.statics import deflection, load_compliance, voltage_gain
from tests.helpers.model.strategies import pairs, tactors

few = settings(suppress_health_check=[HealthCheck.too_slow])  # a busy machine is no failure of physics


def around_resonance(t: Tactor, skin: Skin | None = None) -> np.ndarray:
    return natural_frequencies(t, skin)[0] * np.array([0.01, 0.3, 0.7, 0.95, 1.05, 1.6, 2.5])


@few
@given(pairs())
def test_galerkin_agrees_with_the_closed_form(pair: tuple[Tactor, Skin]) -> None:
    t, skin = pair
    for on in (None, skin):
        f = around_resonance(t, on)
        for source in ("voltage", "load"):
            exact = exact_response(t, f, on, excitation=source)
            error = [
                abs(frequency_response(t, f, on, n, excitation=source) - exact).max() / abs(exact).max()
                for n in (7, 14, 28)
            ]
            assert error[0] > error[1] > error[2]
            assert error[1] < 0.1
            assert error[2] < 0.015


@few
@given(pairs())
def test_hermite_elements_agree_with_the_closed_form(pair: tuple[Tactor, Skin]) -> None:
    t, skin = pair
    for on in (NO_SKIN, skin):
        f = around_resonance(t, on)
        for source in ("voltage", "load"):
            exact = exact_response(t, f, on, excitation=source)
            error = []
            for n in (11, 41, 83):
                m = matrices(t.beam, on.k_s, on.c_s, n, hermite_gram)
                form = modal_form(m.M, m.C, m.K, m.B if source == "voltage" else m.B_F, 2 * m.B_F)
                error.append(abs(receptance(form, 2 * np.pi * f) - exact).max() / abs(exact).max())
            assert error[2] < 2e-3  # 3e-6 without a skin far stiffer than the beam
            for coarse, fine in pairwise(error):  # of fourth order
                assert fine < coarse / 8 or fine < 1e-6


@few
@given(tactors())
def test_statics_are_the_zero_frequency_limit(t: Tactor) -> None:
    x = np.linspace(0, t.L, 11)
    for source, whole, volts, load in (("voltage", voltage_gain(t), 1, 0), ("load", load_compliance(t), 0, 1)):
        w = exact_response(t, 0.0, x=x, excitation=source)[:, 0]
        assert w.real == pytest.approx(deflection(t, x, volts, load), rel=1e-9, abs=1e-12 * abs(whole))
        assert w[-1].real == pytest.approx(whole, rel=1e-9)
        # The inertia of a soft tactor shows at 1e-4 Hz: how slow is slow enough follows from its resonance.
        slow = exact_response(t, natural_frequencies(t)[0] * np.logspace(-14, -6, 9), excitation=source)
        assert slow.real == pytest.approx(np.full(9, whole), rel=1e-9)
    # Eq. (16) holds the whole static answer to a voltage; the load's is only approached
    assert frequency_response(t, 0.0, n=3)[0].real == pytest.approx(voltage_gain(t), rel=1e-9)
    assert frequency_response(t, 0.0, n=40, excitation="load")[0].real == pytest.approx(load_compliance(t), rel=2e-4)


@few
@given(pairs())
def test_reciprocity_of_load_and_moment(pair: tuple[Tactor, Skin]) -> None:
    """A volt bends at L1 and moves the centre; a newton at the centre turns the section at L1 in proportion."""
    t, skin = pair
    f = around_resonance(t, skin)
    moved = exact_response(t, f, skin)
    turned = exact_response(t, f, skin, x=t.L1, excitation="load", derivative=1)
    assert abs(moved + 2 * t.mu * turned).max() < 1e-8 * abs(moved).max()


@few
@given(pairs())
def test_power_in_is_power_dissipated(pair: tuple[Tactor, Skin]) -> None:
    t, skin = pair
    f = around_resonance(t, skin)
    omega = 2 * np.pi * f
    nodes, weights = leggauss(40)
    exact = galerkin = 0.0
    m, g = system_matrices(t, skin, 14), gram(t.L1 / t.L, t.L2 / t.L, 14)
    turned = receptance(modal_form(m.M, m.C, m.K, m.B, g.slope / t.L), omega)
    for a, b, c in ((0, t.L1, t.c0), (t.L1, t.L2, t.c0), (t.L2, t.L, t.c0 + skin.c_s)):
        x, w = (a + b) / 2 + (b - a) / 2 * nodes, (b - a) / 2 * weights
        exact = exact + c * w @ abs(exact_response(t, f, skin, x=x)) ** 2
        galerkin = galerkin + c * w @ abs(frequency_response(t, f, skin, 14, x=x)) ** 2
    for slope, loss in ((exact_response(t, f, skin, x=t.L1, derivative=1), exact), (turned, galerkin)):
        power_in = 0.5 * (-t.mu * np.conj(1j * omega * slope)).real
        assert power_in == pytest.approx(0.5 * omega**2 * loss, rel=1e-6)


@few
@given(pairs())
def test_matrices_are_positive_definite_and_poles_passive(pair: tuple[Tactor, Skin]) -> None:
    t, skin = pair
    for n in (3, 7, 40):
        m = system_matrices(t, skin, n)
        for A in (m.M, m.K, m.C):
            assert abs(A - A.T).max() < 1e-12 * abs(A).max()
            scale = 1 / np.sqrt(np.diag(A))
            assert np.linalg.eigvalsh(A * np.outer(scale, scale)).min() > 0
        form = tactor_modal_form(t, skin, n)
        assert (form.poles.real < 0).all()
        f = around_resonance(t, skin)
        drive_point = frequency_response(t, f, skin, n, excitation="load")
        assert (drive_point.imag < 0).all()


@few
@given(pairs(), tactors())
def test_changing_the_units_changes_nothing(pair: tuple[Tactor, Skin], other: Tactor) -> None:
    """Metres, kilograms, seconds and volts measured in other units: every result only changes its number accordingly."""
    t, skin = pair
    m, kg, s, v = other.L / 0.02, other.rho1 / 0.01, other.rho2 / 0.003, abs(other.mu) / 1e-5
    scaled = Tactor(
        L=t.L * m,
        L1=t.L1 * m,
        L2=t.L2 * m,
        b_Al=t.b_Al * m,
        h_Al=t.h_Al * m,
        rho1=t.rho1 * kg / m,
        rho2=t.rho2 * kg / m,
        E_Al=t.E_Al * kg / (m * s**2),
        k2=t.k2 * kg * m**3 / s**2,
        mu=t.mu * kg * m**2 / s**2 / v,
        c0=t.c0 * kg / (m * s),
        m_add=t.m_add * kg,
    )
    on = Skin(skin.k_s * kg / (m * s**2), skin.c_s * kg / (m * s))
    f = around_resonance(t, skin)
    assert frequency_response(scaled, f / s, on) == pytest.approx(frequency_response(t, f, skin) * m / v, rel=1e-7)
    assert exact_response(scaled, f / s, on) == pytest.approx(exact_response(t, f, skin) * m / v, rel=1e-7)
    compliance = frequency_response(t, f, skin, excitation="load") * s**2 / kg
    assert frequency_response(scaled, f / s, on, excitation="load") == pytest.approx(compliance, rel=1e-7)
    assert voltage_gain(scaled) == pytest.approx(voltage_gain(t) * m / v)
    assert scaled.tau == pytest.approx(t.tau * s)
    assert scaled.c_bar == pytest.approx(t.c_bar * kg / (m * s))
