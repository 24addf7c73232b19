"""Integration of a vibrometer's velocity: closed forms of amplitude, phase and errors, with noise, a high pass and interference."""

import math

import numpy as np
import pytest

from drivers import Sine
from protocols.base import InterferenceLine, Quality, Recording
from protocols.measurements.sine_dwell import SinePoint, sine_point
from protocols.signals.integration import CORNER_RELATIVE_UNCERTAINTY, integrated_response
from protocols.signals.response import FrequencyResponse

RATE_HZ, FREQUENCY_HZ, AMPLITUDE_M, PHASE = 5000.0, 120.0, 80e-6, -0.7
COUNT = 5000
NOISE_M_PER_S = 2e-4


def point(
    corner_hz: float,
    noise: np.ndarray | None = None,
    lines: tuple[InterferenceLine, ...] = (),
    true_corner_hz: float = math.nan,
) -> SinePoint:
    """Return the point of a velocity of two harmonics through a high pass, with an offset and a drift of the output."""
    t = np.arange(COUNT) / RATE_HZ
    true_hz = corner_hz if math.isnan(true_corner_hz) else true_corner_hz
    velocity = 3e-3 + 1e-3 * t + (0.0 if noise is None else noise)
    for order, size in ((1, AMPLITUDE_M), (2, 0.2 * AMPLITUDE_M)):
        omega = 2 * np.pi * FREQUENCY_HZ * order
        component = size * np.exp(1j * order * PHASE) * 1j * omega / (1 - 1j * true_hz / (FREQUENCY_HZ * order))
        velocity = velocity + (component * np.exp(1j * omega * t)).imag
    drive_v = 2.5 + 2.0 * np.sin(2 * np.pi * FREQUENCY_HZ * t)
    for line in lines:
        velocity = velocity + line.amplitude_m * np.sin(2 * np.pi * line.frequency_hz * t + 0.4)
    recording = Recording(
        0, (0, COUNT), RATE_HZ, Sine(FREQUENCY_HZ, 2.0, 2.5, 200), drive_v, velocity, Quality.GOOD,
        interference=lines, velocity_corner_hz=corner_hz,
    )  # fmt: skip
    return sine_point([recording], simulated=True)


@pytest.mark.one_in(1)
@pytest.mark.parametrize("corner_hz", [0.0, 0.5, 30.0])
def test_amplitude_phase_and_harmonics_are_those_of_the_displacement(corner_hz: float) -> None:
    seen = point(corner_hz)
    assert seen.fundamental == pytest.approx(AMPLITUDE_M, rel=1e-9)
    assert seen.phase == pytest.approx(PHASE, abs=1e-9)
    assert seen.harmonics[1] == pytest.approx(0.2 * AMPLITUDE_M, rel=1e-9)
    angle = np.linspace(0, 2 * np.pi, 100_001)
    waveform = AMPLITUDE_M * (np.sin(angle) + 0.2 * np.sin(2 * angle))
    assert seen.peak_to_peak == pytest.approx(np.ptp(waveform), rel=1e-4)
    assert math.isnan(seen.offset)
    assert math.isnan(seen.drift)


@pytest.mark.deep
def test_the_error_by_noise_is_the_error_of_the_velocity_over_the_angular_frequency() -> None:
    draw = np.random.default_rng(1).standard_normal
    seen = [point(0.0, NOISE_M_PER_S * draw(COUNT)) for _ in range(60)]
    expected = NOISE_M_PER_S * math.sqrt(2 / COUNT) / (2 * np.pi * FREQUENCY_HZ)
    assert np.mean([each.fundamental_errors for each in seen]) == pytest.approx(expected, rel=0.02)
    z = np.array([(each.fundamental - AMPLITUDE_M) / each.fundamental_errors for each in seen])
    phase = np.array([(each.phase - PHASE) / each.phase_errors for each in seen])
    for one in (z, phase):
        assert 0.75 < np.sqrt(np.mean(one**2)) < 1.25
    z = np.array(
        [(each.peak_to_peak - np.mean([p.peak_to_peak for p in seen])) / each.peak_to_peak_errors for each in seen]
    )
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.5


def test_a_corner_off_by_its_uncertainty_changes_amplitude_and_phase_by_their_errors() -> None:
    corner_hz = 30.0
    shifted = point(corner_hz, true_corner_hz=corner_hz * (1 + 0.1 * CORNER_RELATIVE_UNCERTAINTY))
    r = corner_hz / FREQUENCY_HZ
    assert 10 * (AMPLITUDE_M - shifted.fundamental) == pytest.approx(
        AMPLITUDE_M * CORNER_RELATIVE_UNCERTAINTY * r**2 / (1 + r**2), rel=0.05
    )
    assert shifted.fundamental_errors == pytest.approx(10 * (AMPLITUDE_M - shifted.fundamental), rel=0.05)
    assert shifted.phase_errors == pytest.approx(10 * (shifted.phase - PHASE), rel=0.05)


def test_interference_beneath_the_drive_counts_as_displacement_and_a_separate_line_is_removed() -> None:
    size = 1e-3  # m/s
    beneath = point(0.0, lines=(InterferenceLine(FREQUENCY_HZ, size, 1e-6),))
    assert beneath.fundamental_errors == pytest.approx(size / (2 * np.pi * FREQUENCY_HZ) / math.sqrt(2), rel=0.01)
    apart = point(0.0, lines=(InterferenceLine(50.0, size, 1e-6),))
    assert apart.fundamental == pytest.approx(AMPLITUDE_M, rel=1e-6)
    assert apart.peak_to_peak == pytest.approx(point(0.0).peak_to_peak, rel=1e-4)


def test_a_response_is_divided_line_by_line() -> None:
    f = np.linspace(20.0, 500.0, 40)
    true = 1e-5 / (1 - (f / 158) ** 2 + 0.4j * f / 158)
    corner_hz = 2.0
    velocity = FrequencyResponse(
        f, true * 2j * np.pi * f / (1 - 1j * corner_hz / f), errors=np.full(40, 1e-5), coherence=np.ones(40),
        degrees_of_freedom=10.0, resolution_hz=1.0,
    )  # fmt: skip
    seen = integrated_response(velocity, corner_hz)
    np.testing.assert_allclose(seen.y, true, rtol=1e-12)
    by_noise = 1e-5 / (2 * np.pi * f) * np.sqrt(1 + (corner_hz / f) ** 2)
    by_corner = CORNER_RELATIVE_UNCERTAINTY * np.abs(true) * (corner_hz / f) / np.sqrt(1 + (corner_hz / f) ** 2)
    np.testing.assert_allclose(seen.errors, np.hypot(by_noise, by_corner / np.sqrt(2)), rtol=1e-12)
    assert integrated_response(velocity, None) is velocity
