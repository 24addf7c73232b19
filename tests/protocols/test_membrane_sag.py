"""Membrane sag on the simulated bench: the true modulus is measured."""

import threading
from pathlib import Path
from typing import Any

import pytest

from model.membrane import linear_young_modulus, sag, young_modulus_from_sag
from model.parameter_spec import ParameterError
from model.parameters import Membrane
from protocols.base import Prompt, PromptShown, Quality, RunStatus
from protocols.measurements.membrane_sag import MembraneSag, SagPoint
from protocols.runfile.reader import Run
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run, simulated

SHORT = MembraneSag(repeats=2, sample_rate_hz=1000)


def estimates_of(path: Path) -> dict[str, tuple[float, float]]:
    with Run(path) as file:
        return {e.name: (e.value, e.standard_error) for e in file.record.estimates}


@pytest.mark.parametrize(("E_m", "reference_m"), [(6.95e6, 3.5e-3), pytest.param(3e6, 4.6e-3, marks=pytest.mark.deep)])
def test_the_modulus_of_the_simulated_rubber_comes_out(E_m: float, reference_m: float, tmp_path: Path) -> None:
    with laboratory(simulated(plant_rate_hz=10e3, membrane={"E_m": E_m})) as lab:
        ran = run(SHORT.model_copy(update={"reference_m": reference_m}), tmp_path, lab)
        assert not lab.control.history.high_voltage_on
    assert ran.status == RunStatus.COMPLETED
    found = estimates_of(ran.path)
    value, error = found["E_m"]
    assert abs(value - E_m) < 0.1 * error < 0.01 * E_m  # the geometry's uncertainty, which here is not there
    assert found["linear_young_modulus"][0] > 5 * E_m
    assert abs(ran.points[0].sag - sag(Membrane(E_m=E_m)).centre_m) < 5 * ran.points[0].sag_errors + 1e-8


@pytest.mark.deep
def test_a_reference_that_lies_deeper_than_it_says_is_within_the_error(tmp_path: Path) -> None:
    with laboratory(simulated(plant_rate_hz=10e3, hands={"reference_m": 20e-6})) as lab:
        ran = run(SHORT, tmp_path, lab)
    value, error = estimates_of(ran.path)["E_m"]
    assert 1e-3 * error < abs(value - 6.95e6) < error


@pytest.mark.deep
def test_a_sag_beyond_the_sensor_is_asked_about_flagged_and_gives_no_modulus(tmp_path: Path) -> None:
    with laboratory(simulated(plant_rate_hz=10e3)) as lab:
        ran = run(MembraneSag(repeats=1, reference_m=1e-3, sample_rate_hz=1000), tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED
    questions = [e.prompt for e in ran.events if isinstance(e, PromptShown) and e.prompt.action == "out-of-range"]
    assert len(questions) == 2
    assert_names(questions[0].text, "reference_m")
    assert questions[0].choices == ("repeat", "keep")
    assert ran.points[0].quality & Quality.OUT_OF_RANGE
    assert estimates_of(ran.path) == {}


class Stops:
    """An operator who stops at the n-th prompt of an action."""

    def __init__(self, lab: Any, action: str, cancel: Any) -> None:
        self.operator, self.action, self.cancel = lab.operator, action, cancel
        self.seen = 0

    def show(self, ask_id: int, prompt: Prompt) -> None:
        self.seen += prompt.action == self.action
        if self.seen == 2 and prompt.action == self.action:
            self.cancel.set()
        else:
            self.operator.show(ask_id, prompt)

    def answer(self, ask_id: int) -> str | None:
        return self.operator.answer(ask_id)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("action", ["place-reference", "hang-membrane"])
def test_stop_at_any_prompt_keeps_what_was_measured(action: str, tmp_path: Path) -> None:
    cancel = threading.Event()
    with laboratory(simulated(plant_rate_hz=10e3)) as lab:
        ran = run(SHORT, tmp_path, lab, operator=Stops(lab, action, cancel), cancel=cancel)
    assert ran.status == RunStatus.STOPPED
    with Run(ran.path) as file:
        assert len(file.points()["sag"]) == 1


def test_modulus_inverts_sag_and_matches_linear_theory_without_stretch() -> None:
    for E_m in (1e5, 6.95e6, 1e9):
        for delta in (0.0, 0.01):
            strip = Membrane(E_m=E_m)
            assert young_modulus_from_sag(Membrane(), sag(strip, delta=delta).centre_m, delta=delta) == pytest.approx(
                E_m, rel=1e-6
            )
    thick = Membrane(h_m=0.02, E_m=1e9)
    little = sag(thick, 0.01).centre_m
    assert linear_young_modulus(thick, little, 0.01) == pytest.approx(
        young_modulus_from_sag(thick, little, 0.01), rel=1e-6
    )
    with pytest.raises(ParameterError, match="no modulus gives this membrane a sag"):
        young_modulus_from_sag(Membrane(), -1e-3)


def test_the_standard_error_is_what_uncertain_inputs_make_of_it() -> None:
    protocol = MembraneSag(
        length_error_m=0, thickness_error_m=0, density_error_kg_per_m3=50, elongation_error_m=0, reference_error_m=0
    )
    w = sag(Membrane()).centre_m
    point = SagPoint(1.0, w, 0.0, 0.0, 0.0, 0.0, int(Quality.SIMULATED))
    error = {e.name: e.standard_error for e in protocol.estimates([point])}["E_m"]
    assert error == pytest.approx(0.05 * 6.95e6, rel=0.02)  # E_m is proportional to the load at a given sag
