"""Hum and folded tones against data made with plain numpy, at the frequencies of the paper's sine dwell."""

import numpy as np
import pytest

from drivers import Sine
from protocols.base import InterferenceLine, Quality, Recording
from protocols.measurements.sine_dwell import SineDwell, SinePoint, sine_point
from protocols.signals import find_lines, folded_frequencies, remove_lines

RATE_HZ = 5000.0
RESPONSE_M = 300e-6


def hum(t: np.ndarray, size_m: float, mains_hz: float, phases: np.ndarray) -> np.ndarray:
    """Mains with a half as large third and a tenth as large second harmonic."""
    shares = zip((1, 2, 3), (1.0, 0.1, 0.5), phases, strict=True)
    return np.asarray(sum(share * size_m * np.sin(2 * np.pi * k * mains_hz * t + phase) for k, share, phase in shares))


def dwell(
    frequency_hz: float, size_m: float, random: np.random.Generator, noise_m: float = 1e-7, rest: bool = True
) -> SinePoint:
    """A point of a response of 300 um under hum of unknown phase and a mains frequency that wanders by 20 mHz."""
    at_rest = np.arange(5000) / RATE_HZ
    mains_hz = 50 + 0.02 * random.standard_normal()
    seen = hum(at_rest, size_m, mains_hz, random.uniform(0, 2 * np.pi, 3))
    lines = find_lines(seen + noise_m * random.standard_normal(seen.size), RATE_HZ) if rest else ()
    count = int(np.ceil(max(0.5, 20 / frequency_hz) * RATE_HZ))
    t = np.arange(count) / RATE_HZ
    mains_hz += 0.01 * random.standard_normal()
    moved = RESPONSE_M * np.sin(2 * np.pi * frequency_hz * t - 0.4)
    moved += hum(t, size_m, mains_hz, random.uniform(0, 2 * np.pi, 3)) + noise_m * random.standard_normal(count)
    drive_v = 2.5 + 2.5 * np.sin(2 * np.pi * frequency_hz * t) + 1e-4 * random.standard_normal(count)
    drive = Sine(frequency_hz, 2.5, 2.5, 1000)
    recording = Recording(0, (0, count), RATE_HZ, drive, drive_v, moved, Quality.GOOD, interference=lines)
    return sine_point([recording], simulated=False)


def test_lines_at_rest_are_found_with_frequency_and_amplitude() -> None:
    random = np.random.default_rng(1)
    t = np.arange(5000) / RATE_HZ
    seen = 3e-6 + 1e-6 * t + hum(t, 0.3e-6, 50.03, np.array([1.0, 2.0, 3.0])) + 20e-6 * np.sin(2 * np.pi * 812.3 * t)
    lines = [line for line in find_lines(seen + 1e-7 * random.standard_normal(t.size), RATE_HZ) if line.significant]
    assert [line.frequency_hz for line in lines] == pytest.approx([812.3, 50.03, 150.09, 100.06], abs=0.05)
    assert [line.amplitude_m for line in lines] == pytest.approx([20e-6, 0.3e-6, 0.15e-6, 0.03e-6], abs=1e-8)
    assert lines[1].error_m == pytest.approx(1e-7 * np.sqrt(2 / 5000), rel=0.1)


@pytest.mark.deep
@pytest.mark.parametrize("amplitude_m", [0.155e-6, 1e-6])
def test_the_frequency_of_a_line_scatters_by_its_stated_error(amplitude_m: float) -> None:
    """Hum with two harmonics in 1 s of noise that leaves 0.01 um of each component, over a drift; 300 records."""
    random = np.random.default_rng(11)
    t = np.arange(5000) / RATE_HZ
    deviations, errors = [], []
    for _ in range(300):
        mains_hz = 50.02 + 0.2 * random.standard_normal()
        seen = hum(t, amplitude_m, mains_hz, random.uniform(0, 2 * np.pi, 3)) + 2e-6 * t
        lines = find_lines(seen + 0.5e-6 * random.standard_normal(t.size), RATE_HZ)
        line = min(lines, key=lambda line: abs(line.frequency_hz - mains_hz))
        deviations.append(line.frequency_hz - mains_hz)
        errors.append(line.frequency_error_hz)
    assert np.mean(errors) == pytest.approx(np.sqrt(3) / np.pi * 0.01e-6 / amplitude_m, rel=0.03)
    assert np.sqrt(np.mean(np.divide(deviations, errors) ** 2)) == pytest.approx(1.0, abs=0.15)


@pytest.mark.deep
def test_a_line_that_is_not_measured_has_no_frequency_error() -> None:
    """At a harmonic of the mains that does not stand out of the noise the frequency is the nominal one."""
    noise = 1e-7 * np.random.default_rng(12).standard_normal(5000)
    assert all(np.isnan(line.frequency_error_hz) for line in find_lines(noise, RATE_HZ))


@pytest.mark.deep
def test_noise_alone_has_no_line() -> None:
    random = np.random.default_rng(2)
    found = [line for _ in range(60) for line in find_lines(1e-7 * random.standard_normal(5000), RATE_HZ)]
    assert not [line for line in found if line.significant]


def test_hum_at_the_frequency_of_a_point_is_flagged_and_counted() -> None:
    point = dwell(50.0, 1e-6, np.random.default_rng(3))
    assert Quality.INTERFERENCE in Quality(point.quality)
    assert Quality(point.quality).usable
    assert point.fundamental_errors == pytest.approx(1e-6 / np.sqrt(2), rel=0.05)
    assert point.phase_errors == pytest.approx(point.fundamental_errors / RESPONSE_M, rel=0.05)


