"""Source contract of every function generator's driver on its simulated instrument, in process and over TCP."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import pytest

from drivers.clock import WallClock
from drivers.transport.visa import VisaLink
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.service.served_bench import ServedBench
from sim_hardware.testing.source_contract import (  # noqa: F401 - pytest collects them here, with this module's sources
    SourceUnderTest,
    energised,
    test_close_leaves_the_output_at_rest,
    test_drive_from_another_level_is_rejected_and_output_stays_at_rest,
    test_failed_link_raises_link_error_and_reconnects,
    test_initialize_at_rest_from_power_up_state,
    test_levels_are_reached_and_left_in_small_steps,
    test_ramp_is_played,
    test_rest_check_is_harmless_with_high_voltage_on,
    test_sine_starts_and_ends_at_rest_by_itself,
    test_small_and_large_drives_in_sequence_cause_no_jump,
    test_stop_ramps_a_sine_down_from_any_phase,
    test_sweep_and_steps_follow_the_drive_and_end_at_rest,
    test_unsupported_drive_is_rejected_and_output_stays_at_rest,
)
from tests.helpers.generators import BOXES, impatient_while_broken, truth


@contextmanager
def direct(model: str) -> Iterator[SourceUnderTest]:
    bench = SimulatedBench(truth(model), VirtualClock())
    source = BOXES[model](bench.link(), bench.clock)
    yield source, bench, bench.clock
    source.close()


@contextmanager
def on_a_socket(model: str) -> Iterator[SourceUnderTest]:
    bench = SimulatedBench(truth(model), WallClock(20.0))
    with ServedBench(bench) as served:
        link = VisaLink(f"TCPIP::127.0.0.1::{served.scpi.port}::SOCKET", timeout_s=2.0)
        impatient_while_broken(link, bench)
        source = BOXES[model](link, bench.clock)
        yield source, bench, bench.clock
        source.close()


DIRECT = [pytest.param(partial(direct, model), id=f"{model} direct") for model in BOXES]
"""Every maker's dialect on one wire."""

SOCKET = [
    pytest.param(
        partial(on_a_socket, model),
        id=f"{model} on a socket",
        marks=() if model == "33511B" else pytest.mark.deep,
    )
    for model in BOXES
    if model != "AFG1022"
]
"""One maker's on every wire (the others are in test_sources_wires.py); each of the others on a socket is deep."""


@pytest.fixture(params=[*DIRECT, *SOCKET])
def device_under_test(request: pytest.FixtureRequest) -> Iterator[SourceUnderTest]:
    with request.param() as device_under_test:
        yield device_under_test
