"""Every command and ordering rule of arm, play and stop, compared with data that name their sources."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from app.config.driver_registry import SOURCES, load_driver
from drivers.drive import LinearSweep, PeriodicSweep, Sine, Steps
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.generators.traits import traits_of
from tests.drivers.test_keysight_33500 import Tapped
from tests.helpers.simulated_bench import simulated

DATA = Path(__file__).parents[1] / "data" / "instrument_commands"
FILES = {path.stem: tomllib.loads(path.read_text("utf-8")) for path in sorted(DATA.glob("*.toml"))}
CASES = [(driver, model) for driver, data in FILES.items() for model in data["models"]]

OUTPUT_OFF = ("*RST", "*RCL", "APPL ", "OUTP OFF", "OUTP1 OFF", "OUTP1:STAT OFF", "C1:OUTP OFF", "FUNC DC", "WVTP,DC")


@cache
def sent(driver: str, model: str) -> tuple[str, ...]:
    """Return the commands and queries of arm, play, stop, a held level and a new connection, one by one."""
    traits = " ".join(f"{t.name}={t.options[0]}" for t in traits_of(model))
    config = simulated(generator={"model": model, "traits": traits})
    bench = SimulatedBench(config.simulation_parameters, VirtualClock())
    link = Tapped(bench.link())
    source = load_driver(SOURCES, driver)(link, bench.clock)
    if getattr(source, "PANEL_LOCK", None):
        source.lock_panel()  # type: ignore[attr-defined]
        source.unlock_panel()  # type: ignore[attr-defined]
    source.initialize_at_rest(2.5, 0.0, 5.0)
    source.is_left_live(2.5, 0.0, 5.0)
    for drive in (
        Sine(50.0, 1.0, 2.5, 10),
        LinearSweep(10.0, 20.0, 0.5, 0.5, 2.5),
        PeriodicSweep(10.0, 30.0, 0.5, 2, 0.5, 2.5),
        Steps((2.5, 3.0, 2.5), 0.05, 0.05),
    ):
        source.start_drive(drive)
        source.stop()
    source.ramp_to(3.0, 0.1)
    source.ramp_to(2.5, 0.1)
    source.reconnect()
    assert source.is_at_rest(2.5, 0.0, 5.0)
    texts = (m.partition(",#")[0].partition("WAVEDATA")[0] for m in link.sent)
    return tuple(command.strip().removeprefix(":") for text in texts for command in text.split(";"))


def header(command: str) -> str:
    return command.partition(" ")[0].rstrip("?")


def known(data: dict[str, Any]) -> dict[str, str]:
    return {name: each["source"] for each in data["sources"] for name in each["headers"]}


@pytest.mark.parametrize(("driver", "model"), CASES)
def test_every_command_has_a_source(driver: str, model: str) -> None:
    assert {header(command) for command in sent(driver, model)} <= known(FILES[driver]).keys()


@pytest.mark.parametrize("driver", FILES)
def test_no_source_is_of_a_command_that_is_not_sent(driver: str) -> None:
    used = {header(c) for model in FILES[driver]["models"] for c in sent(driver, model)}
    assert used == known(FILES[driver]).keys()


@pytest.mark.parametrize(("driver", "model"), CASES)
def test_the_ordering_rules_are_kept(driver: str, model: str) -> None:
    commands = sent(driver, model)
    for rule in FILES[driver]["order"]:
        firsts = [i for i, c in enumerate(commands) if c.startswith(rule["first"])]
        thens = [
            i
            for i, c in enumerate(commands)
            if c == rule["then"] or c.startswith((rule["then"] + ",", rule["then"] + " "))
        ]
        assert firsts, rule
        assert thens, rule
        assert firsts[0] < thens[0], rule


@pytest.mark.parametrize(("driver", "model"), CASES)
def test_nothing_that_takes_the_output_away_is_ever_sent(driver: str, model: str) -> None:
    assert not [c for c in sent(driver, model) if any(part in c for part in OUTPUT_OFF)]
