"""Locks: of the instruments, over HiSLIP and VXI-11, where another program that holds one is named in a sentence; and of front panels."""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
import pyvisa

from app.config.bench_file import BenchConfig
from app.session.bench_connection import _open_wire, connect
from drivers.clock import WallClock
from drivers.errors import BenchError, LinkError
from drivers.transport.visa import PROGRAM_KEY, VisaLink
from drivers.watchdog.client import WatchdogClient
from drivers.watchdog.config import WatchdogConfig
from sim_hardware.bench import SimulatedBench
from tests.helpers.front_panel import asked, made
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import simulated
from tests.wires.hislip_server import HislipServer
from tests.wires.vxi11_server import Vxi11Server

pytestmark = pytest.mark.filterwarnings("ignore:unclosed <socket:ResourceWarning")

WIRES = [pytest.param(HislipServer, id="hislip"), pytest.param(Vxi11Server, id="vxi11")]


@contextlib.contextmanager
def served(kind: Any) -> Iterator[Any]:
    bench = SimulatedBench(simulated().simulation_parameters, WallClock(10.0))
    with kind(bench.message_port, 10.0, 0.0) as wire:
        yield wire


@contextlib.contextmanager
def held_by_another_program(wire: Any, key: str = "") -> Iterator[None]:
    """Hold the lock in a session of its own, as another program does."""
    manager = pyvisa.ResourceManager("@py")
    session: Any = manager.open_resource(wire.resource)
    try:
        if isinstance(wire, HislipServer):
            raw: Any = manager.visalib.sessions[session.session]  # type: ignore[attr-defined]
            assert raw.interface.async_lock_request(0.0, key) in ("success", "success shared")
        else:
            session.lock_excl(0)
        yield
    finally:
        session.close()


def opens(wire: Any, **options: Any) -> str:
    """Return the identity at the wire, over a link of its own."""
    link = VisaLink(wire.resource, **options)
    try:
        link.write("*IDN?")
        return link.read()
    finally:
        link.close()


@pytest.mark.parametrize("kind", WIRES)
def test_an_instrument_that_another_program_has_locked_is_refused_in_a_sentence(kind: Any) -> None:
    with served(kind) as wire:
        with held_by_another_program(wire):
            with pytest.raises(LinkError) as refused:
                opens(wire)
            sentence = str(refused.value)
            assert_names(sentence, wire.resource, "locked", "session")
            assert "\n" not in sentence
        until_s = time.monotonic() + 5
        while True:  # the server notices the end of a connection a little later
            try:
                assert "33511B" in opens(wire)
                break
            except LinkError:
                assert time.monotonic() < until_s


def test_a_lock_over_hislip_is_held_and_shared_with_the_watchdog_only() -> None:
    with served(HislipServer) as wire:
        link = VisaLink(wire.resource)
        with pytest.raises(LinkError):
            opens(wire, lock_key="another computer's program")
        with pytest.raises(AssertionError), held_by_another_program(wire):
            pass
        assert "33511B" in opens(wire, lock_key=PROGRAM_KEY)
        link.reopen()  # a lost connection does not lock its successor out
        link.write("*IDN?")
        assert "33511B" in link.read()
        link.close()


def test_a_lock_over_vxi11_is_given_back_lest_a_lost_connection_keeps_it() -> None:
    with served(Vxi11Server) as wire:
        link = VisaLink(wire.resource)
        assert wire.lock_owner is None
        assert "33511B" in opens(wire, lock_key="watchdog")
        link.close()


def test_a_lock_over_vxi11_is_held_where_nobody_else_of_the_program_connects() -> None:
    with served(Vxi11Server) as wire:
        link = VisaLink(wire.resource, holds_exclusive_lock=True)
        with pytest.raises(LinkError):
            opens(wire)
        link.write("*IDN?")
        assert "33511B" in link.read()
        link.close()
        assert "33511B" in opens(wire)


@pytest.mark.parametrize("own", [True, False])
def test_the_bench_holds_the_lock_if_its_watchdog_has_no_connection_of_its_own(own: bool) -> None:
    config = BenchConfig.model_validate({**simulated().model_dump(), "watchdog": {"own_connection": own}})
    with served(Vxi11Server) as wire:
        link = _open_wire(config, wire.resource, 2.0)
        assert (wire.lock_owner is not None) is not own
        link.close()
        assert wire.lock_owner is None


def test_an_instrument_without_locks_is_opened() -> None:
    with served(Vxi11Server) as wire:
        wire.knows_locks = False
        assert "33511B" in opens(wire)


@pytest.mark.deep
@pytest.mark.parametrize("key", [PROGRAM_KEY, "another"], ids=["of the program", "another"])
def test_a_watchdog_shares_the_lock_of_its_program(key: str) -> None:
    config = WatchdogConfig("drivers.generators.keysight:Keysight33500", "", 2.0, silence_s=60.0, lock_key=key)
    with served(HislipServer) as wire:
        link = VisaLink(wire.resource)
        watchdog = WatchdogClient(replace(config, resource=wire.resource))
        try:
            if key == PROGRAM_KEY:
                watchdog.arm()
            else:
                with pytest.raises(BenchError) as refused:
                    watchdog.arm()
                assert_names(str(refused.value), "locked")
        finally:
            watchdog.close()
            link.close()


LOCKED = {
    "33511B": ("SYST:COMM:RLST?", "REM", "LOC"),
    "DG1032Z": (":SYST:KLOC?", "ON", "OFF"),
    "DG812": (":SYST:KLOC? ALL", "1", "0"),
    "DG4162": (":SYST:KLOC?", "ON", "OFF"),
    "AFG3022C": ("SYST:KLOC:STAT?", "1", "0"),
}
"""By model: the query of the lock, its reply when locked and when not."""


def asking(model: str, *, lock: bool) -> BenchConfig:
    config = simulated(generator={"model": model})
    return BenchConfig.model_validate({**config.model_dump(), "generator": {"panel_lock": lock}})


@pytest.mark.parametrize("model", LOCKED)
def test_a_front_panel_is_locked_and_unlocked(model: str) -> None:
    query, locked, unlocked = LOCKED[model]
    source, _, panel = made(model)
    assert asked(panel, query) == unlocked
    assert source.lock_panel() == ""
    assert asked(panel, query) == locked
    source.unlock_panel()
    assert asked(panel, query) == unlocked


def test_a_generator_that_refuses_says_so_and_works_on() -> None:
    source, _, _ = made("AFG1022")
    assert "its front panel is not locked: function generator AFG1022" in source.lock_panel()
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)


@pytest.mark.deep
@pytest.mark.parametrize(
    ("model", "lock", "warning"),
    [
        ("33511B", True, ""),
        ("SDG1032X", True, "generator.panel_lock: this driver knows no command for it. Lock the front panel by hand"),
        ("SDG1032X", False, ""),
    ],
)
def test_the_bench_locks_the_panel_if_its_file_asks_for_it(model: str, lock: bool, warning: str) -> None:
    with connect(asking(model, lock=lock), None, 0.1) as connection:
        assert connection.bench.panel_warning.startswith(warning)
        assert bool(connection.bench.panel_warning) == bool(warning)
