"""Every command and ordering rule of arm, play and stop of a generator, compared with data that name their sources."""

import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from app.config.driver_registry import SOURCES, built_in_names, load_driver
from drivers.drive_shapes import Hold, LinearSweep, PeriodicSweep, Sine, SquareWave, Steps
from drivers.generators.burst import BurstGenerator
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.generators.registry import traits_of
from tests.drivers.test_keysight_33500 import Tapped
from tests.helpers.front_panel import press
from tests.helpers.instrument_commands import (
    SOURCE,
    Recorded,
    assert_in_order,
    commands_of,
    is_about,
    never_sent,
    sourced,
    steps_of,
    without_source,
)
from tests.helpers.simulated_bench import simulated

DATA = Path(__file__).parents[1] / "data" / "instrument_commands"
FILES = {path.stem: tomllib.loads(path.read_text("utf-8")) for path in sorted(DATA.glob("*.toml"))}
CASES = [(driver, model) for driver, data in FILES.items() for model in data["models"]]

OUTPUT_OFF = ("*RST", "*RCL", "APPL ", "OUTP OFF", "OUTP1 OFF", "OUTP1:STAT OFF", "C1:OUTP OFF", "FUNC DC", "WVTP,DC")
DRIVES = (
    Sine(50.0, 1.0, 2.5, 10),
    LinearSweep(10.0, 20.0, 3.0, 0.5, 2.5),  # two packets on a DG1000Z
    PeriodicSweep(10.0, 30.0, 0.5, 2, 0.5, 2.5),
    Steps((2.5, 3.0, 2.5), 0.05, 0.05),
    SquareWave(50.0, 0.5, 2.5, 0.5, 2e-3, 10),
    Sine(50.0, 1.0, 2.5, 10),  # from the memory, where it is kept there
)


@cache
def recorded(driver: str, model: str) -> Recorded:
    """Return what is sent from the lock of the panel to a new connection."""
    traits = " ".join(f"{t.name}={t.options[0]}" for t in traits_of(model))
    traits += FILES[driver].get("traits", "")
    config = simulated(generator={"model": model, "traits": traits})
    bench = SimulatedBench(config.simulation_parameters, VirtualClock())
    for setting in FILES[driver].get("left_by_others", ()):
        press(bench.link(), setting)
    link = Tapped(bench.link())
    source = load_driver(SOURCES, driver)(link, bench.clock)
    assert isinstance(source, BurstGenerator)
    sent: list[tuple[str, str]] = []
    for number, phase in enumerate(act(source)):
        sent += ((f"{phase} {number}", command) for message in link.sent for command in commands_of(message))
        link.sent.clear()
    return tuple(sent)


def act(source: BurstGenerator) -> Iterator[str]:
    """Work with a driver; yield the name of each phase after it."""
    source.lock_panel()
    source.unlock_panel()
    yield "panel"
    source.initialize_at_rest(2.5, 0.0, 5.0)
    yield "arm"
    source.is_left_live(2.5, 0.0, 5.0)
    yield "check"
    for drive in DRIVES:
        source.start_drive(drive)
        yield "play"
        source.stop()
        yield "stop"
    source.start_level(source.level_pulse(Hold(3.0, 1.0), 2.5, 5.0))
    yield "play"
    source.end_level(0.2)
    yield "stop"
    source.ramp_to(3.0, 0.1)
    source.ramp_to(2.5, 0.1)
    yield "offset"
    source.reconnect()
    assert source.is_at_rest(2.5, 0.0, 5.0)
    yield "check"


def rules(driver: str, model: str, part: str) -> list[dict[str, Any]]:
    return [rule for rule in FILES[driver][part] if model in rule.get("models", (model,))]


def test_every_generator_driver_has_its_data() -> None:
    drivers = [name for name in built_in_names(SOURCES) if hasattr(load_driver(SOURCES, name), "supports_model")]
    assert sorted(drivers) == sorted(FILES)


@pytest.mark.parametrize(("driver", "model"), CASES)
def test_every_command_has_a_source(driver: str, model: str) -> None:
    assert not without_source(recorded(driver, model), sourced(FILES[driver]["sources"]))


@pytest.mark.parametrize("driver", FILES)
def test_no_source_is_of_a_command_that_is_not_sent(driver: str) -> None:
    sent = tuple(each for model in FILES[driver]["models"] for each in recorded(driver, model))
    assert not never_sent(sent, sourced(FILES[driver]["sources"]))


@pytest.mark.parametrize("driver", FILES)
def test_every_source_and_rule_names_where_it_comes_from_or_is_unproven(driver: str) -> None:
    texts = [each["source"] for each in FILES[driver]["sources"]]
    texts += [rule["why"] for part in ("order", "never") for rule in FILES[driver][part]]
    assert not [text for text in texts if not SOURCE.search(text)]


@pytest.mark.parametrize(("driver", "model"), CASES)
def test_the_ordering_rules_are_kept(driver: str, model: str) -> None:
    for rule in rules(driver, model, "order"):
        assert_in_order(recorded(driver, model), rule)


@pytest.mark.parametrize(("driver", "model"), CASES)
def test_what_a_phase_must_not_send_is_not_sent(driver: str, model: str) -> None:
    for rule in rules(driver, model, "never"):
        steps = steps_of(recorded(driver, model), rule["phase"])
        assert steps, rule
        assert not [command for commands in steps for command in commands if is_about(command, rule["then"])], rule


@pytest.mark.parametrize(("driver", "model"), CASES)
def test_nothing_that_takes_the_output_away_is_ever_sent(driver: str, model: str) -> None:
    assert not [c for _, c in recorded(driver, model) if any(part in c for part in OUTPUT_OFF)]
