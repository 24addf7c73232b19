"""Frequency response to a pure sine, and periodic response to the amplifier's output."""

import numpy as np
import pytest

from model.amplifier_map import AmplifierMap
from model.beam.poles import modal_form, receptance
from model.drive_history import rayleigh_loop
from model.membrane import skin
from model.parameters import Membrane, Skin, Tactor
from model.response.closed_form import exact_response
from model.response.drive_spectrum import fourier_series, sine_harmonics
from model.response.harmonic_response import (
    amplifier_response,
    frequency_response,
    peak_to_peak,
    periodic_response,
    poles,
    system_matrices,
    tactor_modal_form,
)
from model.response.lag import loop_harmonics
from model.response.modes import damping_ratios, mode_shapes, natural_frequencies
from tests.helpers.sampled import march, sampled_series

ON = skin(Membrane(), 0.01)


def test_sum_over_poles_is_the_plain_solve() -> None:
    f = np.linspace(0, 3000, 50)
    for on in (None, ON, Skin(0.0, 3e3)):
        m = system_matrices(Tactor(), on)
        w = 2 * np.pi * f
        plain = [2 * m.B_F @ np.linalg.solve(m.K + 1j * x * m.C - x * x * m.M, m.B) for x in w]
        assert frequency_response(Tactor(), f, on) == pytest.approx(np.array(plain), rel=1e-10)


def test_any_mixture_of_real_and_complex_poles() -> None:
    """Random symmetric systems from almost undamped to overdamped, one by one and as a stack."""
    rng = np.random.default_rng(3)
    G = rng.standard_normal((3, 300, 4, 6))
    M, C, K = (g @ np.swapaxes(g, -1, -2) + 0.1 * np.eye(4) for g in G)
    C = C * np.logspace(-3, 1, 300)[:, None, None]
    B, c, w = rng.standard_normal((300, 4)), rng.standard_normal((300, 4)), np.array([0.0, 0.3, 1.0, 4.0])
    stack = modal_form(M, C, K, B, c)
    reals = (stack.poles.imag == 0).sum(-1)
    assert {0, 2, 4} <= set(reals.tolist())
    H = receptance(stack, w)
    for i in range(300):
        exact = [c[i] @ np.linalg.solve(K[i] + 1j * x * C[i] - x * x * M[i], B[i]) for x in w]
        assert H[i] == pytest.approx(np.array(exact), rel=1e-7)
        assert receptance(modal_form(M[i], C[i], K[i], B[i], c[i]), w) == pytest.approx(H[i], rel=1e-7)


def test_critical_damping_keeps_its_digits() -> None:
    """Two poles that meet have residues that cancel; what is left must still be the response."""
    M, K, B = np.eye(3), np.diag([1.0, 4.0, 9.0]), np.ones(3)
    for detune in (0.0, 1e-12, -4e-8, 1e-6, 1e-2):
        C = np.diag([2.0 + detune, 1.0, 7.0])
        H = receptance(modal_form(M, C, K, B, B), np.array([0.0, 0.5, 1.0, 2.0]))
        w = np.array([0.0, 0.5, 1.0, 2.0])[:, None]
        exact = (1 / (np.diag(K) + 1j * w * np.diag(C) - w**2)).sum(1)
        assert pytest.approx(exact, rel=1e-6) == H


def test_response_along_the_beam() -> None:
    x = np.linspace(0, Tactor().L, 7)
    f = np.array([40.0, 160.0, 400.0])
    H = frequency_response(Tactor(), f, ON, x=x)
    assert H.shape == (7, 3)
    assert pytest.approx(exact_response(Tactor(), f, ON, x=x), abs=0.005 * abs(H).max()) == H
    assert H[-1] == pytest.approx(frequency_response(Tactor(), f, ON))
    assert H[2] == pytest.approx(frequency_response(Tactor(), f, ON, x=float(x[2])))
    assert H[0] == pytest.approx(0, abs=1e-12 * abs(H).max())


def test_poles_come_in_conjugates_slowest_first() -> None:
    for on in (None, ON, Skin(0.0, 2e4)):
        s = poles(Tactor(), on)
        assert s.shape == (14,)
        assert (np.diff(abs(s)) > -1e-6 * abs(s[1:])).all()
        assert np.sort_complex(s) == pytest.approx(np.sort_complex(s.conj()))
    assert (damping_ratios(poles(Tactor(), Skin(0.0, 2e4))) == 1).sum() >= 2


def test_undamped_poles_are_the_natural_frequencies() -> None:
    s = poles(Tactor(c0=0.0), Skin(1e4, 0.0))
    assert abs(s[::2]) / (2 * np.pi) == pytest.approx(natural_frequencies(Tactor(), Skin(1e4, 0.0)), rel=1e-9)
    assert abs(s.real).max() < 1e-9 * abs(s).max()


def test_mode_shapes_are_orthonormal_in_mass() -> None:
    t = Tactor()
    x, w = np.polynomial.legendre.leggauss(40)
    total = 0
    for a, b, rho in ((0, t.L1, t.rho1), (t.L1, t.L2, t.rho2), (t.L2, t.L, t.rho2 + t.eta)):
        phi = mode_shapes(t, (a + b) / 2 + (b - a) / 2 * x, n=14)
        total = total + rho * (phi * w * (b - a) / 2) @ phi.T
    assert total == pytest.approx(np.eye(3), abs=1e-9)
    assert all((mode_shapes(t, t.L, n=n) > 0).all() for n in range(3, 20))


