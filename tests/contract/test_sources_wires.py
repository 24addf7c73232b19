"""Source contract over a serial line, HiSLIP, VXI-11 and USB-TMC, with the resynchronisation of each."""

import gc
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from drivers.clock import WallClock
from drivers.errors import InstrumentError, LinkError
from drivers.generators.keysight import Keysight33500
from drivers.supplies.dc_supply import DcSupply
from drivers.transport.scpi import ScpiSession
from drivers.transport.visa import VisaLink
from sim_hardware.bench import SimulatedBench
from sim_hardware.testing.source_contract import (  # noqa: F401 - pytest collects them here again, on this module's wires
    SourceUnderTest,
    energised,
    test_close_leaves_the_output_at_rest,
    test_drive_from_another_level_is_rejected_and_output_stays_at_rest,
    test_failed_link_raises_link_error_and_reconnects,
    test_initialize_at_rest_from_power_up_state,
    test_levels_are_reached_and_left_in_small_steps,
    test_rest_check_is_harmless_with_high_voltage_on,
    test_sine_starts_and_ends_at_rest_by_itself,
    test_small_and_large_drives_in_sequence_cause_no_jump,
    test_stop_ramps_a_sine_down_from_any_phase,
)
from tests.helpers.generators import BOXES, IMPATIENT_S, impatient_while_broken
from tests.helpers.simulated_bench import assert_safe_voltage, simulated
from tests.helpers.waiting import report_at_rest
from tests.wires.hislip_server import HislipServer
from tests.wires.scpi_pty import ScpiPty
from tests.wires.threaded_server import ThreadedServer
from tests.wires.usbtmc_bus import UsbTmcBus
from tests.wires.vxi11_server import Vxi11Server

# pyvisa-py's HiSLIP leaves the socket of a refused call open.
pytestmark = pytest.mark.filterwarnings("ignore:unclosed <socket:ResourceWarning")

SPEED = 10.0
TIMEOUT_S = 2.0
LATE_TIMEOUT_S, LATE_S = 1.0, 1.5
"""In tests of late answers: how long they are waited for, and when they come. A serial line is then read for as long again, and
half a second is what a busy computer may add.
"""
LINE = pytest.param(
    ScpiPty, id="serial", marks=pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
)
MESSAGES = [
    pytest.param(HislipServer, id="hislip"),
    pytest.param(Vxi11Server, id="vxi11"),
    pytest.param(UsbTmcBus, id="usbtmc"),
]
WIRES = [LINE, *MESSAGES]


@pytest.fixture(scope="module", autouse=True)
def only_what_these_tests_made_is_collected() -> None:
    gc.collect()
    gc.freeze()


@contextmanager
def wired(kind: type, impatient_s: float = IMPATIENT_S, **truth: object) -> Iterator[tuple[SimulatedBench, VisaLink]]:
    bench = SimulatedBench(simulated(**truth).simulation_parameters, WallClock(SPEED))
    with kind(bench.message_port, SPEED, bench.parameters.generator.command_s) as wire:
        if isinstance(wire, ThreadedServer):
            bench.add_fault_listener(wire.poke)
        link = VisaLink(wire.resource, TIMEOUT_S, baud=115_200)
        impatient_while_broken(link, bench, impatient_s)
        yield bench, link
        link.close()
    if kind is HislipServer:  # unclosed sockets are reported by garbage collection here and not in another test
        gc.collect()


@pytest.fixture(params=WIRES)
def device_under_test(request: pytest.FixtureRequest) -> Iterator[SourceUnderTest]:
    with wired(request.param) as (bench, link):
        source = Keysight33500(link, bench.clock)
        yield source, bench, bench.clock
        source.close()


