"""Free decay on a simulated bench: frequency and damping of the plant's first pole."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from model.parameters import Tactor
from protocols.base import Quality
from protocols.measurements.free_decay import FreeDecay
from protocols.runfile.reader import Run
from tests.helpers.simulated_bench import laboratory, run, simulated
from tests.protocols.test_sweeps import first_pole


@pytest.mark.parametrize("c0", [159.0, pytest.param(20.0, marks=pytest.mark.deep)])
def test_it_rings_as_the_first_pole_says(c0: float, tmp_path: Path) -> None:
    natural, damping = first_pole(Tactor(c0=c0))
    with laboratory(simulated(tactor={"c0": c0})) as lab:
        ran = run(FreeDecay(edges=6, dwell_s=0.3), tmp_path, lab)
    assert ran.status == "completed", ran.reason
    assert [p.edge for p in ran.points] == [1, 2, 3, 4, 5, 6]
    pulls = np.array([(p.natural_frequency - natural) / p.natural_frequency_errors for p in ran.points])
    assert np.abs(pulls).max() < 4
    pulls = np.array([(p.damping - damping) / p.damping_errors for p in ran.points])
    assert np.abs(pulls).max() < 4
    with Run(ran.path) as file:
        found = {e.name: e for e in file.record.estimates}
        assert len(file.series()) == 6
    assert abs(found["natural_frequency"].value - natural) < 4 * found["natural_frequency"].standard_error < 2
    assert abs(found["damping_ratio"].value - damping) < 4 * found["damping_ratio"].standard_error < 0.01


def test_a_specimen_that_does_not_move_rings_nowhere(tmp_path: Path) -> None:
    with laboratory(simulated(tactor={"mu": -1e-13})) as lab:
        ran = run(FreeDecay(edges=2), tmp_path, lab)
    assert ran.points == []
    assert "none from edge 1, edge 2" in ran.reason


@pytest.mark.deep
def test_a_step_that_is_too_small_is_flagged(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(FreeDecay(edges=2), tmp_path, lab)
    with Run(ran.path) as file:
        recording = next(file.recordings())
    for share, flagged in ((0.92, True), (1.0, False)):
        seen = replace(recording, drive_v=2.5 + share * (recording.drive_v - 2.5))
        point = FreeDecay(edges=2).point((1.0,), [seen], True)
        assert (Quality.DRIVE_OFF in Quality(point.quality)) is flagged, share


def test_edges_of_both_directions_that_differ_are_no_scatter() -> None:
    rng = np.random.default_rng(4)

    def points(difference: float) -> list[Any]:
        return [
            SimpleNamespace(
                edge=float(edge), quality=0, natural_frequency=160 + 0.01 * rng.standard_normal(), natural_frequency_errors=0.01,
                damping=0.22 + difference * (edge % 2) + 1e-4 * rng.standard_normal(), damping_errors=1e-4,
            )
            for edge in range(1, 11)
        ]  # fmt: skip

    def error(difference: float) -> float:
        every = {each.name: each for each in FreeDecay().estimates(points(difference))}
        return every["damping_ratio"].standard_error

    assert error(0.01) < 6e-5
    assert error(0.0) < 6e-5
