"""Attribution of a misfit: the cause is named first, with its size, and the fit with it is right.

The campaigns are made by finite elements, which share nothing with the fit.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from model.identification.adequacy import Adequacy, assess_adequacy
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.nonidealities import NONIDEALITIES
from model.identification.observations import ObservationSet
from model.identification.residuals import LeastSquaresProblem
from model.parameters import ParameterError
from tests.helpers.laboratory import Laboratory, measure
from tests.helpers.model.departures import DEVELOPED
from tests.helpers.model.laboratories import draw
from tests.helpers.model.laboratories import measure as measure_world
from tests.helpers.model.withheld_departures import WITHHELD
from tests.helpers.model.withheld_departures_2 import WITHHELD_2
from tests.helpers.model.withheld_departures_3 import WITHHELD_3
from tests.helpers.model.withheld_departures_4 import WITHHELD_4

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


@pytest.mark.deep
def test_a_value_that_the_user_fixed_is_a_possible_cause() -> None:
    fit = joint_fit(measure(Laboratory(), 1, SMALL), FitOptions(fixed={"c0": 130.0}))
    diagnosis = assess_adequacy(fit).diagnosis
    assert diagnosis is not None
    assert diagnosis.likeliest[0].cause_text.startswith("c0 (structural damping per length) is 1")
    assert diagnosis.likeliest[0].cause_text.endswith(", not 130 kg/(m s)")


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


@pytest.mark.deep
@pytest.mark.parametrize(
    ("lab", "cause", "words"),
    [
        (Laboratory(creep=0.02), "creep", r"deflections creep on by [12]\.\d+ ± \S+ % a decade"),
        (
            Laboratory(clamp=0.15),
            "clamp_flexibility",
            r"the clamp turns, by 1\d\.?\d* ± \S+ % of what the bare plate bends",
        ),
        (Laboratory(load_offset_kg=-2e-3), "load_offset", r"mN less than stated loads the centre with every weight"),
        (Laboratory(delay_s=-5e-5), "delay", r"the displacement is [45]\d\.?\d* ± \S+ µs earlier than"),
        (
            Laboratory(stiffening=0.2),
            "stiffening",
            r"is (19|2\d)\.?\d* ± \S+ % stiffer at a deflection of 1 mm than at none",
        ),
    ],
)
def test_nonidealities_are_found_with_few_runs(lab: Laboratory, cause: str, words: str) -> None:
    verdict = judged(lab, SMALL)
    assert verdict.diagnosis is not None
    assert cause in [e.cause.title for e in verdict.diagnosis.likeliest]
    assert re.search(words, verdict.message), verdict.message


@pytest.mark.deep
@pytest.mark.parametrize(
    ("departure", "title", "size"),
    [
        ("leads exchanged in one run", "scale of membrane 6.35 mm", -1.99),
        ("foam touches the plate in one run", "damping of dwell again", 0.3),
        ("tape on and off again", "mass of membrane 0 mm to membrane 2.54 mm", 2.2e-4),
        ("gain changes over lunch", "scale from membrane 6.35 mm on", 0.04),
        ("laser moved aside for the membrane", "scale of all dwells on the membrane", 0.0515),
        ("plate warms in a long dwell", "stiffness within dwell again", 0.05),
        ("sensor's input is coupled by a capacitor", "high-pass", 0.15),
        ("mount detuned before the last membrane", "clamp from membrane 6.35 mm on", None),
        ("mains hum", "hum at 50 Hz", None),
        ("rest is not at 2.5 V", "rest of steps", None),
        ("mass lost in the middle of the series", "drift in masses", None),
        ("converter clips the resonance", "softening of dwell", None),
    ],
)
def test_changes_of_specimen_and_instruments_are_named_with_their_size(
    departure: str, title: str, size: float | None
) -> None:
    sets = ((2814, WITHHELD_2), (2815, WITHHELD_3))
    ((stream, each),) = ((stream, d) for stream, those in sets for d in those if d.name == departure)
    world = draw(0, each, stream)
    observations = measure_world(world, 1000 * stream, each)
    fit = joint_fit(observations, world.sheet.fit_options(FitOptions(), observations, False))
    diagnosis = assess_adequacy(fit).diagnosis
    assert diagnosis is not None
    first = diagnosis.likeliest[0]
    assert first.cause.title == title
    assert first.p_value > 1e-3
    assert size is None or abs(first.size - size) < 3.5 * first.standard_error


@pytest.mark.deep
def test_a_stated_length_that_is_wrong_is_named() -> None:
    """The plate is 24 mm long; the ruler's 22 mm +- 0.3 mm are taken as known."""
    known = {"L": (22e-3, 0.3e-3)}
    verdict = assess_adequacy(joint_fit(measure(Laboratory(L=24e-3), 1, SMALL), FitOptions(n=20, priors=known)))
    assert verdict.diagnosis is not None
    assert "stated L" in [e.cause.title for e in verdict.diagnosis.likeliest]


