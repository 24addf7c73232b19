"""Benches for the tests of the simulated hardware."""

import pytest

from sim_hardware.bench import VirtualBench
from sim_hardware.clock import VirtualClock
from sim_hardware.direct import DirectLink
from sim_hardware.truth import BenchTruth


@pytest.fixture
def bench() -> VirtualBench:
    return VirtualBench(BenchTruth(), VirtualClock())


@pytest.fixture
def link(bench: VirtualBench) -> DirectLink:
    return bench.link()
