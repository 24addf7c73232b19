"""What every source must do, on its real wire and without one. The judge is the volts that reached the amplifier."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from drivers.clock import Clock, WallClock
from drivers.drive import Hold, Ramp, Sine
from drivers.errors import InstrumentError, LinkError
from drivers.keysight_33500 import Keysight33500
from drivers.ports import Source
from drivers.visa import VisaLink
from sim_hardware.bench import VirtualBench
from sim_hardware.clock import VirtualClock
from sim_hardware.served import ServedBench
from tests.support import simulated, volts_are_safe

Made = tuple[Source, VirtualBench, Clock]


@contextmanager
def keysight_direct() -> Iterator[Made]:
    bench = VirtualBench(simulated().truth, VirtualClock())
    source = Keysight33500(bench.link(), bench.clock)
    yield source, bench, bench.clock
    source.close()


@contextmanager
def keysight_on_a_socket() -> Iterator[Made]:
    bench = VirtualBench(simulated().truth, WallClock(5.0))
    with ServedBench(bench) as served:
        link = VisaLink(f"TCPIP::127.0.0.1::{served.scpi.port}::SOCKET", timeout_s=0.5)
        source = Keysight33500(link, bench.clock)
        yield source, bench, bench.clock
        source.close()


@pytest.fixture(params=[keysight_direct, keysight_on_a_socket], ids=lambda make: make.__name__)
def made(request: pytest.FixtureRequest) -> Iterator[Made]:
    with request.param() as made:
        yield made


def live(made: Made) -> Made:
    """Prepared with high voltage off, then switched on at rest."""
    source, bench, _ = made
    source.prepare(2.5, 0.0, 5.0)
    bench.enable_hv()
    return made


def test_a_fresh_box_is_not_at_rest_and_is_brought_there(made: Made) -> None:
    source, bench, _ = made
    assert not source.at_rest(2.5)
    source.prepare(2.5, 0.0, 5.0)
    assert source.at_rest(2.5)
    assert source.idle_v() == pytest.approx(2.5, abs=1e-3)
    assert bench.report().end_v == pytest.approx(2.5, abs=1e-3)


def test_preparing_twice_is_harmless_even_live(made: Made) -> None:
    source, bench, _ = live(made)
    assert source.at_rest(2.5)
    volts_are_safe(bench.report())


def test_a_sine_starts_at_rest_with_known_phase_and_ends_there_by_itself(made: Made) -> None:
    source, bench, clock = live(made)
    begin = clock.now()
    source.play(Sine(50.0, 2.5, 2.5, 20))
    clock.sleep(20 / 50.0 + 0.2)
    report = bench.report()
    volts_are_safe(report)
    assert report.outside_rest_s == pytest.approx(0.4, rel=0.05)
    assert report.highest_v == pytest.approx(5.0, abs=1e-3)
    assert report.lowest_v == pytest.approx(0.0, abs=1e-3)
    assert clock.now() > begin


def test_a_sine_is_stopped_gently_from_any_phase(made: Made) -> None:
    source, bench, clock = live(made)
    for k in range(7):
        source.play(Sine(40.0, 2.5, 2.5, 1000))
        clock.sleep(0.1 + 0.0037 * k)
        source.stop()
        assert source.at_rest(2.5)
        clock.sleep(0.05)
    volts_are_safe(bench.report())


def test_levels_are_reached_in_small_steps_and_left_the_same_way(made: Made) -> None:
    source, bench, clock = live(made)
    for level in (5.0, 0.0, 2.5):
        source.move(level, 0.2)
        assert source.idle_v() == pytest.approx(level, abs=1e-3)
        source.play(Hold(level, 0.1))
        clock.sleep(0.05)
    report = bench.report()
    volts_are_safe(report)
    assert report.highest_v == pytest.approx(5.0, abs=0.006)
    assert report.lowest_v == pytest.approx(0.0, abs=0.006)


def test_a_ramp_is_played(made: Made) -> None:
    source, bench, clock = live(made)
    source.play(Ramp(2.5, 3.0, 0.1))
    clock.sleep(0.02)
    assert bench.report().end_v == pytest.approx(3.0, abs=1e-3)
    source.move(2.5, 0.1)
    clock.sleep(0.02)
    volts_are_safe(bench.report())


def test_a_drive_that_begins_elsewhere_is_refused_and_nothing_moves(made: Made) -> None:
    source, bench, clock = live(made)
    with pytest.raises(InstrumentError, match="nothing was sent"):
        source.play(Sine(50.0, 1.0, 3.0, 5))
    clock.sleep(0.1)
    assert bench.report().outside_rest_s == 0


@pytest.mark.parametrize("fault", ["scpi-silent", "scpi-late", "scpi-garbled", "scpi-half", "scpi-dropped"])
def test_a_failed_wire_is_a_sentence_and_can_be_opened_anew(fault: str, made: Made) -> None:
    source, bench, clock = live(made)
    bench.inject(fault)
    with pytest.raises(LinkError, match=r"function generator 33511B: |which is no"):
        source.idle_v()
    bench.clear(fault)
    clock.sleep(1.0)
    source.reconnect()
    assert source.at_rest(2.5)
    volts_are_safe(bench.report())


def test_letting_go_leaves_the_output_at_rest(made: Made) -> None:
    source, bench, clock = live(made)
    source.close()
    clock.sleep(0.2)
    report = bench.report()
    volts_are_safe(report)
    assert report.outside_rest_s == 0
