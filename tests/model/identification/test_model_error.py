"""Model error: total uncertainties of a fit that is not adequate hold the truth, which enlarged errors of the runs do not."""

import pytest

from model.identification.adequacy import Adequacy, assess_adequacy
from model.identification.attribution.model_error import NOT_ADEQUATE, with_model_error
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.uncertainty_budget import uncertainty_budget
from tests.helpers.laboratory import Laboratory, measure


@pytest.mark.deep
@pytest.mark.parametrize(
    ("laboratory", "name"),
    [
        (Laboratory(mass_fraction=0.7), "k2"),
        pytest.param(Laboratory(creep=0.03), "k2", marks=pytest.mark.deep),
        pytest.param(Laboratory(sensor_gain=0.1), "k2", marks=pytest.mark.deep),
    ],
    ids=["masses of which 70 % act", "creep", "a wrong gain of the laser"],
)
def test_totals_of_a_wrong_model_hold_the_truth(laboratory: Laboratory, name: str) -> None:
    fit = joint_fit(measure(laboratory, 3, small=True), FitOptions(n=20))
    adequacy = assess_adequacy(fit)
    assert adequacy.adequate is False
    enlarged, total = ({e.name: e for e in each.estimates()}[name] for each in (fit, with_model_error(fit, adequacy)))
    assert total.value == enlarged.value
    off = abs(total.value - getattr(laboratory, name))
    assert off > 1.96 * enlarged.standard_error
    assert off < 1.96 * total.standard_error
    budget = uncertainty_budget(with_model_error(fit, adequacy))
    at = budget.names.index(name)
    assert budget.total[at] == pytest.approx(total.standard_error)
    assert budget.shares[budget.sources.index(NOT_ADEQUATE), at] > 0.5


def test_an_adequate_fit_has_no_model_error() -> None:
    fit = joint_fit(measure(Laboratory(), 3, small=True), FitOptions(n=7))
    assert with_model_error(fit, Adequacy(True, "", (), 9)) is fit
