"""Meter contract: a value in metres, or a reading that is marked as invalid."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from drivers.clock import Clock
from drivers.errors import BenchError, InstrumentError, LinkError
from drivers.interfaces import Meter, Reading
from drivers.sensors.block_meter import BlockMeter
from drivers.sensors.meter_dialects import BLOCK_DIALECTS, METER_EVIDENCE, TEXT_DIALECTS
from drivers.sensors.optoncdt import OptoNcdt
from drivers.sensors.text_meter import TextMeter
from drivers.transport.serial_port import SerialPort
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.sensors.laser_sensors import (
    SimulatedKeyenceIl,
    SimulatedKeyenceLkg,
    SimulatedKeyenceLkg5000,
    SimulatedOptoNcdt,
    simulated_keyence,
)
from sim_hardware.sensors.network_sensors import SimulatedMicroEpsilon
from sim_hardware.wires.pty import PtyServer
from sim_hardware.wires.tcp_stream import TcpStreamServer
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import simulated

Made = tuple[Meter, SimulatedBench, PtyServer | TcpStreamServer]
TIMEOUT_S, SILENCE_S, RANGE_M = 30.0, 0.4, 10e-3
"""A busy computer answers late; only where silence is expected is it waited for shortly."""


@pytest.fixture(autouse=True)
def ports_close_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """pyserial waits for 0.3 s after it has closed a connection."""
    monkeypatch.setattr("serial.urlhandler.protocol_socket.time", SimpleNamespace(sleep=lambda _: None))


def impatient(port: SerialPort, seconds: float = SILENCE_S) -> SerialPort:
    port.timeout_s = port._port.timeout = seconds
    return port


def text_meter(driver: str, port: str, clock: Clock | None = None, output: int = 1) -> TextMeter:
    dialect = TEXT_DIALECTS[driver]
    return TextMeter(SerialPort(port, dialect.baud, TIMEOUT_S), clock or VirtualClock(), dialect, output=output)


def block_meter(
    driver: str, data: str, commands: str, clock: Clock | None = None, range_m: float = RANGE_M, channel: int = 1
) -> BlockMeter:
    ports = (SerialPort(port, 9600, TIMEOUT_S) for port in (data, commands))
    return BlockMeter(*ports, clock or VirtualClock(0.1), BLOCK_DIALECTS[driver], range_m=range_m, channel=channel)


@contextmanager
def keyence_on_a_pty(driver: str) -> Iterator[Made]:
    bench = SimulatedBench(simulated().simulation_parameters, VirtualClock(0.1))
    with PtyServer(simulated_keyence(driver, bench.laser_reading_m)) as wire:
        meter = text_meter(driver, wire.port, bench.clock)
        yield meter, bench, wire
        meter.close()


@contextmanager
def micro_epsilon_on_tcp(driver: str) -> Iterator[Made]:
    bench = SimulatedBench(simulated().simulation_parameters, VirtualClock(0.1))
    sensor = SimulatedMicroEpsilon(bench.laser_reading_m, RANGE_M, driver, channels=(1, 3))
    with TcpStreamServer(sensor) as wire, TcpStreamServer(sensor.commands) as commands:
        meter = block_meter(driver, wire.port, commands.port, bench.clock, channel=1 if sensor.is_laser else 3)
        yield Middle(meter), bench, wire
        meter.close()


@contextmanager
def optoncdt_on_a_pty() -> Iterator[Made]:
    bench = SimulatedBench(simulated().simulation_parameters, VirtualClock(0.1))
    with PtyServer(SimulatedOptoNcdt(bench.laser_reading_m)) as wire:
        meter = OptoNcdt(SerialPort(wire.port, 921600, TIMEOUT_S), bench.clock, range_m=10e-3)
        yield Middle(meter), bench, wire
        meter.close()


class Middle:
    """Micro-Epsilon's sensors count from the near end of their range; the others, and this suite, from the middle."""

    def __init__(self, meter: OptoNcdt | BlockMeter) -> None:
        self._meter = meter
        self.identity = meter.identity
        self.close = meter.close

    def read(self) -> Reading:
        reading = self._meter.read()
        return replace(reading, value=reading.value - 5e-3)


MAKERS: dict[str, Callable[[], AbstractContextManager[Made]]] = {
    **{driver: partial(keyence_on_a_pty, driver) for driver in TEXT_DIALECTS},
    "optoncdt": optoncdt_on_a_pty,
    **{driver: partial(micro_epsilon_on_tcp, driver) for driver in BLOCK_DIALECTS},
}


