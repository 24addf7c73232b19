"""Every command and ordering rule of a DC supply, compared with data that name their sources."""

import tomllib
from functools import cache
from pathlib import Path

import pytest

from drivers.supplies.dc_supply import DcSupply
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from tests.drivers.test_keysight_33500 import Tapped
from tests.drivers.test_supply_models import SIMULATED
from tests.helpers.simulated_bench import simulated

pytestmark = pytest.mark.deep

DATA = tomllib.loads((Path(__file__).parents[1] / "data" / "supply_commands.toml").read_text("utf-8"))


@cache
def sent(model: str) -> tuple[str, ...]:
    """Return the commands and queries of arm, levels, Stop and a new connection, one by one."""
    config = simulated(source="supply", supply={"model": model})
    bench = SimulatedBench(config.simulation_parameters, VirtualClock())
    link = Tapped(bench.link())
    source = DcSupply(link, bench.clock)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    source.is_left_live(2.5, 0.0, 5.0)
    source.ramp_to(3.0, 0.1)
    source.ramp_to(2.5, 0.1)
    source.stop()
    source.reconnect()
    assert source.is_at_rest(2.5, 0.0, 5.0)
    return tuple(command.strip().removeprefix(":") for message in link.sent for command in message.split(";"))


@pytest.mark.parametrize("model", SIMULATED)
def test_every_command_of_a_supply_has_a_source_and_no_source_is_of_another(model: str) -> None:
    known = {name for each in DATA["sources"] if model in each["models"] for name in each["headers"]}
    assert {command.partition(" ")[0].rstrip("?") for command in sent(model)} == known


@pytest.mark.parametrize("model", SIMULATED)
def test_the_ordering_rules_of_a_supply_are_kept(model: str) -> None:
    commands = sent(model)
    for rule in DATA["order"]:
        if model not in rule["models"]:
            continue
        firsts = [i for i, c in enumerate(commands) if c.startswith(tuple(rule["first"]))]
        thens = [i for i, c in enumerate(commands) if c.startswith(tuple(rule["then"]))]
        assert firsts, rule
        assert thens, rule
        assert firsts[0] < thens[0], rule


@pytest.mark.parametrize("model", SIMULATED)
def test_the_output_of_a_supply_is_never_switched_off(model: str) -> None:
    assert not [c for c in sent(model) if c.startswith(("*RST", "*RCL")) or (c.startswith("OUTP") and "OFF" in c)]
