"""Simulated generator on a socket, accessed by real pyvisa."""

import contextlib
import socket
import time
from types import SimpleNamespace

import pytest

from drivers.clock import SharedTime, WallClock
from drivers.drive_shapes import Sine
from drivers.errors import InstrumentError, LinkError
from drivers.generators.keysight import Keysight33500
from drivers.transport.visa import VisaLink
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.parameters import SimulationParameters
from sim_hardware.wires.tcp_server import ScpiTcpServer
from tests.helpers.generators import impatient_while_broken


@pytest.fixture
def bench():
    return SimulatedBench(SimulationParameters(speed=20.0))


@pytest.fixture
def server(bench):
    with ScpiTcpServer(bench.message_port, bench.parameters.speed) as server:
        bench.add_fault_listener(server.update_from_faults)
        yield server


@pytest.fixture
def link(bench, server):
    with contextlib.closing(VisaLink(server.resource, timeout_s=10.0)) as link:
        impatient_while_broken(link, bench, 0.25)
        yield link


def ask(link: VisaLink, query: str) -> str:
    link.write(query)
    return link.read()


def test_the_real_driver_plays_over_a_real_socket(bench, link):
    source = Keysight33500(link, WallClock(20.0))
    source.initialize_at_rest(2.5, 0.0, 5.0)
    time.sleep(0.02)  # the relays of the preparation settle: 0.4 bench seconds
    bench.enable_hv()
    source.start_drive(Sine(100.0, 2.5, 2.5, 100))
    bench.clock.sleep(1.5)
    source.stop()
    assert source.is_at_rest(2.5, 0.0, 5.0)
    report = bench.report()
    assert report.ends_at_rest
    assert report.switched_at_rest
    assert report.highest_v == pytest.approx(5.0, abs=1e-3)
    assert report.largest_jump_v < 0.06


def test_no_message_waits_until_the_one_before_is_acknowledged(server, link):
    """It would be 44 ms for every answer to two messages."""
    assert ask(link, "VOLT 1;:SYST:ERR?")
    ours = link._manager.visalib.sessions[link._session.session].interface
    (theirs,) = server._partial_lines
    for end in (ours, theirs):
        assert end.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_one_connection_after_the_other(server):
    for _ in range(5):
        with contextlib.closing(VisaLink(server.resource, timeout_s=10.0)) as link:
            assert ask(link, "*IDN?").startswith("Keysight")


def test_lines_may_come_in_pieces_and_several_at_once(server):
    with socket.create_connection(("127.0.0.1", server.port), timeout=60.0) as sock:
        sock.sendall(b"FRE")
        time.sleep(0.02)
        sock.sendall(b"Q 50\nFREQ?\n*ID")
        sock.sendall(b"N?\n")
        with sock.makefile() as lines:
            assert float(lines.readline()) == 50.0
            assert lines.readline().startswith("Keysight")


@pytest.mark.parametrize(
    "fault", ["scpi-silent", "scpi-late", "scpi-half", "scpi-garbled", "scpi-previous", "scpi-dropped"]
)
def test_faults_reach_the_driver_as_its_own_errors_and_mend(bench, link, fault):
    source = Keysight33500(link, WallClock(20.0))
    bench.inject(fault)
    with pytest.raises(InstrumentError):
        source.idle_level_v()
    bench.clear(fault)
    source.reconnect()
    assert source.idle_level_v() == 0.0


def test_a_dropped_connection_is_refused_until_it_is_mended_on_the_same_port(bench, server, link):
    bench.inject("scpi-dropped")
    with pytest.raises(LinkError):
        ask(link, "*IDN?")
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        try:
            socket.create_connection(("127.0.0.1", server.port), timeout=60.0).close()
        except ConnectionRefusedError:
            break
        time.sleep(0.02)
    else:
        pytest.fail("the port still takes calls")
    bench.clear("scpi-dropped")
    time.sleep(0.02)
    link.reopen()
    assert ask(link, "*IDN?").startswith("Keysight")


def test_closing_drops_the_callers(bench):
    server = ScpiTcpServer(bench.message_port)
    with socket.create_connection(("127.0.0.1", server.port), timeout=60.0) as sock:
        sock.sendall(b"*IDN?\n")
        assert sock.recv(100)
        server.close()
        assert sock.recv(100) == b""


def test_two_messages_of_a_held_up_bench_are_two_steps(tmp_path, monkeypatch):
    """The computer stops the bench in the middle of a message, and bench time has come to a late reader meanwhile."""
    real_s = [1000.0]

    def pass_(seconds: float) -> None:
        real_s[0] += seconds

    monkeypatch.setattr("drivers.clock.time", SimpleNamespace(monotonic=lambda: real_s[0], sleep=pass_))
    parameters = SimulationParameters(speed=5.0)
    clock = WallClock(5.0, SharedTime(tmp_path / "time", 5.0, new=True))
    bench = SimulatedBench(parameters, clock)
    for message in ("OUTP:LOAD INF", "VOLT 0.002", "FUNC DC", "VOLT:OFFS 2.5", "OUTP ON"):
        bench.message_port.handle(message)
    pass_(1.0)
    bench.enable_hv()
    handle = bench.message_port.handle

    def held_up(message: str):
        if message == "VOLT:OFFS 2.55":
            clock.shared.wait_at(clock.now() + 0.1)
            pass_(0.05)
        return handle(message)

    monkeypatch.setattr(bench.message_port, "handle", held_up)
    server = ScpiTcpServer(bench.message_port, parameters.speed, parameters.generator.command_s, clock)
    with server, socket.create_connection(("127.0.0.1", server.port), 10.0) as wire:
        wire.sendall(b"VOLT:OFFS 2.55\nVOLT:OFFS 2.6\nVOLT:OFFS?\n")
        assert float(wire.recv(100)) == pytest.approx(2.6)
    first, second = [entry.start_s for entry in bench.history.entries()[-2:]]
    assert second - first >= parameters.generator.command_s * (1 - 1e-9)
    assert bench.report().largest_jump_v == pytest.approx(0.05)
