"""Meter contract: a value in metres, or a reading that is marked as invalid."""

import math
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from drivers.errors import BenchError, InstrumentError, LinkError
from drivers.interfaces import Meter, Reading
from drivers.sensors.keyence_lkg import KeyenceLkg
from drivers.sensors.optoncdt import OptoNcdt
from drivers.transport.serial_port import SerialPort
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.sensors.laser_sensors import SimulatedKeyenceLkg, SimulatedOptoNcdt
from sim_hardware.wires.pty import PtyServer
from tests.helpers.simulated_bench import simulated

Made = tuple[Meter, SimulatedBench, PtyServer]
TIMEOUT_S = 0.4


@contextmanager
def keyence_lkg_on_a_pty() -> Iterator[Made]:
    bench = SimulatedBench(simulated().simulation_parameters, VirtualClock(0.1))
    with PtyServer(SimulatedKeyenceLkg(bench.laser_reading_m)) as wire:
        meter = KeyenceLkg(SerialPort(wire.port, 9600, TIMEOUT_S), bench.clock)
        yield meter, bench, wire
        meter.close()


@contextmanager
def optoncdt_on_a_pty() -> Iterator[Made]:
    bench = SimulatedBench(simulated().simulation_parameters, VirtualClock(0.1))
    with PtyServer(SimulatedOptoNcdt(bench.laser_reading_m)) as wire:
        meter = OptoNcdt(SerialPort(wire.port, 921600, TIMEOUT_S), bench.clock, range_m=10e-3)
        yield Middle(meter), bench, wire
        meter.close()


class Middle:
    """An optoNCDT counts from the near end of its range; the others, and this suite, from the middle."""

    def __init__(self, meter: OptoNcdt) -> None:
        self._meter = meter
        self.identity = meter.identity
        self.close = meter.close

    def read(self) -> Reading:
        reading = self._meter.read()
        return replace(reading, value=reading.value - 5e-3)


@pytest.fixture(params=[keyence_lkg_on_a_pty, optoncdt_on_a_pty], ids=lambda make: make.__name__)
def made(request: pytest.FixtureRequest) -> Iterator[Made]:
    with request.param() as made:
        yield made


def deflect(bench: SimulatedBench, volts: float) -> float:
    """Hold the amplifier's input at `volts` until the tactor is at rest; return the position of its centre in metres."""
    for message in (
        f"OUTP:LOAD INF;:FUNC SIN;:VOLT 0.01;:VOLT:OFFS {volts};:BURS:NCYC 1;:TRIG:SOUR BUS;:BURS:STAT ON;:OUTP ON",
    ):
        bench.message_port.handle(message)
    bench.enable_hv()
    bench.clock.sleep(3.0)
    seen = bench.laser_reading_m()
    assert seen is not None
    assert abs(seen) > 1e-6
    return seen


def test_it_says_who_it_is(made: Made) -> None:
    assert made[0].identity.maker
    assert made[0].identity.model


def test_a_reading_is_the_displacement_in_metres(made: Made) -> None:
    meter, bench, _ = made
    truth = deflect(bench, 3.0)
    reading = meter.read()
    assert reading.valid
    assert reading.unit == "m"
    assert reading.value == pytest.approx(truth, abs=2e-7)  # the resolution of three bytes, and of four decimals
    assert reading.time_s == pytest.approx(bench.clock.now(), abs=0.1)


def test_a_reading_is_of_now_and_not_of_what_waited_in_the_buffer(made: Made) -> None:
    meter, bench, _ = made
    before = meter.read().value
    truth = deflect(bench, 4.0)
    assert meter.read().value == pytest.approx(truth, abs=2e-7)
    assert abs(truth - before) > 1e-5


def test_out_of_range_is_no_displacement(made: Made) -> None:
    meter, bench, _ = made
    bench.inject("sensor-out-of-range")
    reading = meter.read()
    assert not reading.valid
    assert math.isnan(reading.value)
    bench.clear("sensor-out-of-range")
    assert meter.read().valid


def test_silence_is_a_sentence_and_passes(made: Made) -> None:
    meter, _, wire = made
    wire.unresponsive = True
    with pytest.raises(LinkError, match=r"\b0\.4 s\b.*check"):
        deque((meter.read() for _ in range(3)), maxlen=0)  # what was on its way may still arrive
    wire.unresponsive = False
    assert meter.read().valid