@pytest.mark.deep
@pytest.mark.parametrize("size_m", [0.3e-6, 1e-6])
@pytest.mark.parametrize("frequency_hz", [50.0, 100.0, 150.0, 155.0, 160.0, 47.0])
def test_intervals_under_hum_cover_the_truth(frequency_hz: float, size_m: float) -> None:
    random = np.random.default_rng(round(frequency_hz + 1e9 * size_m))
    points = [dwell(frequency_hz, size_m, random) for _ in range(60)]
    z = np.array([(p.fundamental - RESPONSE_M) / p.fundamental_errors for p in points])
    assert np.mean(abs(z) < 1.96) > 0.9
    assert np.sqrt(np.mean(z**2)) < 1.25
    widths = np.array([(p.peak_to_peak - 2 * RESPONSE_M) / p.peak_to_peak_errors for p in points])
    assert np.mean(abs(widths) < 1.96) > 0.9


@pytest.mark.deep
def test_without_the_record_at_rest_hum_goes_unseen() -> None:
    """What the record at rest is for: the same data without it are 70 stated errors off."""
    random = np.random.default_rng(4)
    z = [
        (p.fundamental - RESPONSE_M) / p.fundamental_errors
        for p in (dwell(50.0, 1e-6, random, rest=False) for _ in range(10))
    ]
    assert np.sqrt(np.mean(np.square(z))) > 20


@pytest.mark.deep
def test_off_the_mains_hum_is_fitted_and_costs_no_accuracy() -> None:
    random = np.random.default_rng(5)
    points = [dwell(47.0, 1e-6, random) for _ in range(10)]
    assert max(p.fundamental_errors for p in points) < 5e-9
    assert all(p.noise < 1.1e-7 for p in points)
    assert not any(Quality.INTERFERENCE in Quality(p.quality) for p in points)


@pytest.mark.deep
def test_without_hum_the_error_at_the_mains_is_hardly_larger() -> None:
    random = np.random.default_rng(6)
    errors = [dwell(50.0, 0.0, random).fundamental_errors for _ in range(20)]
    assert np.median(errors) < 1.5e-7 * np.sqrt(2 / 2500)


def test_a_folded_line_at_the_frequency_is_flagged_as_folded() -> None:
    line = InterferenceLine(100.0, 20e-6, 1e-9, folded_from_hz=4900.0)
    t = np.arange(2500) / RATE_HZ
    drive_v, moved = 2.5 + 2.5 * np.sin(2 * np.pi * 100 * t), RESPONSE_M * np.sin(2 * np.pi * 100 * t)
    moved = moved + 20e-6 * np.sin(2 * np.pi * 4900 * t)
    recording = Recording(
        0, (0, 2500), RATE_HZ, Sine(100.0, 2.5, 2.5, 1000), drive_v, moved, Quality.GOOD, interference=(line,)
    )
    point = sine_point([recording], simulated=False)
    assert Quality.FOLDED in Quality(point.quality)
    assert abs(point.fundamental - RESPONSE_M) < 2 * point.fundamental_errors


def test_the_paper_s_frequencies_can_be_moved_off_the_mains() -> None:
    assert SineDwell().dwell_frequencies_hz == SineDwell().frequencies_hz
    moved = SineDwell(mains_shift_hz=3.0).dwell_frequencies_hz
    assert moved[:6] == (25.0, 47.0, 75.0, 97.0, 125.0, 147.0)
    assert all(min(f % mains, mains - f % mains) >= 3 for f in moved for mains in (50, 60) if f > 40)
    assert [entry.key for entry in SineDwell(mains_shift_hz=3.0).plan(2.5)][1] == (47.0,)


@pytest.mark.one_in(1)
@pytest.mark.parametrize("true_hz", [4900.0, 100.0, 9876.5, 30_050.0])
def test_a_second_rate_tells_a_folded_line_from_a_genuine_one(true_hz: float) -> None:
    random = np.random.default_rng(round(true_hz))
    seen = []
    for rate_hz in (RATE_HZ, 0.87 * RATE_HZ):
        t = np.arange(round(rate_hz)) / rate_hz + random.uniform(0, 1)
        moved = 20e-6 * np.sin(2 * np.pi * true_hz * t) + 0.3e-6 * np.sin(2 * np.pi * 50 * t)
        seen.append(find_lines(moved + 1e-7 * random.standard_normal(t.size), rate_hz))
    folded = folded_frequencies(seen[0], RATE_HZ, seen[1], 0.87 * RATE_HZ, 1.0)
    if true_hz < RATE_HZ / 2:
        assert not folded
    else:
        assert list(folded.values()) == pytest.approx([true_hz], abs=0.1)


def test_hum_between_high_orders_of_a_waveform_with_a_kink_is_removed_alone() -> None:
    """5.5 loops at 2 Hz of an amplifier with two slopes: of orders 24 and 26 that are not fitted, 21 nm leak into the line at 50 Hz."""
    t = np.arange(round(5.5 / 2.0 * RATE_HZ)) / RATE_HZ
    turn = 2 * np.pi * 2.0 * t
    loop = 0.56e-6 * (400 * np.sin(turn) + 200 * np.abs(np.sin(turn)))
    moved = loop + 150e-9 * np.sin(2 * np.pi * 50.0 * t + 0.7)
    line = InterferenceLine(50.0, 150e-9, 1e-9, 1e-3, phase_rad=0.0)
    left, coincident = remove_lines(moved, RATE_HZ, 2.0, (line,))
    assert not coincident
    removed = moved - left
    wrong = removed - (moved - loop)
    assert np.abs(wrong).max() < 8e-9
