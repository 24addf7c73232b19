"""Points that two runs share, and parameters that rest on assumed values."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.identification.duplicates import DuplicateFinder
from app.identification.specimen_identification import IdentificationResult
from model.identification.uncertainty_budget import UncertaintyBudget
from protocols.base import Quality

VALUES = np.random.default_rng(1).random((3, 3))


def run_of(name: str, rows: list[int], flags: list[Quality]) -> Any:
    columns = {"entry": np.array(rows), "quality": np.array(flags, int), "values": VALUES[rows]}
    setup = SimpleNamespace(imported=True, protocol="sweep")
    return SimpleNamespace(path=Path(name), setup=setup, points=lambda: columns)


def test_a_continuation_takes_from_the_run_before_only_what_it_measured_again() -> None:
    usable, superseded = Quality(0), Quality.SUPERSEDED
    first = run_of("first", [0, 1, 2], [usable] * 3)
    later = run_of("later", [0, 1], [superseded, usable])
    finder = DuplicateFinder()
    finder.add_continuation(later)
    assert finder.duplicates(first)[0].tolist() == [True, False, False]
    assert finder.duplicates(later)[0].tolist() == [True, True]


@pytest.mark.parametrize(("share", "rests"), [(0.49, False), (0.51, True), (0.9, True)])
def test_a_parameter_rests_on_an_assumed_one_from_half_of_its_squared_uncertainty(share: float, rests: bool) -> None:
    budget = UncertaintyBudget(("c0",), ("noise", "creep"), np.sqrt([[1 - share], [share]]))
    part = SimpleNamespace(
        budget=budget, assumed=(SimpleNamespace(name="creep"),), identified=(SimpleNamespace(name="c0"),)
    )
    resting = IdentificationResult.resting.fget(part)  # type: ignore[attr-defined]
    assert dict(resting) == pytest.approx({"c0": share} if rests else {})