@pytest.fixture(
    params=["keyence-lkg", "optoncdt", *(name for name in (*TEXT_DIALECTS, *BLOCK_DIALECTS) if name != "keyence-lkg")]
)
def made(request: pytest.FixtureRequest) -> Iterator[Made]:
    with MAKERS[request.param]() as made:
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


def resolution_m(meter: Meter) -> float:
    """Return the resolution of three bytes and of four decimals; an IL has three."""
    return 6e-7 if meter.identity.model == "IL" else 2e-7


def test_it_says_who_it_is(made: Made) -> None:
    assert made[0].identity.maker
    assert made[0].identity.model


def test_a_reading_is_the_displacement_in_metres(made: Made) -> None:
    meter, bench, _ = made
    truth = deflect(bench, 3.0)
    reading = meter.read()
    assert reading.valid
    assert reading.unit == "m"
    assert reading.value == pytest.approx(truth, abs=resolution_m(meter))
    assert reading.time_s == pytest.approx(bench.clock.now(), abs=0.1)


def test_a_reading_is_of_now_and_not_of_what_waited_in_the_buffer(made: Made) -> None:
    meter, bench, _ = made
    before = meter.read().value
    truth = deflect(bench, 4.0)
    assert meter.read().value == pytest.approx(truth, abs=resolution_m(meter))
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
    port = getattr(meter, "_meter", meter)._port  # type: ignore[attr-defined]
    wire.unresponsive = True
    impatient(port)
    with pytest.raises(LinkError, match=r"\b0\.4 s\b.*check"):
        deque((meter.read() for _ in range(3)), maxlen=0)  # what was on its way may still arrive
    wire.unresponsive = False
    impatient(port, TIMEOUT_S)
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
        line = impatient(SerialPort(wire.port, 9600, TIMEOUT_S))
        with pytest.raises(BenchError, match=rf"^{wire.port} .*\b{SILENCE_S:g} s\b"):
            TextMeter(line, VirtualClock(), TEXT_DIALECTS["keyence-lkg"])


def test_an_optoncdt_that_is_an_lkg_is_a_sentence() -> None:
    with PtyServer(SimulatedKeyenceLkg(lambda: 0.0)) as wire:
        line = impatient(SerialPort(wire.port, 9600, TIMEOUT_S))
        with pytest.raises(BenchError, match=rf"^{wire.port} .*\b{SILENCE_S:g} s\b"):
            OptoNcdt(line, VirtualClock(), range_m=10e-3)


def test_an_lkg_in_its_setting_screen_says_so() -> None:
    controller = SimulatedKeyenceLkg(lambda: 0.0)
    with PtyServer(controller) as wire:
        meter = text_meter("keyence-lkg", wire.port)
        controller.in_setting_mode = True
        with pytest.raises(InstrumentError, match="bring it from its setting screen back to measuring"):
            meter.read()
        meter.close()


def test_an_output_that_does_not_measure_is_not_valid() -> None:
    with PtyServer(SimulatedKeyenceLkg(lambda: 1e-3)) as wire:
        meter = text_meter("keyence-lkg", wire.port, output=2)
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
    model._respond = lambda line: f"{line}\r\n{reply}\r\n->" if "MASTER" in line else obey(line)  # type: ignore[method-assign]
    with PtyServer(model) as wire:
        if says:
            with pytest.raises(InstrumentError, match=says):
                optoncdt(model, wire)
        else:
            optoncdt(model, wire).close()


@pytest.mark.parametrize(
    ("number", "reply", "says"),
    [("033", "00004", "reports an error"), ("050", "1", "laser is stopped"), ("051", "1", "prohibited combination")],
)
def test_an_il_that_does_not_measure_is_refused_when_it_is_opened(number: str, reply: str, says: str) -> None:
    amplifier = SimulatedKeyenceIl(lambda: 1e-3)
    amplifier.data[number] = reply
    with PtyServer(amplifier) as wire, pytest.raises(InstrumentError, match=f"{says}.*{reply}"):
        text_meter("keyence-il", wire.port)


def test_an_il_amplifier_that_is_not_there_is_a_sentence() -> None:
    with (
        PtyServer(SimulatedKeyenceIl(lambda: 1e-3)) as wire,
        pytest.raises(InstrumentError, match=r"\b22\b"),
    ):
        text_meter("keyence-il", wire.port, output=2)