@pytest.mark.deep
def test_slopes_of_the_nonidealities_are_those_of_their_differences() -> None:
    names = tuple(name for name in NONIDEALITIES if name != "mass_put_in")
    sizes = dict.fromkeys(names, 0.02) | {"mass_fraction": 0.9, "mass_offset": 1e-4, "zero_drift": 5e-6}
    sizes |= {"delay": 3e-5, "elongation_offset": 1e-4}
    problem = LeastSquaresProblem(measure(Laboratory(), 1), FitOptions(n=20, also=names, start=sizes))
    _, J = problem.evaluate(problem.start)
    for name in names:
        i = problem.names.index(name)
        step = np.zeros(problem.start.size)
        step[i] = 1e-4 * abs(problem.start[i])
        up, down = (problem.evaluate(problem.start + side * step)[0] for side in (1, -1))
        np.testing.assert_allclose(J[:, i], (down - up) / (2 * step[i]), atol=1e-5 * abs(J[:, i]).max(), err_msg=name)


@pytest.mark.deep
def test_a_delay_leaves_the_others_identifiable_in_precise_runs() -> None:
    """The delay is known to nanoseconds, k2 with the ruler to per cents: neither is rounding against the other."""
    loading, _, _, _, dwell, *_ = measure(Laboratory(), 1).runs
    dwell = replace(dwell, errors_m=2e-6 * np.abs(dwell.fundamental_m), phase_errors_rad=None)
    ruler = {"L1": (8e-3, 0.3e-3), "h_Al": (0.2e-3, 0.01e-3)}
    fit = joint_fit(ObservationSet((loading, dwell)), FitOptions(n=20, also=("delay",), priors=ruler), max_starts=1)
    assert fit.unidentified_combinations == ()


@pytest.mark.deep
def test_what_no_run_can_decide_is_named_with_the_measurement_that_would() -> None:
    runs = measure(Laboratory(), 1).runs
    loading, dwell = (assess_adequacy(joint_fit(ObservationSet(r), FitOptions(n=20))) for r in (runs[:2], runs[4:5]))
    assert [u.name for u in loading.undecidable] == ["sensor_gain", "load_gain"]
    assert [u.name for u in dwell.undecidable] == ["sensor_gain", "volts"]
    assert (
        "1 % would move k2 by 1.4 %; weighing one of the weights on another balance would"
        in loading.undecidable[1].text
    )
    every = assess_adequacy(joint_fit(measure(Laboratory(), 1), FitOptions(n=20)))
    assert [u.name for u in every.undecidable] == ["volts"]
    assert "a probe of known ratio" in every.undecidable[0].text


def test_the_published_matrix_has_every_departure() -> None:
    """Its cells are made by docs/make_attribution_matrix.py from the lines of benchmarks/coverage/laboratories.py."""
    text = (Path(__file__).parents[3] / "docs" / "attribution-matrix.md").read_text("utf-8")
    for departure in (*DEVELOPED, *WITHHELD, *WITHHELD_2, *WITHHELD_3, *WITHHELD_4):
        (row,) = (line for line in text.splitlines() if line.startswith(f"| {departure.name} | {departure.size} |"))
        assert re.fullmatch(
            r"\|( [^|]+ \|){1}( [^|]* \|)( \d+ \| \d+ \| \d+ \| [^|]* \|| not measured \| \| \| \|)", row
        ), row
