"""Source contract of DC supplies, as far as it applies: holds and steps, slow fall."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import pytest

from drivers.clock import WallClock
from drivers.drive_shapes import Hold, LinearSweep, Ramp, Sine, Steps
from drivers.errors import InstrumentError, LinkError
from drivers.supplies.dc_supply import DcSupply
from drivers.transport.visa import VisaLink
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.service.served_bench import ServedBench
from sim_hardware.testing.source_contract import (  # noqa: F401 - pytest collects them here again, with this module's sources
    SourceUnderTest,
    energised,
    test_close_leaves_the_output_at_rest,
    test_initialize_at_rest_from_power_up_state,
    test_rest_check_is_harmless_with_high_voltage_on,
)
from tests.helpers.generators import impatient_while_broken
from tests.helpers.simulated_bench import assert_safe_voltage, simulated

MODELS = ("E36312A", "E3631A", "DP832", "SPD3303X")


@contextmanager
def direct(model: str, **truth) -> Iterator[SourceUnderTest]:
    bench = SimulatedBench(
        simulated(source="supply", supply={"model": model, **truth}).simulation_parameters, VirtualClock()
    )
    source = DcSupply(bench.link(), bench.clock)
    yield source, bench, bench.clock
    source.close()


@contextmanager
def on_a_socket(model: str) -> Iterator[SourceUnderTest]:
    bench = SimulatedBench(simulated(source="supply", supply={"model": model}).simulation_parameters, WallClock(5.0))
    with ServedBench(bench) as served:
        link = VisaLink(served.scpi.resource, timeout_s=2.0)
        impatient_while_broken(link, bench)
        source = DcSupply(link, bench.clock)
        yield source, bench, bench.clock
        source.close()


MAKES = [
    *(pytest.param(partial(direct, model), id=f"{model}-direct") for model in MODELS),
    pytest.param(partial(on_a_socket, "E36312A"), id="E36312A-socket"),
    pytest.param(partial(on_a_socket, "SPD3303X"), id="SPD3303X-socket", marks=pytest.mark.deep),
]


@pytest.fixture(params=MAKES)
def device_under_test(request: pytest.FixtureRequest) -> Iterator[SourceUnderTest]:
    with request.param() as device_under_test:
        yield device_under_test


def test_levels_are_reached_in_small_steps_and_the_fall_is_waited_for(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    assert isinstance(source, DcSupply)
    source.ramp_to(3.5, 0.2)
    before = clock.now()
    source.ramp_to(2.5, 0.05)
    assert clock.now() - before > 0.1  # a fall of 1 V to within 20 mV takes four time constants of 50 ms
    assert source.longest_settling_s > 0.05
    assert bench.supply.measured_v() == pytest.approx(2.5, abs=0.021)
    clock.sleep(0.3)
    report = bench.report()
    assert_safe_voltage(report)
    assert report.highest_v == pytest.approx(3.5, abs=0.02)
    assert report.steepest_v_per_s < 200  # steps of 50 mV in a millisecond each, not one of a volt


@pytest.mark.parametrize("model", MODELS)
def test_nothing_is_ever_sent_that_takes_the_output_off(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[str] = []
    with direct(model) as device_under_test:
        _, bench, _ = device_under_test
        handle = bench.message_port.handle
        monkeypatch.setattr(bench.message_port, "handle", lambda message: (sent.append(message), handle(message))[1])
        source, _, _ = energised(device_under_test)
        source.start_drive(Hold(2.5, 0.1))
        source.ramp_to(3.0, 0.1)
        source.stop()
        source.ramp_to(2.5, 0.1)
        source.reconnect()
        source.close()
    assert any("ON" in message for message in sent)
    assert not [message for message in sent if "OFF" in message or "*RST" in message or "APPL" in message]


@pytest.mark.parametrize("drive", [Sine(5.0, 1.0, 2.5, 5), LinearSweep(1.0, 3.0, 1.0, 1.0, 2.5)])
def test_a_sine_is_refused_in_a_sentence_and_nothing_moves(drive, device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    with pytest.raises(
        InstrumentError, match=r"can hold and step, but not play a .*falls in up to 2 s.*Nothing was sent"
    ):
        source.start_drive(drive)
    clock.sleep(0.1)
    assert bench.report().outside_rest_s == 0


@pytest.mark.deep
def test_steps_go_on_while_the_run_does() -> None:
    with on_a_socket("E36312A") as device_under_test:
        source, bench, clock = energised(device_under_test)
        source.start_drive(Steps((2.5, 3.5, 2.0, 2.5), 1.5, 0.5))
        assert not source.is_at_rest(2.5, 0.0, 5.0)
        with pytest.raises(InstrumentError, match="plays"):
            source.start_drive(Ramp(2.5, 3.0, 0.1))
        # Who takes the steps does so in real time, and may be held up on a busy computer; so may we.
        most_s = clock.now() + 300.0
        while bench.report().lowest_v > 2.05 or abs(bench.supply.measured_v() - 2.5) > 0.02:
            assert clock.now() < most_s
            clock.sleep(0.5)
        source.stop()
        assert source.is_at_rest(2.5, 0.0, 5.0)
        clock.sleep(0.3)
        report = bench.report()
        assert_safe_voltage(report)
        assert report.lowest_v == pytest.approx(2.0, abs=0.05)
        assert report.highest_v == pytest.approx(3.5, abs=0.05)


@pytest.mark.deep
def test_steps_that_are_stopped_stay_where_they_are() -> None:
    with on_a_socket("E36312A") as device_under_test:
        source, bench, clock = energised(device_under_test)
        source.start_drive(Steps((2.5, 3.5, 2.5), 4.0, 0.5))
        clock.sleep(6.5)
        source.stop()
        assert source.idle_level_v() == pytest.approx(3.5, abs=1e-3)
        source.ramp_to(2.5, 0.2)
        clock.sleep(0.3)
        assert_safe_voltage(bench.report())


@pytest.mark.parametrize("model", ["E36312A", "DP832"])
def test_protection_that_could_trip_is_refused_before_the_output_comes_up(model: str) -> None:
    """The protection's trip is 0 V: the naive 5.0 V would put -500 V on the specimen at the first full step."""
    with (
        direct(model, ovp=True, ovp_v=5.0) as (source, bench, _),
        pytest.raises(InstrumentError, match=r"over-voltage protection at 5 V could trip .* at least 5.3 V or off"),
    ):
        source.initialize_at_rest(2.5, 0.0, 5.0)
    assert not bench.supply.output_on


