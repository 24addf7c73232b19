"""Every command and ordering rule of a DC supply, compared with data that name their sources."""

import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from drivers.supplies.dc_supply import DcSupply
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from tests.drivers.test_keysight_33500 import Tapped
from tests.drivers.test_supply_models import SIMULATED, WITH_OCP, WITH_TRACKING
from tests.helpers.instrument_commands import (
    SOURCE,
    Recorded,
    assert_in_order,
    commands_of,
    never_sent,
    sourced,
    without_source,
)
from tests.helpers.simulated_bench import simulated

pytestmark = pytest.mark.deep

DATA = tomllib.loads((Path(__file__).parents[1] / "data" / "supply_commands.toml").read_text("utf-8"))


NO_OVP = ("E3631A", "SPD3303X")
"""Without over-voltage protection over the wire."""


@cache
def recorded(model: str) -> Recorded:
    """Return what is sent at arming, after another user, at levels and Stop, and by a new connection."""
    left = {"ovp": model not in NO_OVP, "ocp": model in WITH_OCP, "tracking": model in WITH_TRACKING}
    config = simulated(source="supply", supply={"model": model, **left})
    bench = SimulatedBench(config.simulation_parameters, VirtualClock())
    link = Tapped(bench.link())
    source = DcSupply(link, bench.clock)
    sent: list[tuple[str, str]] = []
    for phase in act(source):
        sent += ((phase, command) for message in link.sent for command in commands_of(message))
        link.sent.clear()
    return tuple(sent)


def act(source: DcSupply) -> Iterator[str]:
    """Work with the driver; yield the name of each phase after it."""
    source.initialize_at_rest(2.5, 0.0, 5.0)
    yield "arm"
    source.ramp_to(3.0, 0.1)
    source.ramp_to(2.5, 0.1)
    source.stop()
    yield "level"
    source.is_left_live(2.5, 0.0, 5.0)
    source.reconnect()
    assert source.is_at_rest(2.5, 0.0, 5.0)
    yield "check"


@pytest.mark.parametrize("model", SIMULATED)
def test_every_command_of_a_supply_has_a_source_and_no_source_is_of_another(model: str) -> None:
    known = sourced(each for each in DATA["sources"] if model in each["models"])
    assert not without_source(recorded(model), known)
    assert not never_sent(recorded(model), known)


def test_every_source_and_rule_of_a_supply_names_where_it_comes_from_or_is_unproven() -> None:
    texts = [each["source"] for each in DATA["sources"]] + [rule["why"] for rule in DATA["order"]]
    assert not [text for text in texts if not SOURCE.search(text)]


@pytest.mark.parametrize("model", SIMULATED)
def test_the_ordering_rules_of_a_supply_are_kept(model: str) -> None:
    for rule in DATA["order"]:
        if model in rule["models"]:
            assert_in_order(recorded(model), rule)


@pytest.mark.parametrize("model", SIMULATED)
def test_the_output_of_a_supply_is_never_switched_off(model: str) -> None:
    switches = ("*RST", "*RCL", "OUTP OFF", "OUTP CH1,OFF", "OUTP:STAT OFF", "APPL")
    assert not [c for _, c in recorded(model) if c.startswith(switches)]
