"""Levels, steps, ramps, sines and peaks of signals without noise: the numbers that they were made of come back."""

import numpy as np
import pytest

from protocols.base import InterferenceLine
from protocols.signals import peak, sine
from protocols.signals.held_level import MIN_SAMPLES, estimate_level, estimate_step, find_ramp, weighted_fit
from protocols.signals.sine import fit_sine


@pytest.mark.one_in(1)
@pytest.mark.parametrize("mains_hz", [50.0, 60.0])
@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("phase", [0.0, np.pi / 2])
def test_mains_of_every_order_and_phase_leave_a_level_as_it_is(mains_hz: float, order: int, phase: float) -> None:
    rate_hz, n = 2000.0, 230  # no whole number of cycles
    t = np.arange(n) / rate_hz
    level = 0.7 + 0.3 * (t - t.mean()) + 5.0 * np.sin(2 * np.pi * order * mains_hz * t + phase)
    seen = estimate_level(level, rate_hz, mains_hz)
    assert seen.value == pytest.approx(0.7, abs=1e-9)
    assert seen.drift_per_s == pytest.approx(0.3, abs=1e-7)
    assert seen.noise < 1e-9
    assert seen.standard_error < 1e-9


def test_without_mains_a_level_keeps_them() -> None:
    t = np.arange(230) / 2000.0
    assert estimate_level(np.sin(2 * np.pi * 50 * t), 2000.0, None).noise > 0.1
    assert estimate_level(np.sin(2 * np.pi * 200 * t), 2000.0).noise > 0.1  # the fourth order is none of the mains'


def test_orders_beyond_the_sample_rate_are_left_out_of_a_level() -> None:
    t = np.arange(60) / 300.0
    seen = estimate_level(2.0 + np.sin(2 * np.pi * 100 * t), 300.0)
    assert seen.value == pytest.approx(2.0, abs=1e-9)


def test_the_fewest_samples_of_a_level_are_enough() -> None:
    assert estimate_level(np.full(MIN_SAMPLES, 3.0), 1000.0).value == pytest.approx(3.0)
    with pytest.raises(ValueError, match=rf"{MIN_SAMPLES}"):
        estimate_level(np.full(MIN_SAMPLES - 1, 3.0), 1000.0)


@pytest.mark.parametrize(("guard_s", "before"), [(0.06, 0.0), (0.0, None)])
def test_a_guard_keeps_what_moves_before_the_step_out_of_its_zero(guard_s: float, before: float | None) -> None:
    t = np.arange(3000) / 1000.0
    moved = np.interp(t, [0.95, 1.0], [0.0, 3.0])
    step = estimate_step(moved, 1000.0, 1.0, 1.0, guard_s=guard_s)
    assert step.after.value == pytest.approx(3.0)
    if before is None:
        assert step.before.value > 0.3
    else:
        assert step.before.value == pytest.approx(before, abs=1e-9)
        assert step.value == pytest.approx(3.0)


@pytest.mark.parametrize("levels", [(2.5, 4.0), (2.5, 1.0)])
def test_a_ramp_is_found_where_it_is(levels: tuple[float, float]) -> None:
    t = np.arange(1000) / 1000.0
    ramp = find_ramp(np.interp(t, [0.2, 0.5], levels), 1000.0, 0.3, 0.1)
    assert (ramp.begin_s, ramp.end_s) == pytest.approx((0.2, 0.5), abs=0.0015)
    assert (ramp.start_level_v, ramp.end_level_v) == pytest.approx(levels)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("step_v", "found"), [(0.09, False), (-0.09, False), (0.2, True), (-0.2, True)])
def test_a_ramp_is_one_beyond_ten_deviations_of_the_noise(step_v: float, found: bool) -> None:
    t = np.arange(1000) / 1000.0
    noise_v = 0.01 * (-1.0) ** np.arange(1000)
    ramp = find_ramp(np.interp(t, [0.2, 0.5], [2.5, 2.5 + step_v]) + noise_v, 1000.0, 0.3, 0.1)
    assert (ramp.begin_s, ramp.end_s) == pytest.approx((0.2, 0.5) if found else (0.7, 0.7), abs=0.03)


def test_two_samples_of_rest_and_four_of_level_are_the_fewest_of_a_ramp() -> None:
    drive_v = np.array([0.0, 0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0])
    assert find_ramp(drive_v, 1.0, 4.0, 2.0).end_level_v == pytest.approx(3.0)
    assert find_ramp(drive_v, 1.0, 6.0, 2.0).start_level_v == pytest.approx(0.0)
    for hold_s, rest_s in ((3.0, 2.0), (4.0, 1.0), (7.0, 2.0)):
        with pytest.raises(ValueError, match="a record of 8 s holds no"):
            find_ramp(drive_v, 1.0, hold_s, rest_s)


