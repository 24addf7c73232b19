"""Stated errors against scatter and truth: a part of docs/error-bars.md, with a few seeds."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.coverage.error_bars import DRAWN, SHORT, band, mean_limit, measure, ratios
from protocols import PROTOCOLS

SEEDS = range(1001, 1009)
CHEAP = ("sweep", "membrane sag", "free decay", "sine dwell", "static loading", "mass resonance")
MAIN = {
    "sweep": ("natural_frequency", "damping_ratio", "line, real", "line, imaginary"),
    "membrane sag": ("sag", "E_m", "linear_young_modulus", "point sag"),
    "free decay": ("natural_frequency", "damping_ratio", "point natural_frequency", "point damping"),
    "sine dwell": (
        "point fundamental",
        "point phase",
        "point peak_to_peak",
        "natural_frequency",
        "damping_ratio",
        "peak_frequency",
    ),
    "mass resonance": (
        "point frequency",
        "point spectrum_peak",
        "point natural_frequency",
        "line, real",
        "line, imaginary",
    ),
    "static loading": ("compliance, MFC up", "compliance, aluminium up", "side_difference", "point deflection"),
}


def test_the_table_has_every_measurement() -> None:
    measured = {name.replace("-", " ") for name in PROTOCOLS} - {"wiring check"}
    assert set(SHORT) == measured
    text = (Path(__file__).parents[2] / "docs" / "error-bars.md").read_text("utf-8")
    assert {name for name in measured if f"| {name} |" in text} == measured


def test_the_band_of_many_seeds_is_the_tenth_alone() -> None:
    assert band(10**6) == pytest.approx((0.9, 1.1), abs=3e-3)
    assert band(200)[0] < 0.8 < 1.2 < band(200)[1] < 1.3
    assert mean_limit(900, 1) == pytest.approx(0.1 + 3 / 30, abs=1e-3)


@pytest.mark.deep
@pytest.mark.parametrize("protocol", CHEAP)
def test_errors_against_the_plants_truth_are_as_large_as_stated(protocol: str) -> None:
    found = {r.name: r for r in ratios([measure(DRAWN, protocol, seed) for seed in SEEDS])}
    low, high = band(len(SEEDS))
    for name in MAIN[protocol]:
        ratio = found[name]
        assert ratio.seeds == len(SEEDS)
        assert low < ratio.error < high, f"{name}: the errors are {ratio.error:.2f} of the stated"
        limit = mean_limit(len(SEEDS), {"point": 50, "line,": 300}.get(name.split()[0], 1))
        assert abs(ratio.mean) < limit, f"{name}: mean error {ratio.mean:+.2f} of the stated"
    assert np.isfinite([found[name].error for name in MAIN[protocol]]).all()
