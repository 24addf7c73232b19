"""Sweeps and free decays from the simulated bench in the joint fit."""

from pathlib import Path

import numpy as np
import pytest

from app.identification.observations import run_observations
from app.identification.specimen_identification import identify
from model import ParameterError, Tactor
from model.identification import DecayPoleObservation, FrequencyResponseObservation
from protocols.measurements.free_decay import FreeDecay
from protocols.measurements.sweep import Sweep
from protocols.runfile.reader import Run
from tests.helpers.simulated_bench import laboratory, run


@pytest.mark.deep
def test_sweep_and_free_decay_enter_the_joint_fit_and_find_the_truth(tmp_path: Path) -> None:
    with laboratory() as lab:
        paths = [run(each, tmp_path, lab).path for each in (Sweep(), FreeDecay())]
    alone, found = identify(paths[:1], sheet="none"), identify(paths, sheet="none")
    assert not found.notes
    (lines,) = found.observations.of_type(FrequencyResponseObservation)
    (poles,) = found.observations.of_type(DecayPoleObservation)
    assert lines.swept
    assert lines.usable.sum() > 200
    assert poles.usable.sum() == 10
    assert {e.acts_on for e in lines.shared_errors} <= {"displacement", "delay", "volts"}
    assert not poles.shared_errors
    for each in (alone, found):
        assert each.adequacy is not None
        assert each.adequacy.adequate is True, each.adequacy
        for e in each.identified:
            assert abs(e.value - getattr(Tactor(), e.name)) < 3 * e.standard_error, e
    error = {e.name: e.standard_error / abs(e.value) for e in alone.identified}
    assert all(e.standard_error / abs(e.value) <= 1.01 * error[e.name] for e in found.identified)
    with pytest.raises(ParameterError, match="no step for a sweep or a free decay"):
        identify(paths, "chain")


@pytest.mark.deep
def test_loops_are_computed_only_where_each_line_is_one_that_the_drive_excites(tmp_path: Path) -> None:
    """Lines of a slow sweep are averages of others, those of pieces are of several drives: they see sines."""
    usual = Sweep(periods=2)
    slow = Sweep(start_hz=25, stop_hz=99, sweep_s=4, periods=2)
    pieces = Sweep(periods=2, pieces=8)
    found = []
    for at, protocol in enumerate((usual, slow, pieces)):
        with laboratory() as lab:
            path = run(protocol, tmp_path / str(at), lab).path
        with Run(path) as file:
            (observation,) = run_observations(file)
        assert isinstance(observation, FrequencyResponseObservation)
        found.append(observation.loop_share)
    assert found[0] is not None
    assert np.abs(found[0]).max() < 2.0  # of a line that is not excited it is a ratio of nothing to nothing
    assert found[1] is None
    assert found[2] is None