@pytest.mark.parametrize(("scatter", "widened"), [(0.0, 1.0), (0.5, 1.0), (1.7, 1.0), (1.9, 1.9), (3.0, 3.0)])
def test_significant_scatter_widens_the_errors_of_a_weighted_line(scatter: float, widened: float) -> None:
    """Of chi-square with 4 degrees of freedom 1 % is above 13.28, 1.82 squared times 4."""
    x, error = np.arange(6.0), 0.1
    bend = np.array([1, -2, 1, 1, -2, 1]) * np.sqrt(4 / 12)  # beside every line, and with 4 degrees of freedom
    (offset, slope), covariance = weighted_fit(
        (np.ones(6), x), 2 + 3 * x + scatter * error * bend, np.full(6, 1 / error)
    )
    assert (offset, slope) == pytest.approx((2, 3))
    assert np.sqrt(covariance[1, 1]) == pytest.approx(widened * error / np.sqrt(17.5))


@pytest.mark.parametrize("samples", [700, sine.CHUNK_SAMPLES + 700])
def test_a_sine_with_harmonics_and_drift_is_taken_apart(samples: int) -> None:
    rate_hz, frequency_hz = 10_000.0, 130.0
    t = np.arange(samples) / rate_hz
    parts = np.array([1.0 - 0.5j, 0.02 + 0.03j, -0.01j])
    wave = sum(
        part.real * np.sin(2 * np.pi * (k + 1) * frequency_hz * t)
        + part.imag * np.cos(2 * np.pi * (k + 1) * frequency_hz * t)
        for k, part in enumerate(parts)
    )
    fit = fit_sine(0.4 + 0.2 * (t - t.mean()) + wave, rate_hz, frequency_hz, 3)
    np.testing.assert_allclose(fit.components, parts, atol=1e-9)
    assert fit.fundamental == pytest.approx(1.0 - 0.5j)
    assert fit.thd == pytest.approx(np.sqrt((0.02**2 + 0.03**2 + 0.01**2) / 1.25))
    assert (fit.offset, fit.drift_per_s) == pytest.approx((0.4, 0.2))
    assert fit.noise < 1e-9


def test_the_standard_error_of_a_sine_is_the_spread_of_many() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(400) / 4000.0
    fits = [
        fit_sine(np.sin(2 * np.pi * 200 * t) + 0.1 * rng.standard_normal(t.size), 4000.0, 200.0) for _ in range(300)
    ]
    spread = float(np.std([abs(fit.fundamental) for fit in fits]))
    assert fits[0].standard_error == pytest.approx(spread, rel=0.2)


def test_a_resonance_without_noise_is_found_exactly() -> None:
    f = np.linspace(180.0, 220.0, 41)
    natural_hz, damping = 200.0, 0.1
    power = 9.0 / ((natural_hz**2 - f**2) ** 2 + (2 * damping * natural_hz * f) ** 2)
    seen = peak._fit_peak(f, power, 0.0)
    top_hz = natural_hz * np.sqrt(1 - 2 * damping**2)
    assert seen.frequency_hz == pytest.approx(top_hz, rel=1e-9)
    assert seen.height == pytest.approx(3.0 / (2 * damping * natural_hz**2 * np.sqrt(1 - damping**2)), rel=1e-9)
    assert seen.standard_error_hz < 1e-6
    assert seen.degrees_of_freedom == 36  # 41 lines, five unknowns
    assert seen.band_hz == (180.0, 220.0)


@pytest.mark.deep
@pytest.mark.one_in(1)
@pytest.mark.parametrize("shared", [0.0, 0.6])
def test_the_standard_error_of_a_peak_is_the_spread_of_many(shared: float) -> None:
    """Of lines whose noise is independent, or shared by neighbours."""
    rng = np.random.default_rng(7)
    f = np.linspace(180.0, 220.0, 41)
    power = 1.0 / ((200.0**2 - f**2) ** 2 + (40.0 * f) ** 2)
    noise = 0.05 * np.array(
        [np.convolve(each, [1.0, shared], "valid") for each in rng.standard_normal((300, f.size + 1))]
    )
    seen = [peak._fit_peak(f, power * np.exp(each), shared / (1 + shared**2)) for each in noise]
    spread = float(np.std([each.frequency_hz for each in seen]))
    assert np.mean([each.standard_error_hz for each in seen]) == pytest.approx(spread, rel=0.2)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ({5: 9.0, 6: 8.0, 4: 8.0}, "in a peak only 3 lines wide"),
        ({0: 9.0, 1: 8.0, 2: 8.0, 3: 8.0}, r"no peak within 125\.\.500 Hz: .* at its edge, 0 Hz; move the band"),
        ({19: 9.0, 18: 8.0, 17: 8.0, 16: 8.0}, r"no peak within 125\.\.500 Hz: .* at its edge, 19 Hz; move the band"),
        (dict.fromkeys(range(20), 9.0), "nowhere falls to half of its largest power"),
        ({}, "is zero in"),
    ],
)
def test_lines_without_a_usable_peak_are_refused(lines: dict[int, float], message: str) -> None:
    power = np.full(20, 1.0 if lines else 0.0)
    for line, value in lines.items():
        power[line] = value
    with pytest.raises(ValueError, match=message):
        peak._half_power_lines(np.arange(20.0), power, peak.PEAK_BAND_HZ, "response")


