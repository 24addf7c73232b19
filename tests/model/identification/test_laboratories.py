"""Coverage of total uncertainties and attribution in laboratories whose truth the fit does not expect: a sample of benchmarks/coverage/laboratories.py."""

import numpy as np
import pytest

from benchmarks.coverage.laboratories import IDENTIFIED, coverage, covered, departed
from tests.helpers.model.departures import DEVELOPED
from tests.helpers.model.withheld_departures import WITHHELD
from tests.helpers.model.withheld_departures_3 import WITHHELD_3

LABORATORIES = 16


@pytest.mark.deep
def test_total_uncertainties_hold_with_nonidealities_that_are_not_drawn_from_the_priors() -> None:
    rows = [row for seed in range(LABORATORIES) for row in coverage(seed)]
    full = [row for row in rows if row["set"] == "full"]
    number, share, mean, rms = covered(full)["identified"]
    assert number == len(IDENTIFIED) * LABORATORIES
    assert share > 0.88
    assert abs(mean) < 0.4
    assert rms == pytest.approx(1.0, abs=0.3)
    assert sum(row["alarm"] for row in full) <= 3
    assert covered(rows)["identified"][1] > 0.9
    assert np.mean([row["alarm"] for row in rows]) < 0.12


@pytest.mark.deep
@pytest.mark.timeout(1200)  # 40 s of processor time for the slowest, whatever else the computer does
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    "name",
    [
        "slope below rest", "one step", "a repeat on the wrong side", "Duffing", "loose mount of the laser", "drive falls off", "steps too large",
        "mass of a mounting", "one elongation", "warming up in a dwell",
    ],
)  # fmt: skip
def test_the_right_cause_is_named_first(name: str, seed: int) -> None:
    departure = next(d for d in (*DEVELOPED, *WITHHELD) if d.name == name)
    row = departed(departure, seed, 7)
    assert row["right"], row["named"]


@pytest.mark.deep
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("screw rattles in one run", "points 7 and 8 of membrane 0 mm"),
        ("contact lost twice in one run", "points 3 and 12 of membrane 2.54 mm"),
        ("one weight of another set", "weight of 1.96 N"),
        ("loads in pounds", "scale of all loadings"),
    ],
)
def test_wrong_points_weights_and_units_are_named(name: str, cause: str) -> None:
    departure = next(d for d in WITHHELD_3 if d.name == name)
    row = departed(departure, 0, 7)
    assert row["named"][0] == cause