@pytest.mark.parametrize(
    ("amplitude", "offset"), [(2.5, 2.5), (1.0, 3.0), (1.0, 1.2), (0.5, 4.0), (-2.0, 2.0), (0.0, 3.0)]
)
def test_sine_through_the_amplifier(amplitude: float, offset: float) -> None:
    """Against the samples of the map itself."""
    theta = 2 * np.pi * np.arange(20_000) / 20_000
    sampled = sampled_series(offset + amplitude * np.sin(theta), 20)
    assert fourier_series("sine", amplitude, offset, AmplifierMap(), 20) == pytest.approx(sampled, abs=1e-4)


def test_harmonics_of_many_sines_are_those_of_each() -> None:
    amplitudes, offsets = np.array([2.5, 1.0, 0.5, -2.0, 0.0]), np.array([2.5, 1.2, 4.0, 2.0, 3.0])
    together = sine_harmonics(amplitudes, offsets, AmplifierMap(), 2, 3)
    loops = loop_harmonics(AmplifierMap(), amplitudes[:4], offsets[:4])
    theta = 2 * np.pi * np.arange(2048) / 2048
    for row, a, o in zip(together, amplitudes, offsets, strict=True):
        sampled = sampled_series(o + a * np.sin(2 * np.pi * np.arange(20_000) / 20_000), 3)
        assert row == pytest.approx(sampled[2:], abs=1e-4)
    for row, a, o in zip(loops, amplitudes, offsets, strict=False):
        late = rayleigh_loop(AmplifierMap().specimen_v(o + a * np.sin(theta))) / 1000
        assert row[1] == pytest.approx(2 * np.mean(late * np.exp(-1j * theta)), rel=1e-9)


def test_square_of_the_belts_multivibrator() -> None:
    V = fourier_series("square", 2.5, 2.5, AmplifierMap(), 400, duty=0.25)
    theta = np.array([0.1, 1.4, 2.0, 5.0])
    assert V[0].real == pytest.approx(0.25 * 1500 - 0.75 * 500)
    assert (V * np.exp(1j * np.outer(theta, np.arange(401)))).sum(1).real == pytest.approx(
        [1500, 1500, -500, -500], abs=20
    )


@pytest.mark.parametrize("waveform", ["sine", "square"])
def test_periodic_response_is_what_time_stepping_settles_to(waveform: str) -> None:
    """Amplitude, phase and max - min read off a long exact time series."""
    f, rate, per = 80.0, 400_000.0, 5000
    theta = 2 * np.pi * np.arange(40 * per) / per
    wave = np.sin(theta) if waveform == "sine" else np.where(np.mod(theta, 2 * np.pi) < np.pi - 1e-9, 1.0, -1.0)
    v = AmplifierMap().specimen_v(2.5 + 2.5 * wave)
    w = march(tactor_modal_form(Tactor()), v, rate, "linear" if waveform == "sine" else "zero")[-per:]
    r = amplifier_response(Tactor(), f, waveform=waveform)
    one = theta[:per]
    assert r.fundamental[0] == pytest.approx(2j * np.mean(w * np.exp(-1j * one)), rel=2e-3)
    assert r.harmonics[0, 0].real == pytest.approx(w.mean(), rel=1e-3)
    assert r.peak_to_peak[0] == pytest.approx(np.ptp(w), rel=2e-4)
    k = np.arange(1, r.harmonics.shape[1])
    rebuilt = r.harmonics[0, 0].real + (
        abs(r.harmonics[0, 1:]) * np.sin(np.outer(one, k) + np.angle(r.harmonics[0, 1:]))
    ).sum(1)
    assert rebuilt == pytest.approx(w, abs=5e-3 * np.ptp(w))


def test_peak_to_peak_finds_the_peak_between_its_samples() -> None:
    phases = np.linspace(0, 1, 7)
    W = np.zeros((7, 33), complex)
    W[:, 0], W[:, 1] = 5.0, np.exp(1j * phases)
    assert peak_to_peak(W) == pytest.approx(2, rel=1e-10)


def test_any_periodic_drive_from_its_samples() -> None:
    theta = 2 * np.pi * np.arange(4096) / 4096
    V = sampled_series(2.5 + 1.5 * np.sin(theta) + 0.5 * np.sin(3 * theta), 64)
    r = periodic_response(tactor_modal_form(Tactor()), np.array([40.0, 90.0]), V)
    assert r.fundamental == pytest.approx(1j * V[1] * frequency_response(Tactor(), [40, 90]))


def test_phase_is_that_of_the_input_sine() -> None:
    r = amplifier_response(Tactor(), [0.1, 1000.0])
    assert np.degrees(np.angle(r.fundamental)) == pytest.approx([0, -180], abs=15)
    assert abs(r.fundamental[0]) == pytest.approx(1000 * 2.37886e-7, rel=1e-3)


def test_second_harmonic_rings_the_resonance_at_half_its_frequency() -> None:
    r = amplifier_response(Tactor(), [79.0])
    assert abs(r.harmonics[0, 2]) == pytest.approx(212.2 * abs(frequency_response(Tactor(), 158.0)[0]), rel=1e-3)
    assert r.peak_to_peak[0] / (2 * abs(r.fundamental[0])) == pytest.approx(1.18, abs=0.01)
