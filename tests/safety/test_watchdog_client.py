"""Watchdog client with a watchdog that the test plays: every line that is sent, and what each reply makes of the run."""

import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from drivers.deadlines import Deadline
from drivers.errors import BenchError
from drivers.watchdog import client as module
from drivers.watchdog.client import WatchdogClient
from drivers.watchdog.config import WatchdogConfig
from drivers.watchdog.hang_detection import Silence
from drivers.watchdog.origin import describe_copy
from drivers.watchdog.subprocesses import python_command, python_environment
from tests.safety.test_watchdog_loop import LONG_S

CONFIG = WatchdogConfig("a:Source", "ASRL9::INSTR", 0.2, silence_s=0.4)
READY = f"ready {describe_copy()}"


class Child:
    """A watchdog process of which the test is the program: it keeps what it reads and sends what the test says."""

    def __init__(self, command: list[str], **options: Any) -> None:
        self.command, self.options, self.pid = command, options, os.getpid()
        theirs, ours = os.pipe()
        self._commands = os.fdopen(theirs)
        self.stdin = os.fdopen(ours, "w")
        theirs_out, ours_out = os.pipe()
        self.stdout = os.fdopen(theirs_out)
        self._out = os.fdopen(ours_out, "w")
        self.lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.closed = False
        self.thread = threading.Thread(target=self._read, daemon=True)
        self.thread.start()

    def _read(self) -> None:
        with self._commands:
            for line in self._commands:
                self.lines.put(line.rstrip("\n"))
        self.lines.put("(end)")
        self.end()  # as the real one, which ends with its input

    def say(self, line: str) -> None:
        self._out.write(line + "\n")
        self._out.flush()

    def end(self) -> None:
        if not self.closed:
            self.closed = True
            self._out.close()

    def next(self, without: str = "pulse") -> str:
        while (line := self.lines.get(timeout=LONG_S)) == without:
            pass
        return line

    def heard(self, until: str = "note the end") -> list[str]:
        heard = []
        while (line := self.lines.get(timeout=LONG_S)) != until:
            heard.append(line)
        return heard

    def poll(self) -> int | None:
        return -9 if self.closed else None

    def wait(self, _timeout_s: float | None = None) -> int:
        self.thread.join(LONG_S)
        return 0

    def kill(self) -> None:
        self.end()


class Children(list[Child]):
    """All that were started, and what each says first."""

    def __init__(self) -> None:
        super().__init__()
        self.greetings = [READY]

    def start(self, command: list[str], **options: Any) -> Child:
        self.append(Child(command, **options))
        greeting = self.greetings.pop(0) if len(self.greetings) > 1 else self.greetings[0]
        if greeting:
            self[-1].say(greeting)
        else:
            self[-1].end()
        return self[-1]


@pytest.fixture
def children(monkeypatch: pytest.MonkeyPatch) -> Children:
    children = Children()
    # the module's own: other tests' helpers start processes, too
    fake = SimpleNamespace(Popen=children.start, PIPE=subprocess.PIPE)
    monkeypatch.setattr(module, "subprocess", fake)
    return children


@pytest.fixture
def make(children: Children) -> Iterator[Callable[..., WatchdogClient]]:
    clients: list[WatchdogClient] = []

    def start(config: WatchdogConfig = CONFIG) -> WatchdogClient:
        clients.append(WatchdogClient(config))
        return clients[-1]

    yield start
    for client in clients:
        client.close()
        assert not any(thread.name.startswith("watchdog ") and thread.is_alive() for thread in threading.enumerate())
    for child in children:
        assert child.stdin.closed
        assert child.stdout.closed


@pytest.fixture
def live(make: Callable[[], WatchdogClient], children: Children) -> WatchdogClient:
    client = make()
    client.arm()
    assert children[0].next() == CONFIG.as_line()
    assert children[0].next() == "live"
    return client


def heard(client: WatchdogClient, child: Child) -> list[str]:
    """Return what it was sent until now, without the interpreter's pulse."""
    client.log("the end")
    return [line for line in child.heard() if line != "pulse"]


def wait(until: Callable[[], object]) -> None:
    deadline = time.monotonic() + LONG_S
    while not until():
        assert time.monotonic() < deadline
        time.sleep(0.002)


