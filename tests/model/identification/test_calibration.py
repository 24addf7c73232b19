"""Calibration records: saved and loaded, differences reported, damaged files rejected."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.campaigns import SHARED, Noise, World, perfect
from model.identification.calibration import Calibration, compare_calibrations
from model.identification.fit_result import JointFit
from model.identification.joint_least_squares import joint_fit
from model.parameter_spec import ParameterError
from model.parameters import Membrane, Tactor
from model.specimen import Specimen
from model.studies.parameter_study import Study
from model.studies.uncertainty import linear_band
from tests.helpers.sampled import model_curve


@cache
def fit() -> JointFit:
    return joint_fit(perfect(World(), Noise(), SHARED))


def calibration(version: int = 1) -> Calibration:
    estimates = fit().estimates()
    return Calibration(
        specimen="T7",
        version=version,
        estimates=estimates,
        covariance=tuple(map(tuple, fit().covariance_of(estimates).tolist())),
        method="joint",
        runs=tuple(r.label for r in fit().observations.runs),
        code="0.1.0",
        accepted_at="2026-11-21T12:00:00+00:00",
        accepted_by="somebody",
        simulated=fit().observations.simulated,
        fixed=fit().options.base_values(),
    )


def test_to_json_and_back() -> None:
    c = calibration()
    assert Calibration.from_record(json.loads(json.dumps(c.as_record()))) == c
    assert c.simulated


def test_it_makes_the_curve_and_its_band() -> None:
    c = calibration()
    assert c.tactor().k2 == pytest.approx(7e-3, rel=2e-3)
    assert c.tactor().L == Tactor().L
    assert c.membrane().h_m == Membrane().h_m
    study = Study({}, (100.0, 150.0, 200.0), Specimen(c.tactor(), c.membrane(), 0.01))
    band = linear_band(model_curve(study), c.estimate_set())
    assert (band.standard_error > 0).all()
    assert (band.standard_error < 0.02 * band.centre).all()


def test_changes_are_counted_in_their_own_errors() -> None:
    a = calibration()
    first = a.estimates[0]
    moved = replace(first, value=first.value + 3 * first.standard_error)
    b = replace(a, version=2, estimates=(moved, *a.estimates[1:]))
    (change, *others) = compare_calibrations(a, b)
    assert change.name == "k2"
    assert change.sigmas == pytest.approx(3 / np.sqrt(2))
    assert all(o.sigmas == 0 for o in others)
    gone = replace(b, estimates=b.estimates[:-1], covariance=tuple(r[:-1] for r in b.covariance[:-1]))
    assert compare_calibrations(a, gone)[-1].after is None


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda r: r.pop("code"), "missing code"),
        (lambda r: r.update(colour="red"), "unknown colour"),
        (lambda r: r.update(kind="picture"), "not a calibration record"),
        (lambda r: r["covariance"].pop(), "covariance"),
        (lambda r: r["estimates"][0].pop("value"), "damaged"),
        (lambda r: r["estimates"][0].update(standard_error=1.0), "standard error of k2 is 1"),
        (lambda r: r.update(estimates=3), "damaged"),
    ],
)
def test_a_damaged_record_is_a_sentence(damage: object, message: str) -> None:
    record = json.loads(json.dumps(calibration().as_record()))
    damage(record)  # type: ignore[operator]
    with pytest.raises(ParameterError, match=message):
        Calibration.from_record(record)


def test_what_was_neither_identified_nor_given_is_missed() -> None:
    c = calibration()
    with pytest.raises(ParameterError, match="T7 has no rho1"):
        replace(c, fixed={k: v for k, v in c.fixed.items() if k != "rho1"}).tactor()
