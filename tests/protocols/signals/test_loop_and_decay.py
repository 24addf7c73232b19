"""Hysteresis loops, free decays and the multisine, against signals with known parameters."""

import numpy as np
import pytest

from model.parameters import Tactor
from model.response.harmonic_response import poles
from model.response.latency import step_response
from protocols.signals.decay import fit_decay
from protocols.signals.loop import fold, measure_loops
from tests.helpers.coverage import coverage_factor
from tests.helpers.model.multisine import Multisine

RATE = 5000.0


def ellipse(rng: np.random.Generator, cycles: int, lag: float, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    turn = 2 * np.pi * np.arange(cycles * 256) / 256
    return (2.5 + 2 * np.sin(turn)).reshape(cycles, 256), (
        3 * np.sin(turn - lag) + sigma * rng.standard_normal(turn.size)
    ).reshape(cycles, 256)


def test_an_ellipse_has_the_width_and_the_area_of_an_ellipse() -> None:
    loop = measure_loops(*ellipse(np.random.default_rng(1), 3, 0.1, 0.0))
    assert loop.width == pytest.approx(2 * 3 * np.sin(0.1), rel=1e-3)
    assert loop.max_width == pytest.approx(loop.width, rel=1e-3)
    assert loop.stroke == pytest.approx(2 * 3 * np.cos(0.1), rel=1e-3)
    assert loop.area == pytest.approx(np.pi * 2 * 3 * np.sin(0.1), rel=2e-3)
    assert loop.asymmetry == pytest.approx(0, abs=1e-9)
    assert loop.relative_width == pytest.approx(np.tan(0.1), rel=1e-3)


def test_a_loop_that_leads_has_a_negative_area_and_a_fat_top_is_told() -> None:
    assert measure_loops(*ellipse(np.random.default_rng(1), 3, -0.1, 0.0)).area < 0
    x = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0, 50)[1:-1]])
    y = x + np.where(np.arange(98) >= 50, 0.2 * np.clip(x - 0.5, 0, None) * (1 - x), 0)
    assert measure_loops(np.tile(x, (2, 1)), np.tile(y, (2, 1))).asymmetry == pytest.approx(1, abs=0.02)


@pytest.mark.deep
def test_the_errors_of_a_loop_cover() -> None:
    rng = np.random.default_rng(2)
    truth = measure_loops(*ellipse(rng, 2, 0.1, 0.0))
    found = [measure_loops(*ellipse(rng, 3, 0.1, 0.02)) for _ in range(500)]
    for name, freedom in (("width", np.inf), ("stroke", np.inf), ("area", 4), ("asymmetry", 12)):
        factor = coverage_factor(freedom)
        inside = [abs(getattr(f, name) - getattr(truth, name)) <= factor * getattr(f, f"{name}_error") for f in found]
        assert 0.925 < np.mean(inside) < 0.975, name
    areas = np.array([f.area for f in found])
    bound = 2 * 0.02 * np.sqrt(np.pi**2 * 2 / 256 / 3)  # of the quadrature component of a sine fit, times pi times 2
    assert areas.std() == pytest.approx(bound, rel=0.08)
    for name in ("width", "max_width", "stroke", "area", "asymmetry"):
        stated = np.sqrt(np.mean([getattr(f, f"{name}_error") ** 2 for f in found]))
        assert np.std([getattr(f, name) for f in found]) == pytest.approx(stated, rel=0.12), name


def test_noise_of_the_drive_and_of_its_sampling_is_not_in_the_errors_of_a_loop() -> None:
    """Width and stroke are read at levels of the drive: cycles that differ in phase have the same."""
    rng = np.random.default_rng(4)
    turn = 2 * np.pi * np.arange(256) / 256 + 1e-3 * rng.standard_normal((5, 1))
    loop = measure_loops(2.5 + 2 * np.sin(turn), 3 * np.sin(turn - 1e-3))
    assert max(loop.width_error, loop.stroke_error) < 2e-5 < 0.1 * 3 * 1e-3


