"""Observations: the points of a run as a fit uses them, with exactly the information of the run."""

import json
from pathlib import Path

import h5py
import pytest

from app.identification import observations
from app.identification.observations import ObservationError, amplifier_of
from app.identification.specimen_identification import identify
from model.amplifier_map import AmplifierMap
from model.identification.fit_options import FitOptions
from protocols.measurements.membrane_sag import MembraneSag
from protocols.runfile.reader import Run
from tests.helpers.simulated_bench import laboratory, run


@pytest.mark.deep
def test_the_modulus_and_its_error_are_those_the_sag_itself_tells(tmp_path: Path) -> None:
    """The errors of depth and geometry are common to all repeats, and to both ways to find it."""
    with laboratory() as lab:
        ran = run(MembraneSag(repeats=3, sample_rate_hz=1000), tmp_path, lab)
    with Run(ran.path) as file:
        (told,) = [e for e in file.record.estimates if e.name == "E_m"]
    for found in (identify([ran.path], "chain"), identify([ran.path], "joint", FitOptions(free=("E_m",)))):
        (E_m,) = [e for e in found.estimates if e.name == "E_m"]
        assert E_m.value == pytest.approx(told.value, rel=1e-3)
        assert E_m.standard_error == pytest.approx(told.standard_error, rel=0.02)


@pytest.mark.deep
def test_a_sag_of_another_version_is_a_sentence(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(MembraneSag(repeats=1, sample_rate_hz=1000), tmp_path, lab)
    with h5py.File(ran.path, "r+") as file:
        parameters = json.loads(file["entry/parameters"][()]) | {"length_m": -1.0}
        del file["entry/parameters"]
        file["entry/parameters"] = json.dumps(parameters)
    with pytest.raises(ObservationError, match="has parameters that this version rejects"):
        identify([ran.path], "chain")


def test_runs_behind_differently_configured_amplifiers_are_not_identified_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    maps = {"a.h5": AmplifierMap(), "b.h5": AmplifierMap(), "c.h5": AmplifierMap(slope_above=610.0)}
    monkeypatch.setattr(observations, "_head", lambda path: observations._Head(maps[path.name], 7, False))
    assert amplifier_of([]) == amplifier_of([Path("a.h5"), Path("b.h5")]) == maps["a.h5"]
    assert amplifier_of([Path("c.h5")]) == maps["c.h5"]
    with pytest.raises(ObservationError):
        amplifier_of([Path("a.h5"), Path("c.h5")])
