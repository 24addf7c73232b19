"""Source contract of the card's analogue output, over gRPC and over NI's local library."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from drivers.drive_shapes import Sine
from drivers.errors import BenchError, InstrumentError
from drivers.nidaq.analog_output import NiAnalogOutput
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.nidaq.task import SimulatedNiDevice
from sim_hardware.service.served_bench import ServedBench
from sim_hardware.testing.source_contract import (  # noqa: F401 - pytest collects them here again, with this module's sources
    SourceUnderTest,
    energised,
    test_close_leaves_the_output_at_rest,
    test_drive_from_another_level_is_rejected_and_output_stays_at_rest,
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
from tests.helpers.simulated_bench import assert_safe_voltage, installed, simulated
from tests.wires.ni_library import NiLibrary


@contextmanager
def card_output_over_grpc() -> Iterator[SourceUnderTest]:
    bench = SimulatedBench(simulated(source="ao0").simulation_parameters, VirtualClock())
    with ServedBench(bench) as served:
        source = NiAnalogOutput("Dev1", "ao0", bench.clock, server=f"127.0.0.1:{served.card.port}")
        yield source, bench, bench.clock
        source.close()
        assert "ResetDevice" not in served.card.calls  # it would put 0 V on every output


@contextmanager
def card_output_by_local_library() -> Iterator[SourceUnderTest]:
    bench = SimulatedBench(simulated(source="ao0").simulation_parameters, VirtualClock())
    with installed(NiLibrary(SimulatedNiDevice(bench.card, bench.clock, bench.faults))):
        source = NiAnalogOutput("Dev1", "ao0", bench.clock)
        yield source, bench, bench.clock
        source.close()


@pytest.fixture(params=[card_output_over_grpc, card_output_by_local_library], ids=lambda make: make.__name__)
def device_under_test(request: pytest.FixtureRequest) -> Iterator[SourceUnderTest]:
    with request.param() as device_under_test:
        yield device_under_test


def test_a_card_whose_cable_is_off_is_a_sentence_and_comes_back(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    bench.inject("card-unplugged")
    with pytest.raises(InstrumentError, match=r"DAQ card Dev1 \(USB-6341\) output ao0: .* check its USB cable"):
        source.start_drive(Sine(50.0, 1.0, 2.5, 5))
    bench.clear("card-unplugged")
    source.reconnect()
    assert source.is_at_rest(2.5, 0.0, 5.0)
    source.start_drive(Sine(50.0, 1.0, 2.5, 5))
    clock.sleep(0.3)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    assert_safe_voltage(bench.report())


def test_dead_server_is_reported_and_rest_reached_when_it_returns() -> None:
    """The server took the running drive with it: the output stays where it was, and is measured before it is moved."""
    with card_output_over_grpc() as (source, bench, clock):
        energised((source, bench, clock))
        source.start_drive(Sine(0.5, 2.0, 2.5, 5))  # far from rest for half a second, however slow this machine is
        clock.sleep(0.3)
        bench.inject("grpc-gone")
        with pytest.raises(BenchError, match=r"\bDev1\b.*\bserver\b"):
            source.stop()
        stuck_v = bench.report().end_v
        assert abs(stuck_v - 2.5) > 0.5
        bench.clear("grpc-gone")
        source.reconnect()
        assert source.idle_level_v() == pytest.approx(stuck_v, abs=2e-3)
        source.stop()
        source.ramp_to(2.5, 0.3)
        assert source.is_at_rest(2.5, 0.0, 5.0)
        assert_safe_voltage(bench.report())
