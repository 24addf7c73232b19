"""Simulated benches for tests."""

import pytest

from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.plant.parameters import SimulationParameters
from sim_hardware.wires.in_process_link import InProcessLink


@pytest.fixture
def bench() -> SimulatedBench:
    return SimulatedBench(SimulationParameters(), VirtualClock())


@pytest.fixture
def link(bench: SimulatedBench) -> InProcessLink:
    return bench.link()
