"""Benches for the tests of the simulated hardware."""

import pytest

from sim_hardware.bench import VirtualBench
from sim_hardware.clock import VirtualClock
from sim_hardware.plant.parameters import BenchTruth
from sim_hardware.wires.in_process_link import DirectLink


@pytest.fixture
def bench() -> VirtualBench:
    return VirtualBench(BenchTruth(), VirtualClock())


@pytest.fixture
def link(bench: VirtualBench) -> DirectLink:
    return bench.link()
