"""Response to a square wave with RC edges, against a solution in time that shares nothing with the series."""

import numpy as np
import pytest

from drivers.drive_shapes import SquareWave
from model.amplifier_map import AmplifierMap
from model.parameter_spec import ParameterError
from model.parameters import Tactor
from model.response.drive_spectrum import fourier_series
from model.response.harmonic_response import tactor_modal_form
from model.response.square_wave import square_wave_response, square_wave_series
from tests.helpers.sampled import march, sampled_series

WAVES = [
    (60.0, 2.5, 2.5, 0.5, 5e-4),
    (160.0, 2.0, 2.5, 0.3, 6e-4),
    (80.0, 1.0, 3.0, 0.7, 1e-3),
    (250.0, 1.5, 1.8, 0.5, 2e-4),
]


@pytest.mark.parametrize("wave", WAVES)
def test_the_series_is_that_of_the_sampled_drive(wave: tuple[float, ...]) -> None:
    f, amplitude, offset, duty, edge_s = wave
    drive = SquareWave(f, amplitude, offset, duty, edge_s, 3)
    samples = 1 << 18
    volts = drive.volts((np.arange(samples) / samples + 1) / f)
    expected = sampled_series(volts, 40)
    assert np.abs(square_wave_series(*wave, AmplifierMap(), 40) - expected).max() < 1e-3  # of up to 1500 V


@pytest.mark.parametrize("wave", WAVES)
def test_the_response_is_the_one_that_is_marched_in_time(wave: tuple[float, ...]) -> None:
    f, amplitude, offset, duty, edge_s = wave
    rate, periods = 400_000.0, 40
    drive = SquareWave(f, amplitude, offset, duty, edge_s, periods)
    t = np.arange(round(periods / f * rate)) / rate
    moved = march(tactor_modal_form(Tactor()), AmplifierMap().specimen_v(drive.volts(t)), rate)
    last = moved[t > (periods - 1) / f]
    response = square_wave_response(Tactor(), f, amplitude, offset, duty=duty, edge_s=edge_s)
    assert response.peak_to_peak[0] == pytest.approx(np.ptp(last), rel=1e-4)
    assert response.harmonics[0, 0].real == pytest.approx(last.mean(), abs=5e-4 * np.ptp(last))


def test_without_edges_it_is_the_ideal_square() -> None:
    ideal = fourier_series("square", 2.0, 2.5, AmplifierMap(), 20, 0.5)
    assert square_wave_series(50.0, 2.0, 2.5, 0.5, 1e-7, AmplifierMap(), 20) == pytest.approx(ideal, abs=0.5)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ((100.0, 2.5, 2.5, 1.0, 5e-4), "duty is 1.0: it must lie between 0 and 1"),
        ((100.0, 2.5, 2.5, 0.5, 0.0), "edge_s is 0.0: it must be a positive number"),
        ((1000.0, 2.5, 2.5, 0.1, 5e-3), "does not cross its offset: lower the frequency or shorten the edges"),
        ((50.0, 2.5, 3.0, 0.5, 1e-4), "leaves the amplifier's input range"),
    ],
)
def test_a_wave_that_cannot_be_is_refused(values: tuple[float, ...], says: str) -> None:
    with pytest.raises(ParameterError, match=says):
        square_wave_series(*values, AmplifierMap())