def test_the_half_power_lines_of_a_peak_are_those_above_half_of_its_largest() -> None:
    power = 10.0 - np.abs(np.arange(20) - 9.0)
    assert peak._half_power_lines(np.arange(20.0), power, peak.PEAK_BAND_HZ, "response") == slice(4, 15)


def test_pieces_of_a_spectrum_may_reach_to_half_the_sample_rate() -> None:
    t = np.arange(8000) / 1000.0
    ringing = np.exp(-40.0 * t) * np.sin(2 * np.pi * 150.0 * t)
    band_hz = 20.0, 499.9
    joined = peak.joined_spectrum_peak([ringing, ringing], 1000.0, [(20.0, 250.0), (250.0, 499.9)], band_hz)
    whole = peak.joined_spectrum_peak([ringing], 1000.0, [band_hz], band_hz)
    assert joined.frequency_hz == pytest.approx(whole.frequency_hz, rel=1e-6)
    assert whole.frequency_hz == pytest.approx(150.0, rel=0.01)


def test_no_line_of_a_spectrum_in_pieces_is_counted_twice() -> None:
    t = np.arange(4000) / 1000.0
    ringing = np.exp(-40.0 * t) * np.sin(2 * np.pi * 150.0 * t)
    shares = (50.0, 150.0), (150.0, 400.0)
    lines = [peak._PieceSpectrum(ringing, None, 1000.0, *share).lines(2.0, beyond=True)[0] for share in shares]
    assert all(
        low <= f.min() <= low + 2.0 and high - 2.0 <= f.max() < high
        for f, (low, high) in zip(lines, shares, strict=True)
    )


def test_a_spectrum_is_divided_by_that_of_its_drive() -> None:
    t = np.arange(4000) / 1000.0
    ringing = np.exp(-40.0 * t) * np.sin(2 * np.pi * 150.0 * t)
    falling = np.exp(-t / 0.002)  # a drive whose lines fall by a half within the band
    band_hz = 50.0, 400.0
    driven = np.convolve(ringing, falling)[: t.size]
    alone, divided, weighted = (
        peak.joined_spectrum_peak([samples], 1000.0, [band_hz], band_hz, drives=drives).frequency_hz
        for samples, drives in ((ringing, ()), (driven, [falling]), (driven, ()))
    )
    assert divided == pytest.approx(alone, rel=1e-4)
    assert weighted < alone - 0.1


@pytest.mark.parametrize("side", [1, -1])
def test_the_peak_of_a_dwell_is_drawn_from_the_highest_neighbours_of_its_highest_point(side: int) -> None:
    u = np.arange(200.0**2 - 8000, 200.0**2 + 8001, 2000.0)  # of an even scale of squared frequencies
    y = (1.0 + ((u - 200.0**2 - 300 * side) / 3000.0) ** 2) ** -0.5
    y[np.abs(u - 200.0**2 - 300 * side) > 4500] *= 0.5  # another law further away
    order = slice(None, None, side)
    found = peak.dwell_peak(np.sqrt(u)[order], y[order], 1e-9 * y[order])
    assert found is not None
    assert found.frequency_hz == pytest.approx(np.sqrt(200.0**2 + 300 * side), rel=1e-9)
    assert found.frequency_error_hz < 1e-3


@pytest.mark.parametrize("amplitude", [0.0, 0.2])
def test_a_line_too_slow_for_a_level_to_show_is_in_its_error(amplitude: float) -> None:
    rate_hz, n = 1000.0, 100
    t = np.arange(n) / rate_hz
    line = InterferenceLine(1.0, amplitude, 1e-6)
    seen = [
        estimate_level(2.0 + amplitude * np.sin(2 * np.pi * t + phase), rate_hz, None, [line])
        for phase in np.linspace(0.0, 2 * np.pi, 40, endpoint=False)
    ]
    wrong = float(np.sqrt(np.mean([(each.value - 2.0) ** 2 for each in seen])))
    assert np.mean([each.standard_error for each in seen]) == pytest.approx(wrong, rel=0.1, abs=1e-9)
