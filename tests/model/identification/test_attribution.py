"""Attribution of a misfit: the cause is named first, with its size, and the fit with it is right.

The campaigns are made by finite elements, which share nothing with the fit.
"""

import re

import pytest

from model.identification.adequacy import Adequacy, assess_adequacy
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.parameters import ParameterError
from tests.helpers.laboratory import Laboratory, measure

SMALL, FULL = True, False


def judged(lab: Laboratory, small: bool, seed: int = 1) -> Adequacy:
    return assess_adequacy(joint_fit(measure(lab, seed, small), FitOptions(n=20)))


@pytest.mark.deep
@pytest.mark.parametrize("small", [FULL, SMALL])
def test_eleven_grams_that_act_as_seven_are_named_first(small: bool) -> None:
    """The paper put 11 g in and found 7.73 g; without the mass fraction k2 is 22 % wrong."""
    lab = Laboratory(mass_fraction=7.73 / 11)
    plain = joint_fit(measure(lab, 3, small), FitOptions(n=20))
    verdict = assess_adequacy(plain)
    assert verdict.adequate is False
    assert verdict.diagnosis is not None
    first = verdict.diagnosis.likeliest[0]
    assert first.cause.title == "mass_fraction"
    assert len(verdict.diagnosis.likeliest) == 1
    assert abs(first.size - 7.73 / 11) < 3 * first.standard_error < 0.03
    assert "most likely because the masses put in the cylinder act as 70." in verdict.message
    k2 = {e.name: e for e in first.fit.estimates()}["k2"]
    assert abs(k2.value - 7e-3) < 3 * k2.standard_error
    assert 1.96 * k2.standard_error < 0.15 * 7e-3
    assert plain.values["k2"] > 1.15 * 7e-3
    assert [s for s in first.shifts if s.name == "k2" and s.before > 1.15 * s.after]


@pytest.mark.deep
def test_a_mass_that_is_known_is_told_from_what_acts_of_it() -> None:
    """11 g are in the cylinder in the dwells, too: the mass fraction explains both them and the nine masses."""
    data = measure(Laboratory(mass_fraction=7.73 / 11), 4, SMALL)
    known = FitOptions(n=20, fixed={"mass_put_in": 11e-3})
    plain = joint_fit(data, known)
    assert "m_add" not in plain.names
    verdict = assess_adequacy(plain)
    assert verdict.diagnosis is not None
    assert verdict.diagnosis.likeliest[0].cause.title == "mass_fraction"
    fit = joint_fit(data, FitOptions(n=20, fixed={"mass_put_in": 11e-3}, also=("mass_fraction",)))
    assert fit.p_value > 1e-3
    assert fit.values["m_add"] == pytest.approx(7.73e-3, rel=0.01)
    assert assess_adequacy(fit).adequate
    with pytest.raises(ParameterError, match="m_add follows from mass_put_in"):
        joint_fit(data, FitOptions(free=("k2", "m_add"), fixed={"mass_put_in": 11e-3}))


def test_a_value_that_the_user_fixed_is_a_possible_cause() -> None:
    fit = joint_fit(measure(Laboratory(), 1, SMALL), FitOptions(fixed={"c0": 130.0}))
    diagnosis = assess_adequacy(fit).diagnosis
    assert diagnosis is not None
    assert diagnosis.likeliest[0].cause_words.startswith("c0 (structural damping per length) is 1")
    assert diagnosis.likeliest[0].cause_words.endswith(", not 130 kg/(m s)")


@pytest.mark.deep
@pytest.mark.parametrize("small", [FULL, SMALL])
@pytest.mark.parametrize(
    ("lab", "cause", "words"),
    [
        (Laboratory(mass_offset_kg=5e-4), "mass_offset", r"g more than stated acts with every added mass"),
        (Laboratory(mass_offset_kg=-5e-4), "mass_offset", r"g less than stated acts with every added mass"),
        (Laboratory(asymmetry=0.04), "asymmetry", r"deflect the MFC side .* % more than .*, the aluminium side less"),
        (Laboratory(asymmetry=-0.04), "asymmetry", r"deflect the MFC side .* % less than .*, the aluminium side more"),
        (Laboratory(bad_static=0.1), "point 10 of loading mfc", r"point 10 of loading mfc \(0.981 N\) alone is wrong"),
    ],
)
def test_the_cause_is_named_first_with_its_sign(lab: Laboratory, cause: str, words: str, small: bool) -> None:
    verdict = judged(lab, small)
    assert verdict.diagnosis is not None
    assert verdict.diagnosis.likeliest[0].cause.title == cause
    assert re.search(words, verdict.message), verdict.message