@pytest.mark.deep
@pytest.mark.parametrize("kind", WIRES)
def test_an_answer_that_comes_too_late_is_not_taken_for_the_next_one(
    kind: type, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim_hardware.wires.port.LATE_RESPONSE_S", LATE_S)
    with wired(kind, LATE_TIMEOUT_S) as (bench, link):
        scpi = ScpiSession(link, "generator")
        bench.inject("scpi-late")
        with pytest.raises(LinkError, match=r"no answer to 'VOLT:OFFS\?'.* was silent for 1 s"):
            scpi.query("VOLT:OFFS?")
        bench.clear()
        time.sleep(LATE_TIMEOUT_S)  # by now it has come
        assert scpi.query("*IDN?").startswith("Keysight")
        assert scpi.query("OUTP?") == "0"


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_an_answer_later_than_a_serial_line_is_read_is_not_taken_for_the_next_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """However late it is: the instrument sends its identity after it."""
    held, send = threading.Event(), ScpiPty.unsolicited_output
    monkeypatch.setattr(ScpiPty, "unsolicited_output", lambda wire: b"" if held.is_set() else send(wire))
    with wired(ScpiPty) as (_, link):
        scpi = ScpiSession(link, "generator")
        scpi.identify()
        held.set()
        link.timeout_s, link._session.timeout = 0.1, 100
        for query in ("VOLT:OFFS?", "FREQ?"):
            with pytest.raises(LinkError, match="no answer to"):
                scpi.query(query)
        link.timeout_s, link._session.timeout = TIMEOUT_S, 1000 * TIMEOUT_S
        held.clear()
        assert scpi.query("OUTP?") == "0"
        assert scpi.query("*IDN?").startswith("Keysight")


@pytest.mark.parametrize("kind", WIRES)
def test_half_an_answer_is_forgotten(kind: type) -> None:
    with wired(kind) as (bench, link):
        scpi = ScpiSession(link, "generator")
        bench.inject("scpi-half")
        with pytest.raises(LinkError):
            scpi.query("*IDN?")
        bench.clear()
        assert scpi.query("OUTP?") == "0"


@pytest.mark.deep
def test_a_late_answer_that_is_in_a_hislip_line_already_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """pyvisa-py takes it for the acknowledgement of its device clear, and stumbles; the session is then opened anew."""
    monkeypatch.setattr("sim_hardware.wires.port.LATE_RESPONSE_S", LATE_S)
    with wired(HislipServer, LATE_TIMEOUT_S) as (bench, link):
        bench.inject("scpi-late")
        link.write("VOLT:OFFS?")
        with pytest.raises(LinkError):
            link.read()
        bench.clear()
        time.sleep(LATE_TIMEOUT_S)  # it arrives
        link.clear()
        link.write("OUTP?")
        assert link.read() == "0"


@pytest.mark.deep
@pytest.mark.parametrize("kind", MESSAGES)
def test_a_box_that_closes_its_session_is_a_sentence_and_comes_back(kind: type) -> None:
    with wired(kind) as (bench, link):
        bench.inject("scpi-dropped")
        with pytest.raises(LinkError, match=r"cannot be reached|hislip0|inst0|USB0"):
            ScpiSession(link, "generator").query("OUTP?")
        with pytest.raises(LinkError):
            link.reopen()
        bench.clear()
        link.reopen()
        link.write("OUTP?")
        assert link.read() == "0"


def test_noise_on_a_serial_line_does_not_last_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wrong baud rate gives bytes without end."""
    monkeypatch.setattr("drivers.transport.visa.MAX_DRAIN_S", 0.2)

    class Chatters:
        def __init__(self) -> None:
            self.timeout = 0.0

        def read_bytes(self, _: int) -> bytes:
            return b"?"

        def close(self) -> None: ...

    with wired(ScpiPty) as (_, link):
        real, link._session = link._session, Chatters()
        link.clear()
        link._session = real


@pytest.mark.parametrize("kind", WIRES)
def test_a_supply_holds_and_rests_over_it(kind: type) -> None:
    with wired(kind, source="supply", supply={"model": "E3631A"}) as (bench, link):
        source = DcSupply(link, bench.clock)
        source.initialize_at_rest(2.5, 0.0, 5.0)
        bench.enable_hv()
        source.ramp_to(3.5, 0.3)
        source.stop()
        source.ramp_to(2.5, 0.3)
        assert source.is_at_rest(2.5, 0.0, 5.0)
        bench.clock.sleep(0.5)
        assert_safe_voltage(report_at_rest(bench.report))


@pytest.mark.deep
@pytest.mark.parametrize("taken", ["first", "last", "none"])
@pytest.mark.parametrize("model", ["33511B", "33220A", "DG1032Z", "DG2072", "AFG3022C"])
def test_an_instrument_that_loses_transfers_of_a_waveform_over_usb_is_not_armed(model: str, taken: str) -> None:
    bench = SimulatedBench(simulated(generator={"model": model}).simulation_parameters, WallClock(SPEED))
    with UsbTmcBus(bench.message_port, SPEED, 0.0, taken) as bus:  # type: ignore[arg-type]
        link = VisaLink(bus.resource, 0.2)
        source = BOXES[model if model in BOXES else "DG812"](link, bench.clock)
        with pytest.raises(InstrumentError):
            source.initialize_at_rest(2.5, 0.0, 5.0)
        link.close()
    assert not bench.generator.settings.on
    assert bench.report().live_s == 0
