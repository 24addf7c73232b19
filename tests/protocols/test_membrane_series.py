"""Membrane series: dwells at elongations between two of the free tactor; a wrongly stretched membrane is detected."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from model.membrane import skin
from model.parameters import Membrane, Tactor
from model.response.harmonic_response import amplifier_response
from protocols.base import LogMessage, PromptShown, Quality
from protocols.measurements.membrane_series import MembraneSeries
from protocols.runfile.reader import Run
from sim_hardware.operator import SimulatedOperator
from tests.helpers.simulated_bench import laboratory, run

pytestmark = pytest.mark.deep

SHORT = {"frequencies_hz": (25.0, 50.0, 150.0), "record_s": 0.2, "min_cycles": 5}
SERIES = MembraneSeries(elongations_m=(0.0, 2.54e-3, 6.35e-3), m_per_turn=1.27e-3, **SHORT)  # type: ignore[arg-type]


class Mistaken(SimulatedOperator):
    """Loosens the membrane where it should be stretched."""

    def show(self, ask_id: int, prompt: Any) -> None:
        if prompt.action == "stretch-membrane":
            prompt = type(prompt)(prompt.action, prompt.text, {"elongation_m": 6.35e-3 - prompt.values["elongation_m"]})
        super().show(ask_id, prompt)


def notes(ran: Any) -> list[str]:
    return [event.text for event in ran.events if isinstance(event, LogMessage)]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory):
    with laboratory() as lab:
        yield run(SERIES, tmp_path_factory.mktemp("runs"), lab)


def test_every_point_is_the_models_at_its_elongation(ran) -> None:
    assert ran.status == "completed"
    assert len(ran.points) == 5 * 3
    for point in ran.points:
        pressed = None if math.isnan(point.elongation) else skin(Membrane(), point.elongation / Membrane().L_m)
        (truth,) = np.abs(amplifier_response(Tactor(), np.array([point.frequency]), 2.5, skin=pressed).fundamental)
        assert abs(point.fundamental - truth) < 4 * point.fundamental_errors, point.summary
        assert Quality(point.quality).usable


def test_hands_are_asked_once_for_each_elongation_in_millimetres_and_turns(ran) -> None:
    prompts = [e.prompt for e in ran.events if isinstance(e, PromptShown) and "high-voltage" not in e.prompt.action]
    assert [p.action for p in prompts] == ["remove-membrane", *["stretch-membrane"] * 3, "remove-membrane"]
    assert all(p.hands_on for p in prompts)
    assert "stretch it by 2.54 mm, 2.00 turns" in prompts[2].text


def test_sound_series_has_no_remarks_and_no_drift(ran) -> None:
    assert not SERIES.warnings(ran.points)
    assert not [text for text in notes(ran) if "stretched" in text or "tactor" in text]
    with Run(ran.path) as file:
        found = {e.name: e for e in file.record.estimates}
    drift = found["free_response_drift"]
    assert abs(drift.value) < 4 * drift.standard_error < 1e-3
    tops = [found[f"largest_twice_fundamental, {mm} mm"].value for mm in ("0", "2.54", "6.35")]
    assert tops == sorted(tops, reverse=True)


@pytest.mark.deep
def test_wrongly_stretched_membrane_is_noticed_while_correctable(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SERIES, tmp_path, lab, operator=Mistaken(lab.control))
    messages = [text for text in notes(ran) if "stretched the wrong way" in text]
    assert len(messages) == 2
    assert messages[0].startswith("At 2.54 mm the tactor moves")
    kinds = [(e.kind, getattr(e, "text", "")) for e in ran.events]
    heard = next(i for i, (_, text) in enumerate(kinds) if "wrong way" in text)
    assert "EntryBegan" in [kind for kind, _ in kinds[heard:]]


def test_a_free_tactor_that_changed_meanwhile_is_told(ran) -> None:
    from dataclasses import replace

    points = [replace(p, fundamental=1.03 * p.fundamental) if p.part == 4 else p for p in ran.points]
    (told,) = SERIES.warnings(points)
    assert "The free tactor moves +3.0 % after the series" in told
