"""Digitizer contract: NI's driver over gRPC, over NI's local library, a LabJack's over Modbus TCP, and the in-process card."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from drivers.clock import WallClock
from drivers.errors import BenchError
from drivers.labjack.digitizer import T7Digitizer
from drivers.nidaq.analog_input import NiDigitizer
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.nidaq.task import SimulatedNiDevice
from sim_hardware.service.served_bench import ServedBench
from sim_hardware.testing.digitizer_contract import (  # noqa: F401 - pytest collects them here, with this module's cards
    DigitizerUnderTest,
    test_block_is_not_overwritten_by_the_next_one,
    test_blocks_are_gapless_int16_of_both_channels,
    test_closed_stream_raises_on_read,
    test_excessive_rate_is_rejected_with_a_remedy,
    test_lost_scans_and_lost_card_raise_acquisition_error,
    test_scale_converts_counts_to_true_volts,
    test_scale_reports_conversion_skew_of_each_channel,
    test_second_simultaneous_stream_is_rejected,
    test_stream_can_be_restarted,
    test_stream_reports_time_of_first_scan,
)
from tests.helpers.simulated_bench import installed, simulated
from tests.wires.ni_library import NiLibrary


@contextmanager
def without_a_wire() -> Iterator[DigitizerUnderTest]:
    bench = SimulatedBench(simulated().simulation_parameters, VirtualClock())
    yield bench.digitizer(), bench


@contextmanager
def ni_over_grpc() -> Iterator[DigitizerUnderTest]:
    bench = SimulatedBench(simulated().simulation_parameters, WallClock(5.0))
    with ServedBench(bench) as served:
        card = NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock, server=f"127.0.0.1:{served.card.port}")
        yield card, bench
        card.close()


@contextmanager
def ni_local_library() -> Iterator[DigitizerUnderTest]:
    bench = SimulatedBench(simulated().simulation_parameters, WallClock(5.0))
    with installed(NiLibrary(SimulatedNiDevice(bench.card, bench.clock, bench.faults))):
        card = NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock)
        yield card, bench
        card.close()


@contextmanager
def labjack() -> Iterator[DigitizerUnderTest]:
    bench = SimulatedBench(simulated(card={"product": "T7"}).simulation_parameters, WallClock(5.0))
    with ServedBench(bench) as served:
        card = T7Digitizer("192.0.2.9", ("AIN0", "AIN1"), bench.clock, server=served.card.address)
        yield card, bench
        card.close()


@pytest.fixture(params=[without_a_wire, ni_over_grpc, ni_local_library, labjack], ids=lambda make: make.__name__)
def device_under_test(request: pytest.FixtureRequest) -> Iterator[DigitizerUnderTest]:
    with request.param() as device_under_test:
        yield device_under_test


def test_it_says_who_it_is(device_under_test: DigitizerUnderTest) -> None:
    card, bench = device_under_test
    assert card.identity.model == bench.parameters.card.product
    assert card.identity.serial


def test_a_dead_server_is_a_sentence() -> None:
    with pytest.raises(BenchError, match=r"gRPC device server does not answer .* check that it runs and its address"):
        NiDigitizer("Dev1", ("ai0", "ai1"), WallClock(), server="127.0.0.1:9")


def test_a_card_that_is_not_there_is_a_sentence() -> None:
    with (
        ServedBench(SimulatedBench(simulated().simulation_parameters, WallClock(5.0))) as served,
        pytest.raises(BenchError, match="DAQ card Dev7"),
    ):
        NiDigitizer("Dev7", ("ai0", "ai1"), WallClock(), server=f"127.0.0.1:{served.card.port}")


def test_no_ni_driver_on_this_computer_says_what_to_install() -> None:
    with pytest.raises(BenchError, match=r"NI-DAQmx driver is not installed .* ni.com/daqmx .*--bench sim"):
        NiDigitizer("Dev1", ("ai0", "ai1"), WallClock())


def test_a_card_with_a_converter_for_each_channel_has_no_skew() -> None:
    bench = SimulatedBench(simulated(card={"convert_s": 0.0}).simulation_parameters, WallClock(5.0))
    with ServedBench(bench) as served:
        card = NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock, server=f"127.0.0.1:{served.card.port}")
        with card.stream(5000.0, 100) as stream:
            assert [scale.skew_s for scale in stream.scales] == [0.0, 0.0]
        card.close()