def test_a_pulled_plug_is_a_sentence(made: Made) -> None:
    meter, _, wire = made
    wire.close()
    with pytest.raises(LinkError, match=r"cannot be reached .*check its cable|was silent"):
        deque((meter.read() for _ in range(3)), maxlen=0)


def test_a_port_that_is_not_there_is_a_sentence() -> None:
    with pytest.raises(LinkError, match=r"no-such-port cannot be reached .*check its cable and the port's name"):
        SerialPort("no-such-port", 9600)


def test_an_lkg_that_is_an_optoncdt_is_a_sentence() -> None:
    with PtyServer(SimulatedOptoNcdt(lambda: 0.0)) as wire:
        line = SerialPort(wire.port, 9600, TIMEOUT_S)
        with pytest.raises(BenchError, match=rf"^{wire.port} .*\b{TIMEOUT_S:g} s\b"):
            KeyenceLkg(line, VirtualClock())


def test_an_optoncdt_that_is_an_lkg_is_a_sentence() -> None:
    with PtyServer(SimulatedKeyenceLkg(lambda: 0.0)) as wire:
        line = SerialPort(wire.port, 9600, TIMEOUT_S)
        with pytest.raises(BenchError, match=rf"^{wire.port} .*\b{TIMEOUT_S:g} s\b"):
            OptoNcdt(line, VirtualClock(), range_m=10e-3)


def test_an_lkg_in_its_setting_screen_says_so() -> None:
    controller = SimulatedKeyenceLkg(lambda: 0.0)
    with PtyServer(controller) as wire:
        meter = KeyenceLkg(SerialPort(wire.port, 9600, TIMEOUT_S), VirtualClock())
        controller.in_setting_mode = True
        with pytest.raises(InstrumentError, match="bring it from its setting screen back to measuring"):
            meter.read()
        meter.close()


def test_an_output_that_does_not_measure_is_not_valid() -> None:
    with PtyServer(SimulatedKeyenceLkg(lambda: 1e-3)) as wire:
        meter = KeyenceLkg(SerialPort(wire.port, 9600, TIMEOUT_S), VirtualClock(), output=2)
        assert not meter.read().valid
        meter.close()


def test_another_measuring_range_than_the_bench_file_says_is_refused() -> None:
    """If a 10 mm sensor is configured as one of 25 mm, readings would be two and a half times too large."""
    with (
        PtyServer(SimulatedOptoNcdt(lambda: 0.0, range_m=10e-3)) as wire,
        pytest.raises(InstrumentError, match=r"has a measuring range of 10.00 mm, the bench file says 25 mm"),
    ):
        OptoNcdt(SerialPort(wire.port, 921600, TIMEOUT_S), VirtualClock(), range_m=25e-3)


def optoncdt(model: SimulatedOptoNcdt, wire: PtyServer) -> OptoNcdt:
    return OptoNcdt(SerialPort(wire.port, 921600, TIMEOUT_S), VirtualClock(0.1), range_m=10e-3)


def test_an_additional_value_is_no_displacement() -> None:
    """It is sent all the same where the sensor refuses OUTADD_RS422: bit 6 of the third byte tells it (ILD1420 p. 84)."""
    model = SimulatedOptoNcdt(lambda: 1e-3)
    with PtyServer(model) as wire:
        meter = optoncdt(model, wire)
        model.additional_values = True
        for _ in range(5):
            assert meter.read().value == pytest.approx(6e-3, abs=2e-7)
        meter.close()


@pytest.mark.parametrize(
    ("reply", "says"),
    [("E01 Unknown command", ""), ("E09 Access denied", "send MASTERMV NONE")],
    ids=["unknown", "denied"],
)
def test_a_master_value_that_stays_is_a_sentence(reply: str, says: str) -> None:
    model = SimulatedOptoNcdt(lambda: 1e-3)
    obey = model._respond
    model._respond = lambda line: f"{line}\r\n{reply}\r\n->".encode() if "MASTER" in line else obey(line)  # type: ignore[method-assign]
    with PtyServer(model) as wire:
        if says:
            with pytest.raises(InstrumentError, match=says):
                optoncdt(model, wire)
        else:
            optoncdt(model, wire).close()
