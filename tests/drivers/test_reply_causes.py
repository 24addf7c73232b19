"""Replies that cannot be read, and slow ones: each has its own remedy, and Stop ends at rest."""

import re
from collections.abc import Callable

import pytest

from drivers.drive_shapes import Sine
from drivers.errors import InstrumentError, LinkError
from drivers.generators.burst import BurstGenerator
from drivers.generators.keysight import Keysight33200, Keysight33500
from drivers.generators.rigol import RigolDg
from drivers.generators.siglent import SiglentSdg
from drivers.transport.errors import silence_remedy
from drivers.transport.scpi import Link
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from tests.drivers.test_keysight_33500 import Tapped
from tests.helpers.front_panel import press
from tests.helpers.generators import truth
from tests.helpers.simulated_bench import assert_safe_voltage

ARMED = 2.5, 0.0, 5.0


class Altered(Tapped):
    """A link whose replies are changed on the way, by the message that they answer."""

    def __init__(self, link: Link, alter: Callable[[str, str], str], name: str = "") -> None:
        super().__init__(link)
        self.name = name or link.name
        self.alter = alter

    def read(self) -> str:
        return self.alter(self.sent[-1], super().read())


def comma(_: str, reply: str) -> str:
    return re.sub(r"(?<=\d)\.(?=\d)", ",", reply)


CASES: list[tuple[type[BurstGenerator], str, Callable[[str, str], str], str, str]] = [
    (Keysight33500, "33511B", comma, "", "decimal comma; set its number format"),
    (Keysight33500, "33511B", lambda message, reply: message if "VOLT?" in message else reply, "", "switch its echo off"),
    (Keysight33500, "33511B", lambda _, reply: f"{reply}\r\n33511B>", "", "port for typing"),
    (Keysight33500, "33511B", lambda _, reply: reply.replace(",", " "), "TCPIP::192.0.2.1::5024::SOCKET", "use the port for programs, 5025"),
    (Keysight33500, "33511B", lambda m, reply: f"VOLT {reply}" if m == "VOLT?" else reply, "", "switch response headers off"),
    (SiglentSdg, "SDG1032X", comma, "", "with decimal commas"),
]  # fmt: skip


@pytest.mark.parametrize(("driver", "model", "alter", "name", "words"), CASES)
def test_a_reply_that_cannot_be_read_names_its_cause(
    driver: type[BurstGenerator], model: str, alter: Callable[[str, str], str], name: str, words: str
) -> None:
    bench = SimulatedBench(truth(model), VirtualClock())
    with pytest.raises(InstrumentError) as refused:
        driver(Altered(bench.link(), alter, name), bench.clock).initialize_at_rest(*ARMED)
    assert words in str(refused.value)


def test_a_silent_rigol_on_lan_may_be_connected_by_usb_and_port_5024_is_for_typing() -> None:
    assert "unplug it" in silence_remedy("TCPIP::192.0.2.1::5555::SOCKET")
    assert "5025" in silence_remedy("TCPIP::192.0.2.1::5024::SOCKET")
    assert "5025" not in silence_remedy("TCPIP::192.0.2.1::5025::SOCKET")


@pytest.mark.parametrize("headers", ["LONG", "OFF"])
def test_response_headers_of_another_user_are_shortened(headers: str) -> None:
    bench = SimulatedBench(truth("SDG1032X"), VirtualClock())
    press(bench.link(), f"CHDR {headers}")
    source = SiglentSdg(bench.link(), bench.clock)
    source.initialize_at_rest(*ARMED)
    assert source.is_at_rest(*ARMED)


class SlowInstrument(Tapped):
    """An instrument that takes its time for each command of each message, one after the other, and answers in turn."""

    def __init__(self, link: Link, clock: VirtualClock, seconds: float) -> None:
        super().__init__(link)
        self.name = "TCPIP::192.0.2.1::5025::SOCKET"  # steps are not joined to one message there
        self._clock, self._seconds, self._free_s = clock, seconds, 0.0
        self.timeout_s = 2.0

    def write(self, message: str) -> None:
        self._free_s = max(self._free_s, self._clock.now()) + self._seconds
        super().write(message)

    def read(self) -> str:
        wait_s = self._free_s - self._clock.now()
        self._clock.sleep(min(wait_s, self.timeout_s))
        if wait_s > self.timeout_s:
            raise LinkError(f"{self.name} was silent for {self.timeout_s:g} s")
        return super().read()


@pytest.mark.parametrize("seconds", [0.03, 0.06, 0.1])
@pytest.mark.parametrize(
    ("driver", "model"), [(Keysight33500, "33511B"), (Keysight33200, "33220A"), (RigolDg, "DG1032Z")]
)
def test_stop_on_a_slow_instrument_ends_at_rest_without_an_error(
    driver: type[BurstGenerator], model: str, seconds: float
) -> None:
    bench = SimulatedBench(truth(model), VirtualClock())
    link = SlowInstrument(bench.link(), bench.clock, seconds)
    source = driver(link, bench.clock)
    source.initialize_at_rest(*ARMED)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.start_drive(Sine(50.0, 2.5, 2.5, 2000))
    bench.clock.sleep(0.5)
    source.stop()
    assert source.is_at_rest(*ARMED)
    bench.clock.sleep(0.1)
    assert_safe_voltage(bench.report())
    assert bench.report().ends_at_rest
