"""Sweeps and free decays from the simulated bench in the joint fit."""

from pathlib import Path

import pytest

from app.identification.specimen_identification import identify
from model import ParameterError, Tactor
from model.identification import DecayPoleObservation, FrequencyResponseObservation
from protocols.measurements.free_decay import FreeDecay
from protocols.measurements.sweep import Sweep
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
