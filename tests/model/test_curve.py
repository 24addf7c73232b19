"""Fast response against the full response; deflection shape against the response."""

import numpy as np
import pytest

from model.parameter_spec import ParameterError
from model.parameters import Membrane, Tactor
from model.response.fast_response import operating_deflection_shape, response_curve
from model.response.harmonic_response import amplifier_response
from model.specimen import Specimen

FREQUENCY = np.linspace(1.0, 500.0, 120)


@pytest.mark.parametrize(
    ("specimen", "tolerance"),
    [
        (Specimen(), 1e-4),
        (Specimen(Tactor(), Membrane(), delta=0.0075), 1e-4),
        (Specimen(Tactor(m_add=0.0)), 1e-4),
        (Specimen(Tactor(), Membrane(E_m=1e9), delta=0.006, c_s=0.0), 1e-3),
        (Specimen(Tactor(c0=2.0)), 1e-2),
    ],
)
def test_quick_and_thorough_agree(specimen: Specimen, tolerance: float) -> None:
    quick = response_curve(specimen, FREQUENCY)
    thorough = amplifier_response(specimen.tactor, FREQUENCY, skin=specimen.skin)
    np.testing.assert_allclose(quick.fundamental, thorough.fundamental, rtol=1e-12)
    np.testing.assert_allclose(quick.peak_to_peak, thorough.peak_to_peak, rtol=tolerance)


@pytest.mark.parametrize("frequency_hz", [20.0, 80.0, 160.0])
def test_the_motion_of_the_centre_has_the_amplitude_of_the_curve(frequency_hz: float) -> None:
    specimen = Specimen()
    x = np.linspace(0, specimen.tactor.L, 21)
    w = operating_deflection_shape(specimen, frequency_hz, x, phases=256)
    assert np.ptp(w[:, -1]) == pytest.approx(
        response_curve(specimen, np.array([frequency_hz])).peak_to_peak[0], rel=1e-3
    )
    assert np.abs(w[:, 0]).max() < 1e-12  # clamped
    assert np.abs(w[:, 1]).max() < 0.02 * np.abs(w[:, -1]).max()


def test_what_cannot_be_driven_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"^frequency .* is 0 Hz: .* 0 Hz"):
        response_curve(Specimen(), np.array([0.0, 10.0]))
    with pytest.raises(ParameterError, match="lower the amplitude"):
        response_curve(Specimen(), np.array([10.0]), amplitude_v=2.6)
