"""Slow and cut wires: the way to rest is pipelined, never jumps, is predicted at arming and refused where it is too long."""

import math
import re
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from app.session.bench_connection import connect
from drivers.bench.drive_limits import DriveLimits, HvAmplifier
from drivers.clock import Clock, WallClock
from drivers.drive_shapes import Drive, Hold, Sine
from drivers.errors import InstrumentError, LinkError
from drivers.generators.keysight import Keysight33500
from drivers.transport.safe_ramp_down import FIRST_STEPS, RampDown
from drivers.transport.scpi import ScpiSession, join_commands
from drivers.transport.visa import VisaLink
from model.amplifier_map import AmplifierMap
from protocols.base import BenchArmed, EventBus, RunStatus
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.helpers.level_protocol import Levels
from tests.helpers.simulated_bench import laboratory, simulated
from tests.helpers.wired_bench import wired

STEP_V = 0.05


class Wire:
    """Notes what is sent."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.sent: list[str] = []

    def write(self, message: str) -> None:
        self.sent.append(message)

    def read(self) -> str:
        return ""

    def clear(self) -> None: ...

    def reopen(self) -> None: ...

    def close(self) -> None: ...


@pytest.mark.parametrize(
    ("name", "sent"),
    [
        ("TCPIP::h::1::SOCKET", ["V 0", "V 1", "V 2", "ok 3", "V 4", "V 5", "V 6", "V 7", "V 8", "V 9"]),
        ("TCPIP::h::INSTR", ["V 0;:V 1;:V 2", "ok 3", "V 4;:V 5;:V 6;:V 7;:V 8;:V 9"]),
    ],
)
def test_on_a_slow_wire_only_the_first_steps_wait_for_their_reply(name: str, sent: list[str]) -> None:
    wire = Wire(name)
    way = RampDown(wire, slow_reply_s=lambda: 0.1, now=lambda: 0.0, join=join_commands)
    for i in range(10):
        way.step(f"V {i}", lambda i=i: wire.write(f"ok {i}"))
    way.flush()
    assert wire.sent == sent


def test_an_instrument_that_is_slow_itself_confirms_every_step() -> None:
    """More steps than it carries out in time would be given up by a reply timeout."""
    wire, now = Wire("TCPIP::h::1::SOCKET"), [0.0]

    def confirm() -> None:
        now[0] += 0.1 * FIRST_STEPS
        wire.write("ok")

    way = RampDown(wire, slow_reply_s=lambda: 0.1, now=lambda: now[0])
    for _ in range(FIRST_STEPS + 3):
        way.step("V", confirm)
    assert wire.sent == ["V"] * (FIRST_STEPS - 1) + ["ok"] * 4


def test_a_wire_that_becomes_slow_on_the_way_to_rest_is_pipelined_from_then_on() -> None:
    wire, replies = Wire("TCPIP::h::1::SOCKET"), iter([0.0, 0.0, 0.5])
    way = RampDown(wire, slow_reply_s=lambda: next(replies), now=lambda: 0.0)
    for i in range(10):
        way.step(f"V {i}", lambda i=i: wire.write(f"ok {i}"))
    assert wire.sent == ["ok 0", "ok 1", "V 2", "V 3", "V 4", "ok 5", "V 6", "V 7", "V 8", "V 9"]


def test_a_pipelined_ramp_whose_confirmation_is_lost_begins_again_at_the_level_that_is_reached() -> None:
    """Going on after the steps that were sent could be a jump: how many were carried out is unknown."""
    wire = Wire("TCPIP::h::1::SOCKET")
    way = RampDown(wire, slow_reply_s=lambda: 0.1, now=lambda: 0.0)

    def unread() -> None:
        raise LinkError("no reply")

    for i in range(FIRST_STEPS - 1):
        way.step(f"V {i}", unread)
    with pytest.raises(LinkError, match="no reply"):
        way.step("V", unread)
    one_by_one = RampDown(wire, now=lambda: 0.0)
    one_by_one.step("V last", unread)  # the level before it is known: the ramp goes on without replies
    assert wire.sent[-1] == "V last"


def test_two_late_replies_in_succession_make_a_wire_slow_and_a_single_one_does_not() -> None:
    now = [0.0]

    class Late(Wire):
        after_s = 0.0

        def read(self) -> str:
            now[0] += self.after_s
            return "0"

    session = ScpiSession(wire := Late("TCPIP::h::1::SOCKET"), "generator", lambda: now[0])
    for wire.after_s, slow_s in ((0.001, 0.0), (0.001, 0.0), (0.001, 0.0), (0.5, 0.0), (0.4, 0.4), (0.001, 0.0)):
        session.query("A?")
        assert session.slow_reply_s == pytest.approx(slow_s)


def test_a_ramp_that_does_not_lead_to_rest_confirms_every_step_on_any_wire() -> None:
    wire = Wire("TCPIP::h::1::SOCKET")
    way = RampDown(wire, best_effort=False, slow_reply_s=lambda: 0.1)
    for _ in range(5):
        way.step("V", lambda: wire.write("ok"))
    assert wire.sent == ["ok"] * 5


@pytest.mark.parametrize("best_effort", [False, True])
def test_a_ramp_that_takes_far_too_long_is_not_continued_unless_it_leads_to_rest(best_effort: bool) -> None:
    """Nobody reads the card while it lasts, and neither Stop nor a lost card is noticed."""
    now = [100.0]
    way = RampDown(Wire("TCPIP::h::1::SOCKET"), best_effort=best_effort, now=lambda: now[0])
    way.limit_duration(2.0, 40, 0.01, 1.0)
    sent: list[float] = []
    with nullcontext() if best_effort else pytest.raises(InstrumentError, match="replies became slow; check the conn"):
        for _ in range(40):
            way.step("V", lambda: now.__setitem__(0, now[0] + 0.6))
            sent.append(now[0])
    assert len(sent) == (
        40 if best_effort else 15
    )  # 2 s, 5 s of patience and 1.6 s for the replies at their usual pace


def test_a_bench_whose_way_to_rest_takes_too_long_is_not_armed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with laboratory() as lab:
        monkeypatch.setattr(Keysight33500, "predict_rest_s", lambda *_: 5.3)
        runner = Runner(RunRequest(Levels(), tmp_path, "T1"), lab.bench, lab.operator)
        ended = runner.run()
        report = lab.control.report()
    assert ended.status is RunStatus.FAILED
    assert re.search(r"\b5\.3 s\b.*\b4 s\b.*'way to rest'.*amplifier", ended.reason)
    assert report.live_s == 0, "high voltage was not switched on"


def test_the_predicted_way_to_rest_is_stored_with_the_run(tmp_path: Path) -> None:
    events = []
    with laboratory() as lab:
        Runner(
            RunRequest(Levels(levels_v=(2.2,)), tmp_path, "T1"), lab.bench, lab.operator, EventBus(events.append)
        ).run()
    (armed,) = (event for event in events if isinstance(event, BenchArmed))
    assert 0.5 < armed.way_to_rest_s < 2.0


class Distant:
    """A socket on the virtual clock whose replies take `round_trip_s`."""

    name, round_trip_s = "TCPIP::h::1::SOCKET", 0.0

    def __init__(self, link: Any, clock: Clock) -> None:
        self._link, self._clock = link, clock

    def read(self) -> str:
        self._clock.sleep(self.round_trip_s)
        reply: str = self._link.read()
        return reply

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("round_trip_s", "limit_s"), [(0.1, 1.5), (0.6, 5.0)]
)  # without pipelining: a round trip for each of 50 steps and more
@pytest.mark.parametrize("drive", [Hold(2.02, 60.0), Hold(5.0, 60.0), Sine(100.0, 2.5, 2.5, 3000)])
def test_the_way_to_rest_takes_a_few_round_trips_and_never_jumps(
    round_trip_s: float, limit_s: float, drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    with connect(simulated(), None, wrap_link=Distant) as lab:
        amplifier, clock = lab.bench.amplifier, lab.bench.clock
        amplifier.initialize_at_rest()
        lab.control.enable_hv()
        amplifier.start_drive(drive)
        monkeypatch.setattr(Distant, "round_trip_s", round_trip_s)  # nobody has seen yet that the wire is slow
        predicted_s, begin_s = amplifier.predict_rest_s(), clock.now()
        amplifier.return_to_rest()
        took_s = clock.now() - begin_s
        report = lab.control.report()
    assert took_s < limit_s
    assert math.isfinite(predicted_s)
    assert report.ends_at_rest
    assert report.largest_jump_v <= STEP_V + 1e-6


@pytest.mark.deep
def test_the_watchdogs_connection_which_was_never_armed_pipelines_its_way_to_rest_too() -> None:
    with wired() as lab:
        lab.bench.amplifier.initialize_at_rest()
        lab.control.enable_hv()
        lab.bench.amplifier.start_drive(Hold(5.0, 60.0))
        source = Keysight33500(VisaLink(lab.proxy.resource), WallClock())
        confirmed: list[str] = []
        write_checked = source._scpi.write_checked

        def count(command: str) -> None:
            confirmed.append(command)
            write_checked(command)

        source._scpi.write_checked = count  # type: ignore[method-assign]
        lab.proxy.delay_s = 0.02
        HvAmplifier(source, AmplifierMap(), DriveLimits(), WallClock()).force_rest()
        source.close()
        assert len(confirmed) < 10, "of 50 steps"
        lab.bench.amplifier._drive_end_s = 0.0
        assert_safe_voltage(lab.control.report())


def test_a_connection_that_the_other_side_closed_is_noticed_before_a_timeout() -> None:
    with wired(generator={"timeout_s": 60.0}) as lab:
        amplifier = lab.bench.amplifier
        amplifier.initialize_at_rest()
        lab.control.enable_hv()
        amplifier.start_drive(Hold(2.2, 60.0))
        lab.proxy.cut()
        begin_s = time.monotonic()
        with pytest.raises(InstrumentError, match="has closed the connection"):
            amplifier.return_to_rest()
        amplifier.force_rest()
        assert time.monotonic() - begin_s < 55.0
        assert_safe_voltage(lab.control.report())
