"""Reference numbers, obtained independently from a closed-form solution."""

import numpy as np
import pytest

from model.amplifier_map import AmplifierMap
from model.membrane import point_stiffness, sag, skin, weight_per_length
from model.parameters import NO_SKIN, Membrane, Skin, Tactor
from model.response.closed_form import exact_response
from model.response.drive_spectrum import fourier_series
from model.response.harmonic_response import amplifier_response, frequency_response, poles
from model.response.latency import step_latency
from model.response.modes import damping_ratios, natural_frequencies
from model.response.statics import load_compliance, voltage_gain

TABLE = np.array(
    [
        [25, 486.8, 491.0],
        [50, 522.8, 537.4],
        [75, 594.2, 702.7],
        [80, 614.4, 724.8],
        [100, 724.0, 760.1],
        [125, 946.9, 953.9],
        [150, 1154.0, 1154.2],
        [160, 1115.4, 1115.7],
        [175, 922.2, 923.5],
        [200, 595.9, 596.8],
        [225, 402.9, 403.3],
        [250, 291.6, 291.8],
    ]
)


def test_free_tactor_under_the_amplifiers_sine() -> None:
    r = amplifier_response(Tactor(), TABLE[:, 0])
    assert 2e6 * abs(r.fundamental) == pytest.approx(TABLE[:, 1], abs=0.06)
    assert 1e6 * r.peak_to_peak == pytest.approx(TABLE[:, 2], abs=0.11)


def test_the_exact_solution_at_three_frequencies() -> None:
    H = exact_response(Tactor(), [100, 158, 250])
    assert 2e9 * abs(H) == pytest.approx([724.52, 1128.59, 290.90], abs=0.006)


def test_full_scale_sine_on_the_specimen() -> None:
    V = fourier_series("sine", 2.5, 2.5, AmplifierMap(), 6)
    assert V[0].real == pytest.approx(318.3, abs=0.05)
    assert abs(V[[1, 2, 4, 6]]) == pytest.approx([1000.0, 212.2, 42.4, 18.2], abs=0.05)
    assert abs(V[[3, 5]]) == pytest.approx(0, abs=1e-9)


def test_statics() -> None:
    t = Tactor()
    assert load_compliance(t) == pytest.approx(1.3790e-4, rel=5e-5)
    assert voltage_gain(t) == pytest.approx(2.37886e-7, rel=5e-6)


def test_equation_7_as_printed_is_too_soft() -> None:
    t = Tactor()
    printed = load_compliance(t) * t.k2 / t.k1
    assert printed == pytest.approx(1.0492e-3, rel=5e-5)
    assert 0.5 * 9.80665 * printed > 0.77e-3


def test_bare_tactor_and_the_added_masses() -> None:
    assert natural_frequencies(Tactor(m_add=0))[:2] == pytest.approx([620.66, 3642.75], abs=0.005)
    grams = np.arange(1.75, 10, 1)
    f = [natural_frequencies(Tactor(m_add=1e-3 * m))[0] for m in grams]
    assert f == pytest.approx([300.9, 250.9, 219.7, 197.8, 181.4, 168.5, 158.0, 149.2, 141.8], abs=0.05)


def test_only_half_the_mass_on_half_the_beam_resonates_where_the_text_says() -> None:
    assert natural_frequencies(Tactor())[0] == pytest.approx(158.15, abs=0.005)
    assert natural_frequencies(Tactor(m_add=2 * 7.73e-3))[0] == pytest.approx(113.7, abs=0.05)


def test_step_of_1500_volts() -> None:
    step = step_latency(Tactor(), 1500.0)
    assert step.final_m == pytest.approx(356.8e-6, abs=0.05e-6)
    assert step.to_threshold_s == pytest.approx(0.56e-3, abs=0.01e-3)
    assert step.rise_s == pytest.approx(1.21e-3, abs=0.005e-3)
    assert step.overshoot == pytest.approx(0.51, abs=0.005)


def test_the_free_response_has_no_zero_before_its_peak() -> None:
    f = np.linspace(0, 150, 301)
    assert (np.diff(abs(exact_response(Tactor(), f))) > 0).all()
    assert (np.diff(abs(frequency_response(Tactor(), f))) > 0).all()


def test_pre_stretches_of_the_paper() -> None:
    assert 6.35e-3 / Membrane().L_m == pytest.approx(0.03735, abs=5e-6)
    assert 1e-3 / Membrane().L_m == pytest.approx(0.00588, abs=5e-6)


def test_the_membrane_sags_by_stretching_not_by_bending() -> None:
    assert weight_per_length(Membrane()) == pytest.approx(0.906, abs=5e-4)
    s = sag(Membrane(), 0.906)
    assert s.centre_m == pytest.approx(3.5e-3, abs=0.05e-3)
    assert s.linear_theory_m == pytest.approx(20e-3, rel=0.1)
    assert s.linear_theory_m == pytest.approx(18.8e-3, rel=1e-3)
    assert s.linear_theory_m / Membrane().h_m > 13


def test_galerkin_with_seven_shapes_at_three_frequencies() -> None:
    H = frequency_response(Tactor(), [100, 158, 250])
    assert 2e9 * abs(H) == pytest.approx([723.97, 1130.84, 291.58], abs=0.006)


@pytest.mark.parametrize(
    # the reference was read off at rounded pre-stretches: hence 0.15 um
    ("delta", "microns"),
    [(0.0, (652.2, 705.9, 447.0)), (0.0075, (436.9, 357.4, 257.8)), (0.0373, (175.7, 122.4, 91.9))],
)
def test_tactor_on_the_membrane(delta: float, microns: tuple[float, ...]) -> None:
    r = amplifier_response(Tactor(), [100, 150, 200], skin=skin(Membrane(), delta))
    assert 1e6 * r.peak_to_peak == pytest.approx(microns, abs=0.15)


def test_poles_with_the_added_mass() -> None:
    s = poles(Tactor())[[0, 2]]
    assert abs(s) / (2 * np.pi) == pytest.approx([158.31, 2278.1], rel=5e-5)
    assert damping_ratios(s) == pytest.approx([0.2110, 0.1183], abs=5e-5)


@pytest.mark.parametrize(("delta", "k_s", "c_s"), [(0.0, 585.6, 165.0), (6.35e-3 / 0.17, 8.480e4, 2211.9)])
def test_skin_spans_the_papers_range(delta: float, k_s: float, c_s: float) -> None:
    got = skin(Membrane(), delta)
    assert got.k_s == pytest.approx(k_s, rel=1e-4)
    assert got.c_s == pytest.approx(c_s, rel=1e-4)


def test_the_papers_smallest_stiffness_is_the_undistributed_one() -> None:
    assert point_stiffness(0.17, 0.066, 1.4e-3, 6.95e6, 0.0) == pytest.approx(4.1, abs=0.01)


def test_symmetric_reading_of_the_contact_is_one_argument_away() -> None:
    assert skin(Membrane(), 0.01, contact_length=0.014).k_s == pytest.approx(skin(Membrane(), 0.01).k_s / 2)


def test_characteristic_scales() -> None:
    assert Tactor().tau == pytest.approx(1.696e-3, rel=1e-3)
    assert Tactor().c_bar == pytest.approx(6.66, abs=0.005)
    assert Tactor(h_Al=0.25e-3).tau != pytest.approx(1.7e-3, rel=0.02)


def test_no_skin_is_the_free_tactor() -> None:
    f = np.array([10.0, 160.0])
    assert frequency_response(Tactor(), f) == pytest.approx(frequency_response(Tactor(), f, Skin()))
    assert Skin() == NO_SKIN