@pytest.mark.parametrize("model", ["E36312A", "DP832"])
def test_protection_that_has_tripped_is_said(model: str) -> None:
    with direct(model, ovp=True, ovp_v=6.0) as (source, bench, _):
        bench.supply.ovp_tripped = True
        with pytest.raises(InstrumentError, match="protection has tripped; clear it at the front panel"):
            source.initialize_at_rest(2.5, 0.0, 5.0)


@pytest.mark.parametrize("model", MODELS)
def test_a_fall_slower_than_promised_is_a_sentence_with_a_remedy(model: str) -> None:
    with direct(model, fall_tau_s=2.0) as device_under_test:
        source, _, _ = energised(device_under_test)
        source.ramp_to(4.5, 0.2)
        with pytest.raises(InstrumentError, match=r"measures .* V after 2.* put 1 kohm across its output"):
            source.ramp_to(2.5, 0.1)


@pytest.mark.parametrize("model", MODELS)
def test_an_output_that_went_off_is_not_at_rest(model: str) -> None:
    with direct(model) as device_under_test:
        source, bench, clock = energised(device_under_test)
        bench.supply.output_on = False  # switched off at the front panel
        bench.supply.update_output()
        clock.sleep(1.0)
        assert not source.is_at_rest(2.5, 0.0, 5.0)
        with pytest.raises(InstrumentError, match="has switched itself OFF"):
            source.ramp_to(2.6, 0.1)


@pytest.mark.parametrize("fault", ["scpi-silent", "scpi-late", "scpi-garbled", "scpi-half", "scpi-dropped"])
def test_failed_link_raises_link_error_and_reconnects(fault: str) -> None:
    for make in (direct, on_a_socket):
        with make("E36312A") as device_under_test:
            source, bench, clock = energised(device_under_test)
            bench.inject(fault)
            with pytest.raises(LinkError, match=r"DC supply E36312A: |which is no"):
                source.is_at_rest(2.5, 0.0, 5.0)
            bench.clear(fault)
            clock.sleep(1.0)
            source.reconnect()
            assert source.is_at_rest(2.5, 0.0, 5.0)
            assert_safe_voltage(bench.report())


def test_another_instrument_is_refused() -> None:
    bench = SimulatedBench(simulated().simulation_parameters, VirtualClock())
    with pytest.raises(InstrumentError, match="answered as 'Keysight Technologies 33511B"):
        DcSupply(bench.link(), bench.clock)


@pytest.mark.parametrize("model", MODELS)
def test_a_restart_finds_a_held_level_and_brings_it_to_rest_in_small_steps(model: str) -> None:
    with direct(model) as device_under_test:
        source, bench, clock = energised(device_under_test)
        source.ramp_to(1.0, 0.3)
        second = DcSupply(bench.link(), clock)
        assert not second.is_at_rest(2.5, 0.0, 5.0)
        second.initialize_at_rest(2.5, 0.0, 5.0)
        clock.sleep(0.5)
        report = bench.report()
        assert_safe_voltage(report)
        assert report.steepest_v_per_s < 200  # a single step would be 1500