@pytest.mark.deep
def test_hum_that_repeats_with_the_loop_is_in_the_errors_as_it_scatters() -> None:
    rng = np.random.default_rng(3)
    drive, moved = ellipse(rng, 3, 0.1, 1e-9)
    turn = 2 * np.pi * np.arange(256) / 256
    for order in (1, 9, 10):
        found = [
            measure_loops(drive, moved + 0.003 * np.sin(order * turn + phase), {order: 0.003})
            for phase in 2 * np.pi * np.arange(40) / 40
        ]
        for name in ("width", "stroke", "area", "asymmetry"):
            stated = np.sqrt(np.mean([getattr(f, f"{name}_error") ** 2 for f in found]))
            scatter = np.std([getattr(f, name) for f in found])
            assert scatter == pytest.approx(stated, rel=0.05, abs=1e-6), (order, name)


def test_cycles_that_are_no_whole_number_of_samples_are_folded() -> None:
    period = 0.50003
    t = np.arange(13_000) / RATE
    folded = fold(np.sin(2 * np.pi * t / period) + 9 * (t < 0.99 * period), RATE, period, 64)  # the first loop differs
    assert folded.shape == (4, 64)
    phase = 2 * np.pi * (np.arange(64) + 0.5) / 64
    assert np.abs(folded - np.sin(phase)).max() < 2e-3


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("drive", "moved", "message"),
    [
        (np.zeros((1, 20)), np.zeros((1, 20)), "only repetition shows the error"),
        (np.zeros((2, 20)), np.zeros((2, 20)), "the drive is constant at 0"),
        (np.zeros((2, 20)), np.zeros((2, 21)), r"must both be \(cycles, points\)"),
        (np.full((2, 20), np.nan), np.zeros((2, 20)), "40 of 40 samples are not finite"),
    ],
)
def test_what_is_no_loop_is_refused(drive: np.ndarray, moved: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        measure_loops(drive, moved)


def ringing(t: np.ndarray, f: float, zeta: float) -> np.ndarray:
    w = 2 * np.pi * f
    return np.exp(-zeta * w * t) * np.cos(w * np.sqrt(1 - zeta**2) * t + 0.3)


@pytest.mark.deep
def test_decays_reach_the_bound_and_cover_it() -> None:
    rng = np.random.default_rng(1)
    t, sigma, seeds, step = np.arange(300) / RATE, 0.01, 250, 1e-6
    inside = []
    for f, zeta in ((158.3, 0.211), (300.0, 0.01)):
        found = [
            fit_decay(3 + ringing(t, f, zeta) + sigma * rng.standard_normal(t.size), RATE, (60, 500))
            for _ in range(seeds)
        ]
        columns = np.stack(
            [
                (ringing(t, f + f * step, zeta) - ringing(t, f - f * step, zeta)) / (2 * f * step),
                (ringing(t, f, zeta + step) - ringing(t, f, zeta - step)) / (2 * step),
                np.ones(t.size),
                np.log(t + 1 / RATE),
                ringing(t, f, zeta),
                np.exp(-zeta * 2 * np.pi * f * t) * np.sin(2 * np.pi * f * np.sqrt(1 - zeta**2) * t + 0.3),
            ]
        )
        bounds = sigma * np.sqrt(np.diag(np.linalg.inv(columns @ columns.T)))
        values = np.array([(d.natural_hz, d.damping_ratio) for d in found])
        errors = np.array([(d.natural_error_hz, d.damping_error) for d in found])
        for value, error, truth, bound in zip(values.T, errors.T, (f, zeta), bounds[:2], strict=True):
            assert abs(value.mean() - truth) < 4 * bound / np.sqrt(seeds)
            assert value.std(ddof=1) == pytest.approx(bound, rel=0.18)  # four standard errors of a scatter of 250
            assert error.mean() == pytest.approx(bound, rel=0.05)
            inside += (np.abs(value - truth) <= coverage_factor(294) * error).tolist()
        assert found[0].amplitude == pytest.approx(1, abs=5 * found[0].amplitude_error)
        assert found[0].offset == pytest.approx(3, abs=5 * found[0].offset_error)
        assert found[0].phase == pytest.approx(0.3, abs=0.05)
    assert 0.93 < np.mean(inside) < 0.97  # a thousand intervals


def test_creep_after_the_release_is_not_damping() -> None:
    f, zeta, per_decade = 158.3, 0.211, 0.1
    t = 2e-3 + np.arange(2000) / RATE
    late = t - 2 * zeta / (2 * np.pi * f)  # the vibration follows creep so much later
    samples = 3 + ringing(t, f, zeta) + per_decade * np.log10(late / late[-1])
    found = fit_decay(samples, RATE, (60, 500), released_s=2e-3)
    assert found.natural_hz == pytest.approx(f, rel=1e-4)
    assert found.damping_ratio == pytest.approx(zeta, rel=1e-3)
    assert found.creep_per_decade == pytest.approx(per_decade, rel=1e-3)
    assert found.offset == pytest.approx(3, abs=1e-3)
    assert found.displacement(t - t[0]) == pytest.approx(samples, abs=1e-3)
    assert found.degrees_of_freedom == 2000 - 6  # frequency, damping, amplitude, phase, offset, creep


def test_the_step_of_the_model_rings_at_its_pole() -> None:
    t = 3e-3 + np.arange(1485) / RATE
    found = fit_decay(step_response(Tactor(), t), RATE, (60, 500), released_s=3e-3)
    pole = poles(Tactor())[0]
    assert found.natural_hz == pytest.approx(abs(pole) / 2 / np.pi, rel=1e-3)
    assert found.damping_ratio == pytest.approx(-pole.real / abs(pole), rel=2e-3)
    ringing_hz = found.natural_hz * np.sqrt(1 - found.damping_ratio**2)
    assert ringing_hz == pytest.approx(pole.imag / 2 / np.pi, rel=1e-3)


def test_an_amplitude_within_its_noise_is_no_free_vibration() -> None:
    t, noise = np.arange(600) / RATE, 0.01 * np.random.default_rng(5).standard_normal(600)
    error = fit_decay(ringing(t, 158.3, 0.05) + noise, RATE, (60, 500)).amplitude_error
    assert fit_decay(20 * error * ringing(t, 158.3, 0.05) + noise, RATE, (60, 500)).amplitude > 10 * error
    with pytest.raises(ValueError, match="is within 5 standard errors of zero"):
        fit_decay(2.5 * error * ringing(t, 158.3, 0.05) + noise, RATE, (60, 500))


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.random.default_rng(4).standard_normal(1000), "no free vibration between 60 and 500 Hz"),
        (np.zeros(1000), "no free vibration between 60 and 500 Hz"),
        (np.full(1000, np.nan), "1000 of 1000 samples are not finite"),
        (np.zeros(10), "has 10 samples, at least 16"),
    ],
)
def test_what_does_not_ring_has_no_frequency(samples: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit_decay(samples, RATE, (60, 500))


def test_a_multisine_has_equal_lines_and_stays_below_its_peak() -> None:
    design = Multisine.between(25, 525, 2.0, 2.5)
    fine = design.samples(64_000)
    assert 2.4 < np.abs(fine).max() <= 2.5
    assert np.abs(fine).max() / fine.std() < 2.0
    lines = np.abs(np.fft.rfft(design.samples(5000))) / 5000
    assert lines[50:1051] == pytest.approx(design.amplitude)
    assert np.delete(lines, np.arange(50, 1051)).max() < 1e-12


def test_a_multisine_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="no line of a period"):
        Multisine.between(110, 190, 0.01, 1.0)
    with pytest.raises(ValueError, match="a whole number above 1050 is needed"):
        Multisine.between(25, 525, 1.0, 1.0).samples(1000)
