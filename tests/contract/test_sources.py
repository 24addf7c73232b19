"""Every function generator's driver on its simulated box passes the contract for sources, without a wire and over TCP."""

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
    test_a_drive_that_begins_elsewhere_is_refused_and_nothing_moves,
    test_a_drive_that_cannot_be_made_is_a_sentence_and_nothing_moves,
    test_a_failed_wire_is_a_sentence_and_can_be_opened_anew,
    test_a_fresh_box_is_not_at_rest_and_is_brought_there,
    test_a_ramp_is_played,
    test_a_sine_is_stopped_gently_from_any_phase,
    test_a_sine_starts_at_rest_with_known_phase_and_ends_there_by_itself,
    test_a_sweep_and_steps_are_played_at_once_and_end_at_rest_by_themselves,
    test_letting_go_leaves_the_output_at_rest,
    test_levels_are_reached_in_small_steps_and_left_the_same_way,
    test_preparing_twice_is_harmless_even_live,
    test_small_and_large_drives_follow_each_other_without_a_jump,
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
def made(request: pytest.FixtureRequest) -> Iterator[SourceUnderTest]:
    with request.param() as made:
        yield made