@pytest.mark.parametrize("driver", list(BLOCK_DIALECTS))
def test_the_range_of_a_network_sensor_is_asked(driver: str) -> None:
    sensor = SimulatedMicroEpsilon(lambda: 0.0, RANGE_M, driver)
    with TcpStreamServer(sensor) as data, TcpStreamServer(sensor.commands) as commands:
        with pytest.raises(InstrumentError, match=r"range of 10 mm, the bench file says 2 mm"):
            block_meter(driver, data.port, commands.port, range_m=2e-3)
        meter = block_meter(driver, data.port, commands.port)
        assert meter.identity.serial == "10110002"
        meter.close()


@pytest.mark.parametrize(("kind", "values", "waits"), [("0", 8, False), ("1", 8, True), ("3", 5, True)])
def test_a_reading_of_a_capancdt_begins_its_average_anew(kind: str, values: int, waits: bool) -> None:
    """Its value is of the displacement after the call, however many values it averages."""
    place = [0.0]
    sensor = SimulatedMicroEpsilon(lambda: place[0], RANGE_M, "capancdt-6200")
    sensor.average_kind, sensor.averaged_values = kind, values
    with TcpStreamServer(sensor) as data, TcpStreamServer(sensor.commands) as commands:
        meter = block_meter("capancdt-6200", data.port, commands.port)
        assert (meter.averaged_values > 1) is waits
        place[0] = 1e-3
        assert meter.read().value == pytest.approx(6e-3, abs=2e-9)
        meter.close()


def test_a_filter_of_unknown_delay_is_refused() -> None:
    sensor = SimulatedMicroEpsilon(lambda: 0.0, RANGE_M, "capancdt-6200")
    sensor.average_kind = "4"
    with TcpStreamServer(sensor) as data, TcpStreamServer(sensor.commands) as commands:
        with pytest.raises(InstrumentError) as refused:
            block_meter("capancdt-6200", data.port, commands.port)
        assert_names(str(refused.value), "6200", "4", "moving")


@pytest.mark.parametrize(
    ("cycle", "filter_", "averaging_s"),
    [("0", "0,0", 2.55e-6), ("5", "0,6", 0.4096), ("8", "0,9", None), ("5", "2,1", None)],
)
def test_a_reading_of_an_lkg5000_waits_for_its_average(cycle: str, filter_: str, averaging_s: float | None) -> None:
    clock, controller = VirtualClock(), SimulatedKeyenceLkg5000(lambda: 1e-3)
    controller.settings |= {"SR,CA": cycle, "SR,OC,01": filter_}
    with PtyServer(controller) as wire:
        if averaging_s is None:
            with pytest.raises(InstrumentError) as refused:
                text_meter("keyence-lkg5000", wire.port, clock)
            assert_names(str(refused.value), "LK-G5000", cycle, "average")
        else:
            meter, begin_s = text_meter("keyence-lkg5000", wire.port, clock), clock.now()
            assert meter.read().time_s - begin_s >= averaging_s
            meter.close()
    assert not controller.in_setting_mode


def test_settings_of_another_user_of_an_optoncdt_2300_are_taken_back() -> None:
    sensor = SimulatedMicroEpsilon(lambda: 1e-3, RANGE_M, "optoncdt-2300")
    sensor.average_kind = "RECURSIVE"
    with TcpStreamServer(sensor) as data, TcpStreamServer(sensor.commands) as commands:
        meter = block_meter("optoncdt-2300", data.port, commands.port)
        assert not sensor.mastered
        assert not sensor.additional_values
        assert sensor.average_kind == "0"
        assert meter.read().value == pytest.approx(6e-3, abs=2e-9)
        meter.close()


def test_a_channel_that_a_capancdt_does_not_send_is_a_sentence() -> None:
    sensor = SimulatedMicroEpsilon(lambda: 0.0, RANGE_M, "capancdt-6200", channels=(1, 2))
    obey = sensor.commands._respond
    sensor.commands._respond = lambda line: obey(line.replace("$CHI3", "$CHI1"))  # type: ignore[method-assign]
    with (
        TcpStreamServer(sensor) as data,
        TcpStreamServer(sensor.commands) as commands,
        pytest.raises(LinkError, match=r"\b3\b"),
    ):
        block_meter("capancdt-6200", data.port, commands.port, channel=3)


def test_every_property_of_a_dialect_has_a_quoted_source_or_is_listed_as_unproven() -> None:
    sources = METER_EVIDENCE["sources"]
    for name in (*TEXT_DIALECTS, *BLOCK_DIALECTS):
        row = METER_EVIDENCE[name]
        assert row["unproven"], name
        for source, place, line in row["quotes"]:
            assert sources[source], name
            assert place, name
            assert len(line) > 10, name
