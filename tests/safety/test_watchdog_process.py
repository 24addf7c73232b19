"""Watchdog process on a recorded source: what it commands, what it reports, and what counts as silence."""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from drivers.errors import BenchError
from drivers.watchdog import hang_detection
from drivers.watchdog.client import WATCHDOG_SILENCE_S, WatchdogClient
from drivers.watchdog.config import WatchdogConfig
from drivers.watchdog.hang_detection import BUSY_EXTRA_S, OWN_PAUSE_S, STARVED_EXTRA_S, ProcessActivity, Silence
from drivers.watchdog.log import LOG_NAME, append_line
from drivers.watchdog.origin import describe_copy

SOURCE = "tests.helpers.watchdog_sources:RecordingSource"


def wait(until: Callable[[], object], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < deadline
        time.sleep(0.01)


class Watched:
    """A program that the watchdog monitors; the test is the program."""

    def __init__(self, folder: Path, silence_s: float, **options: Any) -> None:
        self._calls = folder / "calls.txt"
        self._log = folder / LOG_NAME
        options = {"record": str(self._calls), **options}
        self.client = WatchdogClient(
            WatchdogConfig(SOURCE, "", 0.2, options=options, silence_s=silence_s, patience_s=0.1)
        )
        self.client.set_log_folder(folder)
        self.client.arm()

    def die(self) -> None:
        self.client._live.clear()
        assert self.client._child.stdin is not None
        self.client._child.stdin.close()
        self.client._child.wait(60)

    @property
    def calls(self) -> list[str]:
        return self._calls.read_text().split("\n")[:-1] if self._calls.exists() else []

    @property
    def log(self) -> str:
        return self._log.read_text() if self._log.exists() else ""


@contextmanager
def watched(folder: Path, silence_s: float = 60.0, **options: Any) -> Iterator[Watched]:
    program = Watched(folder, silence_s, **options)
    try:
        yield program
    finally:
        program.client.close()


REST = ["stop", "ramp_to 2.5", "is_at_rest"]


def test_rest_is_reported_only_if_the_source_says_that_it_is_at_rest(tmp_path: Path) -> None:
    with watched(tmp_path, stays_away=True) as program:
        program.die()
        assert program.calls[:3] == REST
        assert "could NOT be brought to rest" in program.log
        assert "does not report that it is at rest" in program.log
        assert "was brought to rest" not in program.log


@pytest.mark.deep
def test_a_source_that_does_not_obey_a_dead_program_is_reported_before_the_watchdog_tries_again(tmp_path: Path) -> None:
    with watched(tmp_path, stays_away=True) as program:
        program.die()
        first, last = program.log.splitlines()
    assert "The specimen may be live: the source does not obey: " in first
    assert "tries again for 0.1 s. Switch the high voltage OFF at the amplifier itself" in first
    assert "could NOT be brought to rest" in last


@pytest.mark.deep
def test_a_way_to_rest_that_takes_long_is_reported_meanwhile(tmp_path: Path) -> None:
    (held := tmp_path / "held").touch()
    with watched(tmp_path, held_by=str(held)) as program:
        program.client._live.clear()
        assert program.client._child.stdin is not None
        program.client._child.stdin.close()
        wait(
            lambda: (
                "The specimen may be live: the source is not at rest after 3 s. Switch the high voltage OFF"
                in program.log
            )
        )
        assert "brought to rest" not in program.log
        held.unlink()
        wait(lambda: "was brought to rest" in program.log)
        assert program.log.count("may be live") == 1


@pytest.mark.deep
def test_a_cut_connection_is_opened_again_between_two_attempts(tmp_path: Path) -> None:
    with watched(tmp_path, cut=True) as program:
        program.die()
        assert "reconnect" in program.calls
        assert program.calls[-3:] == REST
        assert "was brought to rest" in program.log


@pytest.mark.deep
def test_a_program_that_dies_after_the_watchdog_took_over_is_followed_by_rest_again(tmp_path: Path) -> None:
    """Between the two the program may have commanded the source."""
    with watched(tmp_path, silence_s=0.2) as program:
        wait(lambda: "was brought to rest" in program.log)
        assert program.calls == REST
        program.die()
        assert program.calls == REST * 2
        assert "the program ended without a word" in program.log


@pytest.mark.deep
def test_a_program_that_was_held_up_waits_for_what_the_watchdog_reports(tmp_path: Path) -> None:
    with watched(tmp_path) as program:
        program.client._last_heartbeat_s -= 2 * 60.0
        reason = "the program was frozen"
        report = threading.Timer(0.03, program.client._handle_line, ("acting", reason))
        report.start()
        program.client.send_heartbeat()
        with pytest.raises(BenchError, match=rf"^the watchdog\b.*: {reason}$"):
            program.client.raise_for_status()
        report.join()


@pytest.mark.deep
def test_a_watchdog_of_another_copy_of_the_program_is_refused(tmp_path: Path) -> None:
    with watched(tmp_path) as program:
        client = program.client
        client._ready = client._failed = ""
        client._handle_line("ready", "0.0.1 in /somewhere/else")
        assert not client._wait_until_ready()
        assert "is another copy of this program, version 0.0.1 in /somewhere/else, while this one is" in client._failed
        assert f"version {describe_copy()}; restart this program" in client._failed
        client._handle_line("ready", describe_copy())
        assert client._ready


@pytest.mark.deep
def test_a_silent_watchdog_counts_as_dead_after_a_second_and_on_a_busy_computer_after_two(tmp_path: Path) -> None:
    assert WATCHDOG_SILENCE_S + BUSY_EXTRA_S < 2.5
    with watched(tmp_path) as program:
        for silence, dead in (
            (Silence(0.9, 0.9), False),
            (Silence(1.1, 1.1), True),
            (Silence(1.8, 0.3), False),
            (Silence(2.3, 0.3), True),
        ):
            program.client._process.since = lambda _, silence=silence: silence  # type: ignore[method-assign]
            if dead:
                with pytest.raises(BenchError, match=r"^the watchdog\b.*\b\d+\.\d s\b"):
                    program.client.raise_for_status()
            else:
                program.client.raise_for_status()


@pytest.mark.deep
def test_a_stopped_watchdog_is_noticed_before_the_run_goes_on_for_long(tmp_path: Path) -> None:
    with watched(tmp_path) as program:
        child = psutil.Process(program.client.pid)
        child.suspend()
        wait(lambda: program.client._process.since(program.client._last_line).exceeds(WATCHDOG_SILENCE_S), 20.0)
        with pytest.raises(BenchError, match=r"^the watchdog\b.*\b\d+\.\d s\b"):
            program.client.raise_for_status()
        child.resume()


def test_every_line_of_the_log_is_on_the_disk_before_the_watchdog_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[str] = []
    monkeypatch.setattr(os, "fsync", lambda _: synced.append((tmp_path / LOG_NAME).read_text()))
    append_line(tmp_path, "2.5 V")
    assert len(synced) == 1
    assert synced[0].endswith(" 2.5 V\n")


# -- what counts as silence -----------------------------------------------------------------------------------------


class Computer:
    """Time, load and the observed process, as a test wants them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s, self.busy, self.processor_s, self.status = 100.0, False, 0.0, psutil.STATUS_SLEEPING
        monkeypatch.setattr(hang_detection.time, "monotonic", lambda: self.now_s)
        monkeypatch.setattr(hang_detection.psutil, "cpu_percent", lambda _: 100.0 if self.busy else 20.0)
        monkeypatch.setattr(psutil.Process, "status", lambda _: self.status)
        monkeypatch.setattr(psutil.Process, "cpu_times", lambda _: SimpleNamespace(user=self.processor_s, system=0.0))
        self.activity = ProcessActivity(os.getpid())

    def wait(self, seconds: float, processor: float = 0.0) -> Silence:
        """Pass time in which the process gets a fraction of a processor; return its silence."""
        mark = self.activity.mark()
        for _ in range(round(seconds / 0.1)):
            self.now_s += 0.1
            self.processor_s += 0.1 * processor
            self.activity.update()
        return self.activity.since(mark)


def test_on_an_idle_computer_every_second_of_silence_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(monkeypatch)
    silence = computer.wait(1.0)
    assert (silence.elapsed_s, silence.available_s) == (pytest.approx(1.0), pytest.approx(1.0))
    assert silence.exceeds(0.9)


def test_on_a_busy_computer_the_processor_time_counts_that_the_program_got(monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(monkeypatch)
    computer.busy = True
    starved = computer.wait(1.0, processor=0.1)
    assert starved.available_s == pytest.approx(0.1)
    assert not starved.exceeds(0.4)
    assert computer.wait(1.5, processor=0.3).exceeds(0.4)  # an endless loop
    assert computer.wait(1.6).exceeds(0.4)  # nothing is waited for longer than that


def test_a_program_that_is_known_to_wait_for_a_processor_is_given_more_time(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    computer = Computer(monkeypatch)
    computer.busy = True
    thread = tmp_path / "7" / "schedstat"
    thread.parent.mkdir()
    computer.activity._tasks = tmp_path
    mark = computer.activity.mark()
    for step in range(36):
        thread.write_text(f"1000 {step * 100_000_000} 3")
        computer.wait(0.1)
        dead = computer.activity.since(mark).exceeds(0.4)
        assert dead == (computer.activity.since(mark).elapsed_s > 0.4 + STARVED_EXTRA_S)
    assert dead
    assert computer.wait(1.6).exceeds(0.4), "a thread that hangs does not wait for a processor"


def test_a_stopped_program_is_not_taken_for_a_starved_one(monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(monkeypatch)
    computer.busy, computer.status = True, psutil.STATUS_STOPPED
    assert computer.wait(0.5).exceeds(0.4)


def test_a_pause_of_the_observer_is_no_silence_of_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(monkeypatch)
    mark = computer.activity.mark()
    computer.now_s += 30.0
    computer.activity.update()
    assert computer.activity.since(mark).elapsed_s == pytest.approx(OWN_PAUSE_S)