# -- start and end -------------------------------------------------------------------------------------------------------


def test_it_is_started_by_itself_with_its_configuration_and_ends_with_a_word(
    make: Callable[[], WatchdogClient], children: Children, tmp_path: Path
) -> None:
    client = make()
    (child,) = children
    assert child.command == python_command("-m", "drivers.watchdog.process")
    assert child.options["env"] == python_environment()
    assert child.options["start_new_session"]  # a Ctrl-C at the terminal is not for it
    assert child.options["text"]
    assert client.pid == child.pid
    client.set_log_folder(tmp_path)
    client.close()
    assert child.heard("(end)") == [CONFIG.as_line(), f"log {tmp_path.resolve()}", "bye"]
    client.arm()  # the bench is used again
    assert children[1].heard("live") == [CONFIG.as_line(), f"log {tmp_path.resolve()}"]


def test_one_that_has_ended_is_replaced_when_the_bench_is_armed(
    make: Callable[[], WatchdogClient], children: Children
) -> None:
    children.greetings = ["", READY]
    client = make()
    client.arm()
    assert len(children) == 2
    assert children[1].heard("live") == [CONFIG.as_line()]
    client.raise_for_status()


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("greeting", "why"),
    [
        ("failed it is another model", ": it is another model"),
        ("", ""),
        (
            "ready 0.0.1 in /elsewhere",
            ": the process that was started is another copy of this program, version 0.0.1 in",
        ),
    ],
)
def test_a_bench_is_not_armed_without_it(
    make: Callable[[], WatchdogClient], children: Children, greeting: str, why: str
) -> None:
    children.greetings = [greeting]
    client = make()
    with pytest.raises(BenchError) as failed:
        client.arm()
    assert str(failed.value).startswith(f"the watchdog does not watch{why}")
    assert "switch off 'enabled' of the bench's watchdog" in str(failed.value)
    assert len(children) == 2
    client.send_heartbeat()
    client.raise_for_status()
    client.close()
    assert [line for child in children for line in child.heard("(end)") if line in ("live", "pulse")] == []


def test_the_wait_for_it_has_an_end(
    make: Callable[[], WatchdogClient], children: Children, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert Deadline.WATCHDOG_START.seconds <= 30.0  # an operator waits
    monkeypatch.setattr(Deadline.WATCHDOG_START, "seconds", 0.02)
    children.greetings = ["tick"]
    with pytest.raises(BenchError, match=r"the watchdog does not watch\. "):
        make().arm()


# -- while live ----------------------------------------------------------------------------------------------------------


def test_heartbeats_and_pulses_are_sent_while_live_only(make: Callable[[], WatchdogClient], children: Children) -> None:
    client = make()
    client.send_heartbeat()
    client.arm()
    (child,) = children
    assert child.heard("live") == [CONFIG.as_line()]
    client.send_heartbeat()
    assert child.next() == "beat 0.400"
    assert child.next(without="") == "pulse"  # comes by itself
    client.disarm()
    client.send_heartbeat()
    time.sleep(2.5 * module.HEARTBEAT_PERIOD_S)
    client.log("the end")
    lines = child.heard()
    assert [line for line in lines if line != "pulse"] == ["rest"]
    assert lines[lines.index("rest") + 1 :] in ([], ["pulse"])  # one may have been on its way


def test_a_command_of_the_source_may_take_as_long_as_its_reply(live: WatchdogClient, children: Children) -> None:
    (child,) = children
    with live.allow_silence():
        with live.allow_silence(0.3):  # never less than outside
            live.send_heartbeat()
        with live.allow_silence(8.0):
            pass
    assert heard(live, child) == [f"beat {s}" for s in ("1.200", "1.200", "1.200", "1.200", "8.000", "1.200", "0.400")]


@pytest.mark.parametrize(("measured_s", "allowed_s"), [(3.0, "4.000"), (0.1, "1.200")])
def test_a_slower_reply_that_was_measured_is_allowed_and_a_faster_one_shortens_nothing(
    make: Callable[..., WatchdogClient], children: Children, measured_s: float, allowed_s: str
) -> None:
    client = make(replace(CONFIG, measured_reply_s=measured_s, measured_stop_s=measured_s))
    client.arm()
    with client.allow_silence():
        pass
    assert heard(client, children[0])[-2:] == [f"beat {allowed_s}", "beat 0.400"]


def test_a_second_attempt_of_the_measured_duration_fits_and_a_shorter_one_shortens_no_patience() -> None:
    assert replace(CONFIG, measured_stop_s=20.0).retry_time_s(30.0) == 40.0
    assert replace(CONFIG, measured_stop_s=0.2).retry_time_s(30.0) == 30.0


@pytest.mark.parametrize("reports", [False, True])
def test_a_run_thread_that_was_held_up_waits_for_reports_before_its_heartbeat(
    live: WatchdogClient, children: Children, monkeypatch: pytest.MonkeyPatch, reports: bool
) -> None:
    waited: list[tuple[bool, float]] = []
    wait_for = live._changed.wait_for

    def noted(until: Callable[[], bool], seconds: float) -> bool:
        waited.append((until(), seconds))
        return wait_for(until, seconds)

    now_s = live._last_heartbeat_s
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now_s))
    monkeypatch.setattr(live._changed, "wait_for", noted)
    now_s += 0.39
    live.send_heartbeat()
    assert waited == []
    now_s += 0.41
    if reports:
        children[0].say("acting the program was frozen")
        wait(lambda: live.takeover_reason)
    live.send_heartbeat()
    assert waited == [(reports, pytest.approx(0.2))]
    live.send_heartbeat()
    assert len(waited) == 1
    assert heard(live, children[0]) == ["beat 0.400"] * 3


