"""Analysis of a sine recording, against the same least-squares fit from a basis that is written out.

    python benchmarks/bench_sine.py [--rounds 5]

Recordings of 6 s at 5, 250 and 500 kS/s: frequency and amplitude of the drive, eight harmonics of the displacement, and max - min
without the bias of noise, as a sine dwell computes them for each point. The reference is the fit of eight harmonics with numpy: the normal
equations summed over pieces of the basis, and the misfit in a second pass. Quote ratios; CPU time is told as well, for a busy machine.
"""

import argparse
from collections.abc import Callable
from statistics import median

import numpy as np
from timing import peak_mb, timed

from protocols.signals import estimate_max_min, fit_frequency, fit_sine

RATES_HZ = (5e3, 250e3, 500e3)
DURATION_S, FREQUENCY_HZ, ORDERS = 6.0, 155.3, 8
GOAL_SHARE = 0.05
"""Of the duration of a recording at the highest rate."""


def written_out(
    samples: np.ndarray, rate_hz: float, frequency_hz: float, piece: int = 1 << 16
) -> tuple[np.ndarray, float]:
    """Coefficients and noise of 1, t, and sines and cosines of eight harmonics."""

    def basis(start: int) -> np.ndarray:
        k = np.arange(start, min(start + piece, samples.size))
        angles = 2 * np.pi * frequency_hz / rate_hz * np.multiply.outer(np.arange(1, ORDERS + 1), k)
        return np.vstack([np.ones(k.size), 2 * k / (samples.size - 1) - 1, np.sin(angles), np.cos(angles)])

    gram, moment = np.zeros((2 + 2 * ORDERS, 2 + 2 * ORDERS)), np.zeros(2 + 2 * ORDERS)
    for start in range(0, samples.size, piece):
        rows = basis(start)
        gram += rows @ rows.T
        moment += rows @ samples[start : start + piece]
    solution = np.linalg.solve(gram, moment)
    left = 0.0
    for start in range(0, samples.size, piece):
        residual = samples[start : start + piece] - solution @ basis(start)
        left += float(residual @ residual)
    return solution, float(np.sqrt(left / (samples.size - solution.size)))


def analysis(drive: np.ndarray, moved: np.ndarray, rate_hz: float) -> None:
    frequency = fit_frequency(drive, rate_hz, FREQUENCY_HZ)
    fit_sine(drive, rate_hz, frequency)
    fit_sine(moved, rate_hz, frequency, ORDERS)
    estimate_max_min(moved, rate_hz, frequency)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    rng = np.random.default_rng(1)
    print(
        f"{'':10s} {'fit':>10s} {'reference':>10s} {'ratio':>6s} {'analysis':>10s} {'of 6 s':>7s} {'CPU':>7s} {'memory':>8s} {'recording':>9s}"
    )
    for rate in RATES_HZ:
        t = np.arange(round(DURATION_S * rate)) / rate
        drive = 2.5 + 2.5 * np.sin(2 * np.pi * FREQUENCY_HZ * (1 + 2e-5) * t) + 1e-3 * rng.standard_normal(t.size)
        moved = 5e-4 * np.sin(2 * np.pi * FREQUENCY_HZ * (1 + 2e-5) * t - 1.2) + 1e-8 * rng.standard_normal(t.size)
        calls: tuple[Callable[[], object], ...] = (
            lambda moved=moved, rate=rate: fit_sine(moved, rate, FREQUENCY_HZ, ORDERS),
            lambda moved=moved, rate=rate: written_out(moved, rate, FREQUENCY_HZ),
            lambda drive=drive, moved=moved, rate=rate: analysis(drive, moved, rate),
        )
        fit = fit_sine(moved, rate, FREQUENCY_HZ, ORDERS)
        solution, noise = written_out(moved, rate, FREQUENCY_HZ)
        components = solution[2 : 2 + ORDERS] + 1j * solution[2 + ORDERS :]
        worst = np.abs(fit.components - components).max() / abs(fit.fundamental)
        took = np.array([[timed(call) for call in calls] for _ in range(rounds)])  # interleaved
        walls, cpus = np.median(took[..., 0], 0), np.median(took[..., 1], 0)
        ratio = median(took[:, 1, 0] / took[:, 0, 0])
        print(
            f"{rate / 1e3:5.0f} kS/s {1e3 * walls[0]:7.1f} ms {1e3 * walls[1]:7.1f} ms {ratio:6.1f} {1e3 * walls[2]:7.1f} ms "
            f"{walls[2] / DURATION_S:7.4f} {cpus[2] / DURATION_S:7.4f} {peak_mb(calls[2]):5.0f} MB {8 * t.size / 1e6:6.0f} MB   "
            f"components equal to {worst:.1e}, noise to {abs(fit.noise / noise - 1):.1e}"
        )
    met = "met" if walls[2] / DURATION_S <= GOAL_SHARE else "not met on this machine now"
    print(f"goal analysis <= {GOAL_SHARE} of the duration at {RATES_HZ[-1] / 1e3:.0f} kS/s: {met}")


if __name__ == "__main__":
    main()
