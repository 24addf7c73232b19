"""Watchdog: if the program dies or hangs while live, the source is brought to rest, and the next start reports it."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import psutil
import pytest

from app.common.exit_codes import ExitCode
from drivers.bench.drive_limits import DriveLimits, HvAmplifier
from drivers.bench.watchdog_interface import HeartbeatClock, NoWatchdog
from drivers.drive_shapes import Drive, Hold, Sine
from drivers.errors import BenchError
from drivers.generators.keysight import Keysight33500
from drivers.transport.visa import VisaLink
from drivers.watchdog.client import WatchdogClient
from drivers.watchdog.config import WatchdogConfig
from drivers.watchdog.log import LOG_NAME
from drivers.watchdog.process import SWITCH_OFF_INSTRUCTION
from model.amplifier_map import AmplifierMap
from protocols.base import RestMeasured, RunStatus
from protocols.measurements.sine_dwell import SineDwell
from sim_hardware.bench import SimulatedBench
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.program import program, safe
from tests.helpers.simulated_bench import assert_safe_voltage, laboratory, run

LONG = ("frequencies_hz=100", "settle_limit_s=2", "record_s=60")
"""A drive that would go on for more than a minute by itself. How soon the watchdog ends it is measured in docs/decisions/0020-watchdog.md; here
only that it does, for tests run beside other work."""


def log(folder: Path) -> str:
    file = folder / LOG_NAME
    return file.read_text() if file.exists() else ""


def wait(until: Callable[[], object], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def cut_short(bench: ServedBench) -> bool:
    """At rest, although the drive had long to go."""
    report = bench.report()
    return report.ends_at_rest and report.outside_rest_s < 60.0


# -- the whole program ----------------------------------------------------------------------------------------------


def test_watchdog_rests_after_sigkill_long_before_the_drive_ends(tmp_path: Path) -> None:
    with program(tmp_path, *LONG, watchdog="silence_s = 5") as (tactor_bench, _):
        tactor_bench.go_live()
        tactor_bench.process.kill()
        wait(lambda: "was brought to rest" in log(tmp_path))  # a sine passes through rest, too
        assert "the program ended without a word while the bench was live" in log(tmp_path)
        assert cut_short(tactor_bench.bench)
        safe(tactor_bench.bench)


@pytest.mark.deep
def test_watchdog_rests_after_sigstop_and_resumed_program_does_not_drive(tmp_path: Path) -> None:
    with program(tmp_path, *LONG, watchdog="silence_s = 2") as (tactor_bench, _):
        tactor_bench.go_live()
        tactor_bench.process.send_signal(signal.SIGSTOP)
        wait(lambda: "was brought to rest" in log(tmp_path))
        assert cut_short(tactor_bench.bench)
        tactor_bench.process.send_signal(signal.SIGCONT)
        assert tactor_bench.end() == ExitCode.FAILED, tactor_bench.text
        assert "the watchdog took the source over" in tactor_bench.text
        assert "At rest: the card sees 2.500 V" in tactor_bench.text
        safe(tactor_bench.bench)


@pytest.mark.deep
def test_watchdog_kills_hung_program_on_a_single_connection_wire(tmp_path: Path) -> None:
    with program(tmp_path, *LONG, watchdog="own_connection = false\nsilence_s = 2") as (tactor_bench, _):
        tactor_bench.go_live()
        tactor_bench.process.send_signal(signal.SIGSTOP)
        wait(lambda: "was brought to rest" in log(tmp_path))
        assert tactor_bench.end() == -signal.SIGKILL
        safe(tactor_bench.bench)


@pytest.mark.deep
@pytest.mark.parametrize("model", ["SDG1032X", "SDG2122X"])
def test_a_siglent_that_answers_one_client_is_brought_to_rest_after_a_killed_program(
    model: str, tmp_path: Path
) -> None:
    """The watchdog connects when the program has ended, and waits for the end of the drive, 9 s at most."""
    settings = "frequencies_hz=100", "settle_limit_s=1", "record_s=5"
    with program(tmp_path, *settings, watchdog="silence_s = 5", model=model) as (tactor_bench, _):
        tactor_bench.go_live()
        tactor_bench.process.kill()
        wait(lambda: "was brought to rest" in log(tmp_path))
        assert tactor_bench.bench.report().ends_at_rest
        safe(tactor_bench.bench)


# -- the watchdog and a source, without the rest of the program -----------------------------------------------------


class Live:
    """A live bench of which the test is the program: a source that plays, and a watchdog that watches."""

    def __init__(self, folder: Path, served: ServedBench, charge: WatchdogConfig) -> None:
        self.folder, self.bench = folder, served.bench
        self.charge = replace(charge, resource=f"TCPIP::127.0.0.1::{served.scpi.port}::SOCKET")
        self.watchdog = WatchdogClient(self.charge)
        self.watchdog.set_log_folder(folder)
        clock = HeartbeatClock()
        clock.watchdog = self.watchdog
        self.source = Keysight33500(VisaLink(self.charge.resource, 2.0), clock)
        self.amplifier = HvAmplifier(self.source, AmplifierMap(), DriveLimits(), clock, self.watchdog)
        self.amplifier.initialize_at_rest()
        self.watchdog.arm()
        self.bench.enable_hv()

    def play(self, drive: Drive) -> None:
        self.amplifier.start_drive(drive)
        wait(lambda: self.bench.report().outside_rest_s > 0.05)

    def hang(self) -> None:
        """What the watchdog sees of a run thread that hangs: it promised another heartbeat soon, and none comes."""
        self.watchdog._send("beat 0.5")

    def die(self) -> None:
        """What a dead program leaves: a closed pipe."""
        assert self.watchdog._child.stdin is not None
        self.watchdog._live.clear()
        self.watchdog._child.stdin.close()

    def at_rest(self) -> bool:
        return self.bench.report().ends_at_rest


CHARGE = WatchdogConfig("drivers.generators.keysight:Keysight33500", "", 2.0, patience_s=10.0, silence_s=60.0)
"""The pauses of a busy computer are no silence, unless that is what the test is about."""


@contextmanager
def live(folder: Path, charge: WatchdogConfig = CHARGE) -> Iterator[Live]:
    with ServedBench(SimulatedBench()) as served:
        bench = Live(folder, served, charge)
        try:
            yield bench
        finally:
            bench.watchdog.close()
            bench.amplifier.close()


@pytest.mark.deep
def test_watchdog_ramps_down_a_held_level(tmp_path: Path) -> None:
    with live(tmp_path) as bench:
        bench.play(Hold(5.0, 60.0))
        bench.die()
        wait(bench.at_rest)
        assert_safe_voltage(bench.bench.report())


@pytest.mark.deep
def test_a_run_thread_that_hangs_counts_as_dead_although_the_interpreter_lives(tmp_path: Path) -> None:
    with live(tmp_path) as bench:
        bench.play(Sine(100, 2.5, 2.5, 2000))
        bench.hang()
        wait(lambda: bench.watchdog.takeover_outcome)
        assert bench.at_rest()
        assert_safe_voltage(bench.bench.report())
        wait(lambda: "the thread that reads the card" in log(tmp_path))
        with pytest.raises(BenchError, match=r"^the watchdog\b.*\bsource\b.*\bthread\b"):
            bench.watchdog.raise_for_status()
        pieces = len(bench.bench.history.entries())
        with pytest.raises(BenchError, match=r"^the watchdog\b.*\bsource\b"):
            bench.amplifier.start_drive(Sine(100, 2.5, 2.5, 2000))
        assert len(bench.bench.history.entries()) == pieces  # nothing reached the source


@pytest.mark.deep
def test_frozen_interpreter_counts_as_dead_while_awaiting_a_reply(tmp_path: Path) -> None:
    with live(tmp_path, replace(CHARGE, silence_s=3.0)) as bench:
        bench.play(Sine(100, 2.5, 2.5, 2000))
        with bench.watchdog.allow_silence(60.0):
            bench.watchdog._closing.set()  # the interpreter's pulse stands still
            wait(bench.at_rest)
        wait(lambda: "the program was frozen" in log(tmp_path))


@pytest.mark.deep
def test_it_is_deaf_to_the_terminal_and_goes_with_the_program_without_a_word(tmp_path: Path) -> None:
    with live(tmp_path) as bench:
        watchdog = psutil.Process(bench.watchdog.pid)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            watchdog.send_signal(number)
        assert os.getpgid(watchdog.pid) != os.getpgid(0)  # a Ctrl-Z stops the program, not the watchdog
        bench.watchdog.raise_for_status()
        bench.watchdog.disarm()
        bench.watchdog.close()
        assert not watchdog.is_running()
        assert log(tmp_path) == ""


@pytest.mark.deep
def test_a_watchdog_that_was_killed_or_hangs_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with live(tmp_path) as bench:
        watchdog = psutil.Process(bench.watchdog.pid)
        bench.watchdog.raise_for_status()
        with monkeypatch.context() as impatient:
            impatient.setattr("drivers.watchdog.client.WATCHDOG_SILENCE_S", -1.0)
            with pytest.raises(BenchError, match=r"^the watchdog\b.*\b\d+\.\d s\b"):
                bench.watchdog.raise_for_status()
        watchdog.kill()
        wait(lambda: bench.watchdog._ended)
        with pytest.raises(BenchError, match=r"has ended .code -9., and the bench does not stay live without it"):
            bench.watchdog.raise_for_status()
        bench.watchdog.disarm()
        bench.watchdog.arm()  # for the next run it is replaced
        bench.play(Hold(4.0, 60.0))
        bench.die()
        wait(bench.at_rest)


def test_a_run_whose_watchdog_was_lost_goes_to_rest_and_says_so(tmp_path: Path) -> None:
    class Lost(NoWatchdog):
        blocks = 0

        def raise_for_status(self) -> None:
            self.blocks += 1
            if self.blocks > 60:
                raise BenchError("the watchdog has ended (code -9)")

    with laboratory() as lab:
        lab.bench.watchdog = Lost()
        ran = run(SineDwell(frequencies_hz=(100, 200)), tmp_path, lab)
    assert (ran.status, ran.reason) == (RunStatus.FAILED, "the watchdog has ended (code -9)")
    assert ran.report.outside_rest_s > 0.5
    assert any(isinstance(event, RestMeasured) and event.confirmed for event in ran.events)


@pytest.mark.deep
def test_a_program_that_beats_is_never_interrupted(tmp_path: Path) -> None:
    bears_s = 4.0  # more than a busy computer's own pauses
    with live(tmp_path, replace(CHARGE, silence_s=bears_s)) as bench:
        bench.play(Sine(100, 1.0, 2.5, 2000))
        end_s = time.monotonic() + bears_s + 0.5
        while time.monotonic() < end_s:
            time.sleep(0.05)
            bench.watchdog.send_heartbeat()
            bench.watchdog.raise_for_status()
        assert not bench.at_rest()
        bench.amplifier.return_to_rest()
        bench.watchdog.disarm()
        time.sleep(bears_s + 0.2)  # silence at rest means nothing
        bench.watchdog.close()
        assert log(tmp_path) == ""


@pytest.mark.deep
def test_a_staircase_held_up_in_the_middle_is_not_gone_on_with(tmp_path: Path) -> None:
    """The program stops during a ramp and continues after the watchdog has acted: its next step would be a jump."""
    with live(tmp_path) as bench:
        bench.play(Hold(4.0, 60.0))
        tell, told = bench.source._scpi.write_checked, []

        def slow(command: str) -> None:
            told.append(command)
            tell(command)
            if len(told) == 10:
                bench.hang()
                wait(lambda: bench.watchdog.takeover_outcome)

        bench.source._scpi.write_checked = slow
        with pytest.raises(BenchError, match=r"^the watchdog\b.*\bsource\b"):
            bench.amplifier.start_drive(Hold(1.0, 60.0))
        assert len(told) == 10
        assert bench.at_rest()
        assert_safe_voltage(bench.bench.report())


@pytest.mark.deep
def test_a_program_that_dies_at_rest_needs_nothing_but_a_line_in_the_log(tmp_path: Path) -> None:
    with live(tmp_path) as bench:
        bench.watchdog.disarm()
        bench.die()
        wait(lambda: "the source was at rest, nothing was to be done" in log(tmp_path))


@pytest.mark.deep
def test_with_the_wire_cut_at_the_same_time_the_log_says_why_it_could_not(tmp_path: Path) -> None:
    with live(tmp_path, replace(CHARGE, patience_s=1.0)) as bench:
        bench.play(Sine(100, 1.0, 2.5, 150))
        bench.bench.inject("scpi-dropped")
        bench.die()
        wait(lambda: "could NOT be brought to rest" in log(tmp_path))
        assert "the program ended without a word while the bench was live" in log(tmp_path)
        assert "33511B: no answer to '" in log(tmp_path)
        assert SWITCH_OFF_INSTRUCTION in log(tmp_path)
        wait(bench.at_rest)  # the burst ends by itself all the same


@pytest.mark.deep
def test_a_wire_that_comes_back_in_time_is_used(tmp_path: Path) -> None:
    with live(tmp_path, replace(CHARGE, patience_s=20.0)) as bench:
        bench.play(Hold(4.0, 60.0))
        bench.bench.inject("scpi-dropped")
        bench.die()
        time.sleep(0.6)
        assert not bench.at_rest()
        bench.bench.clear()
        wait(bench.at_rest)
        assert_safe_voltage(bench.bench.report())


@pytest.mark.deep
def test_a_program_that_cannot_command_the_source_asks_it_for_help(tmp_path: Path) -> None:
    with live(tmp_path) as bench:
        bench.play(Hold(4.0, 60.0))
        bench.source._scpi.link.close()
        assert "was brought to rest" in bench.watchdog.request_rest("no answer to 'VOLT?'")
        assert bench.at_rest()
        assert_safe_voltage(bench.bench.report())


@pytest.mark.deep
def test_a_bench_whose_watchdog_cannot_reach_the_source_does_not_go_live(tmp_path: Path) -> None:
    watchdog = WatchdogClient(replace(CHARGE, resource="TCPIP::127.0.0.1::9::SOCKET"))
    with pytest.raises(BenchError, match=r"the watchdog does not watch: .*cannot be reached.*'enabled'"):
        watchdog.arm()
    watchdog.close()
