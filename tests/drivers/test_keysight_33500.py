"""Keysight 33500 driver: peculiarities of the instrument, and the messages on the wire."""

import pytest

from drivers.errors import InstrumentError
from drivers.generators.keysight import Keysight33500
from drivers.transport.scpi import Link
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from tests.helpers.simulated_bench import assert_safe_voltage, simulated


class Tapped:
    """A link that keeps what went over it."""

    def __init__(self, link: Link) -> None:
        self._link, self.sent, self.name = link, [], link.name

    def write(self, message: str) -> None:
        self.sent.append(message)
        self._link.write(message)

    def read(self) -> str:
        return self._link.read()

    def read_bytes(self, count: int) -> bytes:
        return self._link.read_bytes(count)

    def clear(self) -> None:
        self._link.clear()

    def reopen(self) -> None:
        self._link.reopen()

    def close(self) -> None:
        self._link.close()


def driver() -> tuple[Keysight33500, SimulatedBench, Tapped]:
    bench = SimulatedBench(simulated().simulation_parameters, VirtualClock())
    link = Tapped(bench.link())
    return Keysight33500(link, bench.clock), bench, link


def test_the_load_is_declared_before_the_output_comes_up() -> None:
    source, bench, link = driver()
    source.initialize_at_rest(2.5, 0.0, 5.0)
    commands = [message.split(";")[0] for message in link.sent]
    assert commands.index("OUTP:LOAD INF") < commands.index("OUTP ON")
    assert bench.report().end_v == pytest.approx(2.5, abs=1e-3)  # 5.0 V in the 50-ohm trap


def test_the_range_is_frozen_so_that_no_relay_drops_the_output() -> None:
    source, bench, _ = driver()
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.enable_hv()
    from drivers.drive_shapes import Sine

    for amplitude in (0.05, 0.4, 1.2, 2.5, 0.1):  # crosses every attenuator range
        source.start_drive(Sine(100.0, amplitude, 2.5, 5))
        bench.clock.sleep(0.1)
        source.stop()
    assert_safe_voltage(bench.report())


def test_nothing_it_ever_sends_drops_the_output() -> None:
    from drivers.drive_shapes import Hold, Sine

    source, _, link = driver()
    source.initialize_at_rest(2.5, 0.0, 5.0)
    source.start_drive(Sine(100.0, 1.0, 2.5, 5))
    source.stop()
    source.ramp_to(3.0, 0.1)
    source.start_drive(Hold(3.0, 1.0))
    source.ramp_to(2.5, 0.1)
    source.reconnect()
    source.close()
    forbidden = ("*RST", "OUTP OFF", "OUTP 0", "APPL", "*RCL", "FUNC DC")
    assert not [m for m in link.sent if any(word in m.upper() for word in forbidden)]
    after = link.sent[[m.split(";")[0] for m in link.sent].index("OUTP ON") + 1 :]
    assert not [m for m in after if m.startswith(("FUNC ", "OUTP:LOAD ", "VOLT:RANG", "VOLT:LIM"))]


def test_every_setting_is_confirmed_in_its_own_message() -> None:
    source, _, link = driver()
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert all("?" in message for message in link.sent)


def test_a_setting_the_box_refuses_is_told_in_its_own_words() -> None:
    source, bench, _ = driver()
    source.initialize_at_rest(2.5, 0.0, 5.0)
    with pytest.raises(InstrumentError, match=r"33511B refused 'VOLT:OFFS 5.05.*': .*\(-22[12]\)"):
        source.ramp_to(7.0, 0.01)
    assert bench.report().end_v <= 5.01


def test_another_instrument_is_not_mistaken_for_this_one() -> None:
    class Meter:
        name = "TCPIP::192.0.2.1::5025::SOCKET"

        def write(self, message: str) -> None: ...

        def read(self) -> str:
            return "Keysight Technologies,34465A,MY1,1.0"

        def clear(self) -> None: ...

        def reopen(self) -> None: ...

        def close(self) -> None: ...

    with pytest.raises(InstrumentError, match="answered as 'Keysight Technologies 34465A #MY1'; this driver is for"):
        Keysight33500(Meter(), VirtualClock())