def test_a_takeover_ends_the_run_and_a_later_run_begins_anew(live: WatchdogClient, children: Children) -> None:
    (child,) = children
    live.raise_for_status()
    live.raise_if_taken_over()
    assert live.takeover_outcome == ""
    child.say("acting the program was frozen")
    wait(lambda: live.takeover_reason)
    with pytest.raises(BenchError, match="the watchdog took the source over: the program was frozen"):
        live.raise_for_status()
    with pytest.raises(BenchError, match="the watchdog took the source over: the program was frozen"):
        live.raise_if_taken_over()
    child.say("done it rests")
    wait(lambda: live.takeover_outcome)
    assert live.takeover_outcome == "it rests"
    live.disarm()
    live.raise_for_status()
    live.raise_if_taken_over()
    live.arm()
    live.raise_for_status()
    live.raise_if_taken_over()
    assert live.takeover_outcome == ""
    assert not live.brought_to_rest


@pytest.mark.parametrize("outcome", ["done it rests", "could-not it does not answer", "(ends)"])
def test_the_source_is_not_commanded_while_the_watchdog_commands_it(
    live: WatchdogClient, children: Children, outcome: str
) -> None:
    (child,) = children
    child.say("acting the program was frozen")
    wait(lambda: live._taking_over)
    entered, left = threading.Event(), threading.Event()

    def command() -> None:
        with live.allow_silence():
            live.raise_if_taken_over()  # what is commanded from here on is commanded afterwards
            entered.set()
            left.wait(LONG_S)

    thread = threading.Thread(target=command)
    thread.start()
    assert child.next() == "beat 1.200"
    assert not entered.wait(0.05)
    if outcome.startswith("could-not"):
        child.say("failing")
        assert child.next() == "mine"  # that it does not try again while the program commands
        assert not entered.wait(0.05)
    child.end() if outcome == "(ends)" else child.say(outcome)
    assert entered.wait(LONG_S)
    left.set()
    thread.join()


def test_a_takeover_within_a_command_ends_it_once(live: WatchdogClient, children: Children) -> None:
    with live.allow_silence():
        live.raise_if_taken_over()
        children[0].say("acting the program was frozen")
        children[0].say("done it rests")
        wait(lambda: live.takeover_outcome)
        with pytest.raises(BenchError, match="the watchdog took the source over: the program was frozen"):
            live.raise_if_taken_over()
        with live.allow_silence():
            live.raise_if_taken_over()
        with pytest.raises(BenchError, match="took the source over"):
            live.raise_if_taken_over()


def test_one_that_has_ended_ends_the_run(live: WatchdogClient, children: Children) -> None:
    children[0].end()
    wait(lambda: live._ended)
    with pytest.raises(
        BenchError, match=r"the watchdog has ended \(code -9\), and the bench does not stay live without it"
    ):
        live.raise_for_status()
    live.send_heartbeat()  # no error of its own


