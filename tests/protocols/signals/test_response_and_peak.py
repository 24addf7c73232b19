"""Frequency response and resonance peak: against the model's exact answer to a sweep, and statistically."""

import functools

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.signal import butter, sosfiltfilt

from drivers.drive_shapes import LinearSweep
from model.beam.poles import ModalForm
from model.parameters import Tactor
from model.response.harmonic_response import frequency_response, poles
from protocols.signals.modal_fit import fit_sdof
from protocols.signals.peak import PEAK_BAND_HZ, SpectralPeak, dwell_peak, joined_spectrum_peak, response_peak
from protocols.signals.periodic_response import estimate_periodic_response
from protocols.signals.response import FrequencyResponse
from protocols.signals.swept_response import CORRECTED_VARIANCE, estimate_swept_response
from tests.helpers.coverage import coverage_factor
from tests.helpers.model.multisine import Multisine
from tests.helpers.model.sweep_response import sweep_response as exact_sweep
from tests.helpers.sampled import march

RATE = 5000.0
N = 3
"""Shapes of the model; its exact answer to a sweep costs two complex error functions a pole, harmonic and sample."""
SWEEP = LinearSweep(25.0, 525.0, 20.0, 2.5, 2.5)
TIME = np.arange(round(SWEEP.duration_s * RATE)) / RATE
FUNDAMENTAL = 400.0
"""Volts on the specimen per volt at the input that the two-slope amplifier gives the fundamental: (200 + 600) / 2."""


@functools.cache
def bench(start_hz: float = 25.0, stop_hz: float = 525.0) -> tuple[np.ndarray, np.ndarray]:
    """Drive and the model's exact displacement, four harmonics of the amplifier included."""
    drive = LinearSweep(start_hz, stop_hz, 20.0, 2.5, 2.5).volts(TIME)
    return drive, exact_sweep(Tactor(), TIME, start_hz, stop_hz, 20.0, n=N, orders=4)


def half_width(found: FrequencyResponse) -> np.ndarray:
    """(F,), to either side of the modulus: holds the truth in 95 of 100 cases, line by line."""
    return coverage_factor(found.degrees_of_freedom, 0.95) * found.errors


def spectrum_peak(moved: np.ndarray, band_hz: tuple[float, float] = PEAK_BAND_HZ) -> SpectralPeak:
    return joined_spectrum_peak([moved], RATE, [band_hz], band_hz)


@functools.cache
def true_peak_hz(tactor: Tactor = Tactor()) -> float:  # noqa: B008 - frozen
    return float(
        minimize_scalar(
            lambda f: -abs(frequency_response(tactor, [f], n=N)[0]),
            bounds=(100, 400),
            method="bounded",
            options={"xatol": 1e-7},
        ).x
    )


@pytest.mark.parametrize(("start_hz", "stop_hz"), [(25.0, 525.0), pytest.param(525.0, 25.0, marks=pytest.mark.deep)])
def test_a_sweep_gives_the_response_of_the_model(start_hz: float, stop_hz: float) -> None:
    drive, moved = bench(start_hz, stop_hz)
    rng = np.random.default_rng(1)
    found = estimate_swept_response(drive, moved + 5e-7 * rng.standard_normal(moved.size), RATE, (25, 525)).within(
        60, 480
    )
    exact = FUNDAMENTAL * frequency_response(Tactor(), found.x, n=N)
    gap = np.abs(found.y / exact - 1)
    assert np.median(gap) < 1e-3
    assert gap.max() < 0.02
    within = np.abs(found.plotted - np.abs(exact)) <= half_width(found)
    assert within.mean() > 0.93  # the lowest lines state more than they err: a fast sweep's harmonic is near
    assert 0.92 < within[found.x > 160].mean() < 0.985
    assert found.coherence.min() > 0.99


@pytest.mark.deep
def test_the_harmonics_of_the_amplifier_are_not_taken_for_noise() -> None:
    drive, moved = bench()
    found = estimate_swept_response(drive, moved, RATE, (25, 525)).within(110, 450)
    assert np.median(found.errors / found.plotted) < 5e-4  # the second harmonic alone is 15 % of the spectrum


