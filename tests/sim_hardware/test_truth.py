"""Simulation parameters: unchanged by JSON; invalid ones rejected by name."""

import json

import pytest

from model.parameters import Skin
from sim_hardware.plant.parameters import CardParameters, GeneratorParameters, SimulationParameters


def test_truth_survives_json():
    truth = SimulationParameters(
        skin=Skin(1e4, 300.0), seed=7, generator=GeneratorParameters(clock_ppm=50.0), card=CardParameters(noise_v=0)
    )
    assert SimulationParameters.from_record(json.loads(json.dumps(truth.as_record()))) == truth


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({"sensor": {"gain": 1.0}}, r"\.sensor: unknown gain"),
        ({"seed": 1.5}, "seed: expected a whole number"),
        ({"amplifier": {"slew_v_per_s": "fast"}}, "slew_v_per_s: expected a finite number"),
        ({"amplifier": {"slew_v_per_s": 0}}, "slew_v_per_s must be positive"),
        ({"amplifier": {"enabled": 1}}, "enabled: expected true or false"),
        ({"amplifier": {"map": {"rest_v": 9.0}}}, "rest 9.0 V"),
        ({"tactor": {"L": -1}}, "half length"),
        ({"card": {"coefficients": [1.0]}}, "coefficients"),
        ({"card": {"coefficients": 3}}, "expected a list"),
        ({"sensor": 3}, "expected a table"),
        ({"speed": 0}, "speed must be positive"),
        ({"sensor": {"gain_m_per_v": 0}}, "gain_m_per_v must not be 0"),
        ({"sensor": {"delay_s": -1}}, "must not be negative"),
    ],
)
def test_nonsense_is_refused_by_name(record, message):
    with pytest.raises(ValueError, match=message):
        SimulationParameters.from_record(record)