@pytest.mark.parametrize(("silent_s", "dead"), [(0.99, False), (1.01, True)])
def test_one_that_says_nothing_for_a_second_ends_the_run(
    live: WatchdogClient, children: Children, silent_s: float, dead: bool
) -> None:
    live._process.since = lambda _: Silence(silent_s, silent_s)  # type: ignore[method-assign]
    if dead:
        with pytest.raises(
            BenchError, match=r"^the watchdog has sent nothing for 1\.0 s, and the bench does not stay live without it"
        ):
            live.raise_for_status()
    else:
        live.raise_for_status()


def test_every_line_of_it_counts_as_a_sign_of_life(
    live: WatchdogClient, children: Children, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks = iter(range(1, 1000))
    monkeypatch.setattr(live._process, "mark", lambda: Silence(next(marks), 0.0))
    for i in range(1, 4):
        children[0].say("tick")
        wait(lambda i=i: live._last_line.elapsed_s == i)


def test_its_process_is_observed_while_live_and_the_time_at_rest_is_no_silence(
    make: Callable[[], WatchdogClient], children: Children
) -> None:
    client = make()
    updated = threading.Event()
    client._process.update = updated.set  # type: ignore[method-assign]
    client._process._sampled_s = -1e6
    assert not updated.wait(3 * module.HEARTBEAT_PERIOD_S)
    client.arm()
    assert updated.wait(LONG_S)
    assert client._process._sampled_s > 0.0
    client.disarm()
    client.close()
    assert not client._pulse_thread.is_alive()


# -- requests ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reply", ["done it rests", "could-not it rests"])
def test_help_is_waited_for_and_its_outcome_returned(live: WatchdogClient, children: Children, reply: str) -> None:
    outcomes: list[str] = []
    thread = threading.Thread(target=lambda: outcomes.append(live.request_rest("no\nanswer  to 'VOLT?'")))
    thread.start()
    assert children[0].next() == "help no answer to 'VOLT?'"
    children[0].say("acting the program could not, and asked for it")
    thread.join(0.05)
    assert thread.is_alive()
    children[0].say(reply)
    thread.join(LONG_S)
    assert outcomes == ["it rests"]
    assert live.brought_to_rest == reply.startswith("done")


def test_help_of_one_that_ends_or_says_nothing_is_told(
    live: WatchdogClient, children: Children, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert Deadline.WATCHDOG_REQUEST.seconds <= 15.0  # the report of an unsafe bench waits for it
    monkeypatch.setattr(Deadline.WATCHDOG_REQUEST, "seconds", 0.02)
    children[0].say("done it rested in the last run")
    wait(lambda: live.takeover_outcome)
    assert live.request_rest("why") == "the watchdog did not answer"
    monkeypatch.setattr(Deadline.WATCHDOG_REQUEST, "seconds", 600.0)
    children[0].end()
    assert live.request_rest("why") == "the watchdog did not answer"


def test_a_note_is_one_line(live: WatchdogClient, children: Children) -> None:
    live.log("the card\nsees 1.2 V")
    assert children[0].next() == "note the card sees 1.2 V"


# -- a program that ends without closing it ------------------------------------------------------------------------------

PROGRAM = """
from drivers.watchdog.client import WatchdogClient
from drivers.watchdog.config import WatchdogConfig
client = WatchdogClient(WatchdogConfig("tests.helpers.watchdog_sources:RecordingSource", "", 0.2, options={"record": {!r}}))
client.arm()
print(client.pid, flush=True)
raise SystemExit(7)
"""


@pytest.mark.deep
def test_a_program_that_ends_in_mid_run_is_not_kept_alive_by_its_pulse(tmp_path: Path) -> None:
    """A thread that went on sending would tell the watchdog that all is well."""
    record = tmp_path / "calls.txt"
    code = PROGRAM.replace("{!r}", repr(str(record)))
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 7, ended.stderr
    wait(lambda: not psutil.pid_exists(int(ended.stdout)))
    assert record.read_text().split("\n") == ["stop", "ramp_to 2.5", "is_at_rest", ""]