def two_modes() -> ModalForm:
    s = np.array([-0.211 + 0.977j, -0.211 - 0.977j]) * 2 * np.pi * 158.3
    r = np.array([-0.5j, 0.5j]) * 1e-3
    return ModalForm(s, r)


@pytest.mark.deep
def test_error_bars_of_a_sweep_cover_and_are_no_wider_than_they_must() -> None:
    rng = np.random.default_rng(2)
    n, sigma, seeds = 1 << 15, 2e-8, 30
    t = np.arange(n) / RATE
    drive = LinearSweep(25.0, 525.0, t[-1], 1.0, 0.0).volts(t)
    clean = march(two_modes(), drive, RATE)
    without = estimate_swept_response(drive, clean, RATE, (50, 500))
    noisy = [
        estimate_swept_response(drive, clean + sigma * rng.standard_normal(n), RATE, (50, 500)) for _ in range(seeds)
    ]
    scatter = np.stack([r.plotted for r in noisy]).std(0, ddof=1)
    stated = np.stack([r.errors for r in noisy])
    assert np.sqrt(np.mean(scatter**2 / np.mean(stated**2, 0))) == pytest.approx(1, abs=0.05)
    inside = np.mean([np.mean(np.abs(r.plotted - without.plotted) <= half_width(r)) for r in noisy])
    assert 0.93 < inside < 0.97
    # Cramer-Rao: a line is a Hann-weighted mean of bins; 1.5 is what the weighting costs against equal weights, and a
    # quarter more that what it blunts is taken out again.
    X = np.fft.rfft(drive)
    in_line = round(without.resolution_hz * n / RATE)
    k = round(250 * n / RATE)
    bound = np.sqrt(
        1.5 * CORRECTED_VARIANCE * n * sigma**2 / 2 / np.sum(np.abs(X[k - in_line // 2 : k + in_line // 2]) ** 2)
    )
    here = scatter[np.abs(without.x - 250) < 100].mean()
    assert here == pytest.approx(bound, rel=0.05)


def test_lines_as_wide_as_a_quarter_of_the_resonance_do_not_blunt_it() -> None:
    t = np.arange(1 << 15) / RATE
    drive = LinearSweep(25.0, 525.0, t[-1], 1.0, 0.0).volts(t)
    moved = march(two_modes(), drive, RATE)
    fine, coarse = (estimate_swept_response(drive, moved, RATE, (50, 500), width) for width in (5.0, 16.0))
    there = coarse.within(100, 250)
    exact = np.interp(there.x, fine.x, fine.plotted)
    assert np.abs(there.plotted / exact - 1).max() < 1e-3  # a Hann line alone blunts the peak by 6e-3


def test_the_outermost_lines_of_a_faded_sweep_are_those_of_a_wider_one() -> None:
    t = np.arange(1 << 16) / RATE

    def lines(start_hz: float, stop_hz: float, fade_s: float) -> FrequencyResponse:
        drive = LinearSweep(start_hz, stop_hz, 12.0, 1.0, 0.0, fade_s).volts(t)
        moved = march(two_modes(), drive, RATE, "linear")
        return estimate_swept_response(drive, moved, RATE, (start_hz, stop_hz), 3.0, fade_s=fade_s)

    wide = lines(25.0, 525.0, 0.3)
    worst = []
    for fade_s in (0.55, 0.0):
        narrow = lines(75.0, 165.0, fade_s)
        assert narrow.x[-1] > 157
        worst.append(np.abs(narrow.y / CubicSpline(wide.x, wide.y)(narrow.x) - 1).max())
    assert worst[0] < 1e-4 < 2e-4 < worst[1], "an end at full amplitude is as broad as ten lines"


def test_periods_that_repeat_tell_the_response_and_its_error() -> None:
    rng = np.random.default_rng(3)
    design = Multisine.between(25, 525, 1.0, 1.0)
    period = design.samples(RATE)
    drive = np.tile(period, 7)
    clean = march(two_modes(), drive, RATE, "linear")
    sigma, seeds = 2e-8, 40
    found = [
        estimate_periodic_response(drive, clean + sigma * rng.standard_normal(clean.size), RATE, 1.0, (25, 525))
        for _ in range(seeds)
    ]
    form, f = two_modes(), found[0].x
    assert f.tolist() == design.frequency_hz.tolist()
    exact = (form.residues / (2j * np.pi * f[:, None] - form.poles)).sum(1)
    gaps = np.stack([r.plotted for r in found]) - np.abs(exact)
    # `march` has straight lines between samples, a band-limited drive has none: (pi f / rate)^2 / 3 of the response
    gaps -= (np.sinc(f / RATE) ** 2 - 1) * np.abs(exact) * 0.5
    bound = sigma / np.abs(np.fft.rfft(period)[design.lines]) * np.sqrt(period.size / 2 / 6)
    assert np.mean(gaps.std(0) / bound) == pytest.approx(1, abs=0.05)
    inside = np.mean([np.mean(np.abs(g) <= half_width(r)) for g, r in zip(gaps, found, strict=True)])
    assert 0.93 < inside < 0.97
    assert found[0].degrees_of_freedom == 5 * 10  # five lines share their noise
    assert np.mean([r.errors for r in found], 0) == pytest.approx(gaps.std(0), rel=0.6)
    assert np.sqrt(np.mean([r.errors**2 for r in found])) == pytest.approx(gaps.std(), rel=0.05)


def test_second_harmonics_of_an_inverting_sweep_are_no_lines_of_the_response() -> None:
    """The generator's second harmonic, 1 %, moves even lines by the amplifier's, which is much larger than the response there."""
    rng = np.random.default_rng(5)
    n, f = 5000, np.arange(25, 525, 2)
    H = 1e-4 / (1 - (f / 158.3) ** 2 + 0.42j * f / 158.3)
    X, Y = np.zeros((2, n // 2 + 1), complex)
    X[f] = np.exp(2j * np.pi * rng.random(f.size))
    Y[f] = X[f] * H
    X[f + 1], Y[f + 1] = 0.02 * X[f], 0.2 * Y[f[0]]
    drive, moved = (np.tile(np.fft.irfft(lines), 7) for lines in (X, Y))
    found = estimate_periodic_response(drive, moved, 5000.0, 1.0, (20, 530))
    assert found.x.tolist() == f.tolist()
    assert np.abs(found.y / H - 1).max() < 1e-6


def test_a_source_with_another_clock_does_not_mix_the_second_harmonic_into_the_lines() -> None:
    """The amplifier moves the even lines between those of the drive; the source is 14 ppm fast."""
    rng = np.random.default_rng(6)
    fast, n = 1 + 14e-6, np.arange(35_000)
    f = np.arange(25, 325, 2) * fast
    H = 1e-4 / (1 - (f / 158.3) ** 2 + 0.42j * f / 158.3)
    drive, moved = np.zeros((2, n.size))
    for line, response in zip(f, H, strict=True):
        turn, even = (np.exp(2j * np.pi * (hertz / 5000 * n + rng.random())) for hertz in (line, line + fast))
        drive += turn.real
        moved += (response * turn + 2e-5 * even).real
    found = estimate_periodic_response(drive, moved, 5000.0, 1.0, (20, 330))
    assert found.x == pytest.approx(f, rel=1e-8)
    assert np.abs(found.y - H).max() < 1e-8  # 2e-7 with both records on the card's clock


@pytest.mark.one_in(100)
@pytest.mark.parametrize("damping", [0.2, 0.003])
def test_what_repeats_with_every_period_is_in_the_error_bars(damping: float) -> None:
    """A card that folds back, odd harmonics: they repeat in every period. A resonance is not mistaken for them, however narrow."""
    rng = np.random.default_rng(8)
    f = np.arange(25.0, 525.0, 2.0)
    H = 1e-4 / (1 - (f / 158.3) ** 2 + 2j * damping * f / 158.3)
    inside, stated, n = [], [], 5000
    for share in (0.0, 1e-3):
        for _ in range(20):
            U = np.exp(2j * np.pi * rng.random(f.size))
            wrong = share * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
            X, Y = np.zeros((2, n // 2 + 1), complex)
            X[f.astype(int)], Y[f.astype(int)] = U, U * H * (1 + wrong)
            period = np.fft.irfft(X), np.fft.irfft(Y)
            noise = 1e-6 * rng.standard_normal(7 * n) / n
            found = estimate_periodic_response(
                np.tile(period[0], 7), np.tile(period[1], 7) + noise, 5000.0, 1.0, (20, 530)
            )
            inside.append(np.abs(found.plotted - np.abs(H)) <= half_width(found))
            stated.append(found.errors / np.abs(H))
        assert 0.925 < np.mean(inside[-20:]) < 0.975
    assert np.median(stated[20:]) > 3 * np.median(stated[:20])


@pytest.mark.deep
def test_a_clock_that_runs_away_drops_out_of_a_periodic_response() -> None:
    design = Multisine.between(50, 500, 0.5, 1.0)
    t = np.arange(20_000) / RATE * (1 + 50e-6)
    waves = np.exp(2j * np.pi * np.outer(t, design.frequency_hz))
    H = 1 / (1 - (design.frequency_hz / 158) ** 2 + 0.42j * design.frequency_hz / 158)
    drive, moved = (waves @ np.exp(1j * design.phases)).real, (waves @ (H * np.exp(1j * design.phases))).real
    found = estimate_periodic_response(drive, moved, RATE, 0.5, (50, 500))
    assert np.abs(found.y / H - 1).max() < 2e-3


@pytest.mark.deep
def test_a_given_delay_is_taken_out() -> None:
    drive, moved = bench()
    late = 5
    plain = estimate_swept_response(drive, moved, RATE, (25, 525)).within(60, 480)
    removed = estimate_swept_response(drive[late:], moved[:-late], RATE, (25, 525), delay_s=late / RATE).within(60, 480)
    assert np.abs(removed.y / plain.y - 1).max() < 0.02
    assert np.median(np.abs(removed.y / plain.y - 1)) < 1e-3


@pytest.mark.one_in(2)
@pytest.mark.parametrize("grams", [1.75, 9.75])
def test_the_peak_is_where_the_model_has_it(grams: float) -> None:
    tactor = Tactor(m_add=grams * 1e-3)
    drive = SWEEP.volts(TIME)
    moved = exact_sweep(tactor, TIME, duration_s=20.0, n=N, orders=2)
    rng = np.random.default_rng(4)
    noisy = moved + 5e-7 * rng.standard_normal(moved.size)
    truth = true_peak_hz(tactor)
    peak, paper = response_peak(estimate_swept_response(drive, noisy, RATE, (25, 525))), spectrum_peak(noisy)
    assert (
        abs(peak.frequency_hz - truth) < coverage_factor(peak.degrees_of_freedom, 0.999) * peak.standard_error_hz + 2e-3
    )
    assert abs(paper.frequency_hz - truth) < 0.05
    response = estimate_swept_response(drive, noisy, RATE, (25, 525))
    assert peak.height == pytest.approx(FUNDAMENTAL * abs(frequency_response(tactor, [truth], n=N)[0]), rel=1e-3)
    mode = fit_sdof(*lines(response.within(0.7 * truth, 1.4 * truth)))
    pole = poles(tactor, n=N)[0]
    assert mode.natural_hz == pytest.approx(abs(pole) / 2 / np.pi, rel=1e-3)
    assert mode.damping_ratio == pytest.approx(-pole.real / abs(pole), rel=5e-3)


def lines(r: FrequencyResponse) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    return r.x, r.y, r.errors, r.correlation


@pytest.mark.deep
def test_the_highest_bin_is_an_accident_and_the_fit_is_not() -> None:
    _, moved = bench()
    f = np.fft.rfftfreq(moved.size, 1 / RATE)
    inside = (f > 125) & (f < 500)
    highest = f[inside][np.abs(np.fft.rfft(moved))[inside].argmax()]
    assert abs(highest - true_peak_hz()) > 1.0
    assert abs(spectrum_peak(moved).frequency_hz - true_peak_hz()) < 0.1


@pytest.mark.deep
def test_the_low_pass_of_the_paper_does_not_move_the_peak() -> None:
    _, moved = bench()
    low_pass = butter(8, 600.0, fs=RATE, output="sos")
    plain, filtered = spectrum_peak(moved), spectrum_peak(sosfiltfilt(low_pass, moved))
    assert filtered.frequency_hz == pytest.approx(plain.frequency_hz, abs=1e-4)


@pytest.mark.deep
def test_the_stated_error_of_a_peak_covers_and_is_near_the_bound() -> None:
    rng = np.random.default_rng(5)
    n, sigma, seeds = 1 << 14, 2e-8, 240
    t = np.arange(n) / RATE
    drive = LinearSweep(25.0, 525.0, t[-1], 1.0, 0.0).volts(t)
    clean = march(two_modes(), drive, RATE)
    without = response_peak(estimate_swept_response(drive, clean, RATE, (50, 500)), (100, 300)).frequency_hz
    found: list[SpectralPeak] = [
        response_peak(
            estimate_swept_response(drive, clean + sigma * rng.standard_normal(n), RATE, (50, 500)), (100, 300)
        )
        for _ in range(seeds)
    ]
    values = np.array([p.frequency_hz for p in found])
    errors = np.array([p.standard_error_hz for p in found])
    assert abs(values.mean() - without) < 4 * values.std() / np.sqrt(seeds)
    inside = np.mean(
        [abs(p.frequency_hz - without) <= coverage_factor(p.degrees_of_freedom) * p.standard_error_hz for p in found]
    )
    assert 0.92 < inside < 0.98, "two standard deviations of 240 seeds"
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(values.std(), rel=0.12)
    # Cramer-Rao for the same curve, third degree in f^2, from all bins of the half-power width, modulus only.
    f, X = np.fft.rfftfreq(n, 1 / RATE), np.fft.rfft(drive)
    low, high = found[0].band_hz
    used = (f >= low) & (f <= high)
    H = (two_modes().residues / (2j * np.pi * f[used, None] - two_modes().poles)).sum(1)
    v = (f[used] ** 2 - without**2) / 1e4
    basis = np.vander(v, 4, increasing=True)  # of log |H|
    weight = np.abs(H * X[used]) ** 2 / (n * sigma**2 / 2)
    covariance = np.linalg.inv((basis * weight[:, None]).T @ basis)
    curvature = np.polyfit(v, np.log(np.abs(H)), 3)[1] * 2
    bound = np.sqrt(covariance[1, 1]) / abs(curvature) * 1e4 / (2 * without)
    assert values.std() == pytest.approx(bound, rel=0.25)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"resolution_hz": 0.1}, "a sweep of 20 s gives lines of 1.6 Hz, not 0.1 Hz"),
        ({"band_hz": (25, 3000)}, "within 0..2500 Hz"),
        ({"displacement": np.full(100_000, np.nan)}, "100000 of 100000 samples are not finite"),
        ({"displacement": np.zeros(10)}, "has 10 samples, at least 128"),
        ({"displacement": np.zeros(99_999)}, "must be of the same scans"),
        ({"drive": np.full(100_000, 2.5)}, "the drive is constant at 2.5: check"),
        (
            {"drive": np.random.default_rng(7).standard_normal(100_000)},
            "% of the recorded drive's power lies between 25 and",
        ),
    ],
)
def test_a_sweep_that_cannot_be_used_is_refused(change: dict, message: str) -> None:
    drive, moved = bench()
    with pytest.raises(ValueError, match=message):
        estimate_swept_response(
            **({"drive": drive, "displacement": moved, "rate_hz": RATE, "band_hz": (25, 525)} | change)
        )


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("period_s", "dropped", "message"),
    [
        (1.00003, 1, "must be a whole number"),
        (1.0, 5, "at least two must remain"),
        (0.5, -1, "at least two must remain"),
    ],
)
def test_periods_that_cannot_be_used_are_refused(period_s: float, dropped: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        estimate_periodic_response(np.ones(30_000), np.ones(30_000), RATE, period_s, (25, 525), dropped)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.random.default_rng(6).standard_normal(100_000), r"is largest at .* Hz, in a peak only \d lines wide"),
        (np.zeros(100_000), "is zero in 125..500 Hz"),
        (np.full(100_000, np.nan), "100000 of 100000 samples are not finite"),
        (np.zeros(100), "has 100 samples, at least 256"),
    ],
)
def test_no_peak_is_no_number(samples: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        spectrum_peak(samples)


def test_a_peak_outside_the_band_is_not_taken_for_one_at_its_edge() -> None:
    _, moved = bench()
    with pytest.raises(ValueError, match=r"no peak within 180..500 Hz: .* at its edge"):
        spectrum_peak(moved, (180.0, 500.0))


def test_a_peak_between_the_points_of_a_dwell_is_as_uncertain_as_it_is_wrong() -> None:
    best = minimize_scalar(
        lambda f: -abs(frequency_response(Tactor(), [f])[0]), bounds=(120, 200), options={"xatol": 1e-7}
    )
    true_hz, ratios = float(best.x), []
    for shift_hz in range(-4, 5):
        f = np.arange(100.0, 230.0, 15.0) + shift_hz
        y = np.abs(frequency_response(Tactor(), f))
        found = dwell_peak(f, y, 1e-9 * y)
        assert found is not None
        assert abs(found.frequency_hz - true_hz) < 0.02
        assert found.frequency_error_hz < 0.02, "a parabola of the amplitude is wrong by a hundred times as much"
        ratios.append((found.frequency_hz - true_hz) / found.frequency_error_hz)
    assert 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.5


@pytest.mark.deep
def test_errors_by_noise_alone_are_the_scatter_of_a_mode_whose_misfit_is_always_the_same() -> None:
    f, rng = np.arange(80.0, 290.0, 2.0), np.random.default_rng(6)
    waved = frequency_response(Tactor(), f) * (1 + 1e-3 * np.exp(0.2j * np.pi * f))
    noise = 1e-5 * abs(waved).max() * np.ones(f.size)
    modes = [
        fit_sdof(f, waved + noise * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)), noise)
        for _ in range(60)
    ]
    scatter = np.std([m.natural_hz for m in modes]), np.std([m.damping_ratio for m in modes])
    assert np.divide(scatter, (modes[0].natural_noise_hz, modes[0].damping_noise)) == pytest.approx(1.0, abs=0.3)
    assert modes[0].natural_error_hz > 5 * scatter[0]


@pytest.mark.deep
def test_a_distortion_that_waves_over_the_lines_is_averaged_out_in_the_error_of_a_mode(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    f = np.arange(80.0, 290.0, 2.0)
    H, rng = frequency_response(Tactor(), f), np.random.default_rng(5)
    waved = H * (1 + 1e-3 * np.exp(0.2j * np.pi * f))
    alike = fit_sdof(f, waved)
    noisy = [
        fit_sdof(f, H + 1e-7 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))) for _ in range(60)
    ]
    monkeypatch.setattr("protocols.signals.modal_fit.MIN_PATTERN_LINES", f.size + 1)
    line_by_line = fit_sdof(f, waved)
    assert abs(alike.natural_hz - abs(poles(Tactor())[0]) / (2 * np.pi)) < alike.natural_error_hz
    assert alike.natural_error_hz < 0.8 * line_by_line.natural_error_hz
    scatter = np.std([m.natural_hz for m in noisy]), np.std([m.damping_ratio for m in noisy])
    stated = [np.sqrt(np.mean([getattr(m, n) ** 2 for m in noisy])) for n in ("natural_error_hz", "damping_error")]
    assert np.divide(scatter, stated) == pytest.approx(1.0, abs=0.25), "white noise"
