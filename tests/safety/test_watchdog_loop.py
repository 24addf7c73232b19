"""Watchdog process in this process, with pipes and a clock of the test: every line it reads, sends, logs and commands."""

import io
import json
import os
import queue
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from drivers.bench.drive_limits import DriveLimits
from drivers.drive_shapes import LevelPulse
from drivers.errors import InstrumentError, LinkError
from drivers.interfaces import Identity
from drivers.watchdog import process
from drivers.watchdog.config import WatchdogConfig
from drivers.watchdog.hang_detection import Silence
from drivers.watchdog.log import LOG_NAME
from drivers.watchdog.origin import describe_copy
from tests.helpers.waiting import wait_until

LONG_S = 30.0
"""Longest wait for something that happens at once, on a computer with other work."""

PROGRAM_PID = 4242


class Source:
    """A source of this process: `calls` of all its instances, `errors` that the next attempts to stop raise."""

    identity = Identity("Test", "source")
    calls: list[str]
    errors: list[Exception]
    rests: list[bool]

    def __init__(self, *link: object, clock: object = None, name: str = "source") -> None:
        self.calls.append(f"opened {name}" + ("" if not link else " by a link"))

    def stop(self) -> None:
        self.calls.append("stop")
        if self.errors:
            raise self.errors.pop(0)

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        self.calls.append(f"ramp to {level_v:g} in {duration_s:g} s")

    def idle_level_v(self) -> float:
        return 4.0

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        self.calls.append(f"at rest? {rest_v:g} {low_v:g} {high_v:g}")
        return self.rests.pop(0) if self.rests else True

    def reconnect(self) -> None:
        self.calls.append("reconnect")

    def close(self) -> None:
        self.calls.append("close")

    def start_drive(self, drive: object) -> None: ...

    def initialize_at_rest(self, *_: float) -> None: ...


REST = ["stop", "ramp to 2.5 in 0.15 s", "at rest? 2.5 0 5"]
CONFIG = WatchdogConfig(f"{__name__}:Source", "", 0.2, options={"name": "it"}, patience_s=1.0, silence_s=0.4)


class Output:
    """Standard output of the watchdog: a line arrives when it is flushed."""

    def __init__(self, lines: "queue.SimpleQueue[str]") -> None:
        self._lines, self._written = lines, ""

    def write(self, text: str) -> None:
        self._written += text

    def flush(self) -> None:
        for line in self._written.splitlines():
            self._lines.put(line)
        self._written = ""


class Loop:
    """A watchdog on a thread of this process. Its time advances where the test says so, and where it sleeps."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, config: WatchdogConfig) -> None:
        self.folder, self.now_s, self.slept = folder, 50.0, 0
        self.per_reading_s = 0.0
        self.said_in_sleep = ""
        self.killed: list[tuple[int, int]] = []
        self.exits: list[int] = []
        self.turns = threading.Condition()
        self.turn, self.ended = 0, False
        Source.calls, Source.errors, Source.rests = [], [], []
        self.calls = Source.calls
        program_end, self._commands = os.pipe()
        self.stderr = io.StringIO()
        self._to = os.fdopen(self._commands, "w", buffering=1)
        self.lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._stdin = os.fdopen(program_end)
        self._said = self._taken = 0
        fake_sys = SimpleNamespace(stdin=self._said_lines(), stdout=Output(self.lines), stderr=self.stderr)
        for name in ("POLL_PERIOD_S", "REST_PERIOD_S"):
            monkeypatch.setattr(process, name, 0.002)
        monkeypatch.setattr(process, "sys", fake_sys)
        monkeypatch.setattr(process, "time", SimpleNamespace(monotonic=self._monotonic, sleep=self._sleep))
        monkeypatch.setattr(process, "ProcessActivity", self._activity)
        monkeypatch.setattr(process.importlib, "import_module", lambda _: SimpleNamespace(Source=Source))
        fake_os = SimpleNamespace(getppid=lambda: PROGRAM_PID, kill=self._kill, _exit=self.exits.append)
        monkeypatch.setattr(process, "os", fake_os)
        before = set(threading.enumerate())
        self.thread = threading.Thread(target=self._run, args=(config,), daemon=True)
        self.thread.start()
        self.settle()
        self.threads = set(threading.enumerate()) - before

    # what the loop sees of its computer

    def _monotonic(self) -> float:
        self.now_s += self.per_reading_s
        return self.now_s

    def _sleep(self, seconds: float) -> None:
        self.slept += 1
        self.now_s += seconds
        if self.said_in_sleep:
            self._to.write(self.said_in_sleep + "\n")
            assert self.watchdog._program_acts.wait(LONG_S)

    def _kill(self, pid: int, number: int) -> None:
        self.killed.append((pid, number))
        if self.per_reading_s == 0.0:  # else it cannot be killed
            self._to.close()

    def _activity(self, pid: int) -> Any:
        assert pid == PROGRAM_PID

        def update() -> None:
            with self.turns:
                self.turn += 1
                self.turns.notify_all()

        return SimpleNamespace(
            mark=lambda: Silence(self.now_s, self.now_s),
            since=lambda mark: Silence(self.now_s - mark.elapsed_s, self.now_s - mark.available_s),
            update=update,
        )

    def _run(self, config: WatchdogConfig) -> None:
        try:
            self.watchdog = process.WatchdogLoop(config)
            self.watchdog.run()
        finally:
            self.lines.put("(end)")
            with self.turns:
                self.ended = True
                self.turns.notify_all()

    def _said_lines(self) -> Iterator[str]:
        """Yield the lines of the program, and count those that the loop's reader has passed on."""
        for line in self._stdin:
            yield line
            with self.turns:
                self._taken += 1
                self.turns.notify_all()

    # what the test does

    def say(self, *lines: str) -> None:
        for line in lines:
            self._said += 1
            self._to.write(line + "\n")
        self.settle()

    def settle(self) -> None:
        """Wait until the loop has read what was said and has then looked at its clock."""
        with self.turns:
            assert self.turns.wait_for(lambda: self._taken >= self._said or self.ended, LONG_S)
            until = self.turn + 8
            assert self.turns.wait_for(lambda: self.turn >= until or self.ended, LONG_S)

    def pass_time(self, seconds: float) -> None:
        self.now_s += seconds
        self.settle()

    def next(self) -> str:
        return self.lines.get(timeout=LONG_S)

    def heard(self) -> list[str]:
        heard = []
        while not self.lines.empty():
            heard.append(self.lines.get())
        return heard

    def close_pipe(self) -> None:
        self._to.close()
        self.thread.join(LONG_S)
        assert not self.thread.is_alive()

    def end(self) -> None:
        Source.errors.clear()
        self._to.close()
        for thread in self.threads:
            thread.join(LONG_S)
        self._stdin.close()

    @property
    def log(self) -> list[str]:
        file = self.folder / LOG_NAME
        return [line.split("  ", 1)[1] for line in file.read_text().splitlines()] if file.exists() else []


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Loop]]:
    loops: list[Loop] = []

    def make(config: WatchdogConfig = CONFIG) -> Loop:
        loops.append(Loop(tmp_path, monkeypatch, config))
        return loops[-1]

    yield make
    for loop in loops:
        loop.end()


def ready(start: Callable[..., Loop], config: WatchdogConfig = CONFIG) -> Loop:
    loop = start(config)
    assert loop.next() == f"ready {describe_copy()}"
    loop.say(f"log {loop.folder}")
    return loop


FROZEN = "the program was frozen: it sent nothing for {} s"
DONE = "The source was brought to rest in {} s and reports that it idles at 2.5 V (not measured)"


# -- while live ----------------------------------------------------------------------------------------------------------


def test_silence_brings_the_source_to_rest_once_after_exactly_what_was_allowed(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    assert loop.calls == ["opened it"]  # before anything can fail
    loop.pass_time(100.0)  # not live: silence means nothing
    loop.say("live")
    loop.pass_time(0.2)
    loop.pass_time(0.19)
    assert loop.calls == ["opened it"]
    loop.pass_time(0.03)
    assert loop.calls[1:] == REST
    assert [line for line in loop.heard() if line != "tick"] == [
        f"acting {FROZEN.format('0.42')}",
        f"done {DONE.format('0.00')}",
    ]
    assert loop.log == [f"{FROZEN.format('0.42')}. {DONE.format('0.00')}"]
    assert loop.stderr.getvalue() == f"tactor-bench watchdog: {loop.log[0]}\n"
    loop.pass_time(100.0)
    assert loop.calls[1:] == REST
    assert loop.heard() == []
    loop.say("live")  # for the next run
    loop.pass_time(0.5)
    assert loop.calls[1:] == REST * 2


def test_a_pulse_without_heartbeats_is_a_hanging_run_thread(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    loop.say("live")
    for _ in range(3):
        loop.pass_time(0.12)
        loop.say("pulse")
    assert loop.calls == ["opened it"]
    loop.pass_time(0.06)
    assert "acting the thread that reads the card sent nothing for 0.42 s" in loop.heard()
    assert loop.calls[1:] == REST


def test_a_heartbeat_says_how_long_the_next_one_may_take(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    loop.say("live", "beat 3.000")
    for _ in range(9):
        loop.pass_time(0.3)
        loop.say("pulse")
    assert loop.calls == ["opened it"]
    loop.say("beat 0.400")
    loop.pass_time(0.39)
    loop.say("pulse")
    assert loop.calls == ["opened it"]
    loop.pass_time(0.02)
    assert loop.calls[1:] == REST
    loop.say("live")  # what was allowed before counts no more
    loop.pass_time(0.41)
    assert loop.calls[1:] == REST * 2


def test_a_frozen_program_is_noticed_by_its_pulse_whatever_silence_its_run_thread_was_allowed(
    start: Callable[..., Loop],
) -> None:
    loop = ready(start)
    loop.say("live", "beat 9.000", "pulse")
    loop.pass_time(0.39)
    assert loop.calls == ["opened it"]
    loop.pass_time(0.02)
    assert loop.calls[1:] == REST


LEVEL = json.dumps({"level_v": 4.0, "rest_v": 2.5, "rise_s": 0.3, "hold_s": 6.0, "remaining_s": 5.0})


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("lines", "is_adopted"),
    [
        (["live", f"level {LEVEL}"], True),
        (["live", f"level {LEVEL}", "level"], False),
        (["live", f"level {LEVEL}", "live"], False),
    ],
)
def test_a_level_is_hastened_until_it_is_forgotten_or_another_run_begins(
    start: Callable[..., Loop], lines: list[str], is_adopted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def adopt(source: Source, pulse: LevelPulse, end_s: float) -> None:
        source.calls.append(f"adopt {pulse.level_v:g} V until {end_s:g}")

    monkeypatch.setattr(Source, "adopt_level", adopt, raising=False)
    loop = ready(start)
    loop.say(*lines)
    loop.pass_time(0.42)
    adopted = [call for call in loop.calls if call.startswith("adopt")]
    assert loop.calls[1:] == [*adopted, *REST]
    assert len(adopted) == is_adopted
    assert not adopted or adopted[0].startswith("adopt 4 V until ")


def test_after_rest_nothing_is_watched(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    loop.say("live", "rest")
    loop.heard()
    loop.pass_time(100.0)
    assert (loop.calls, loop.heard(), loop.log) == (["opened it"], [], [])


def test_it_reports_four_times_a_second_while_live_only(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    loop.pass_time(1.0)
    assert loop.heard() == []
    loop.say("live")
    loop.heard()
    for _ in range(3):
        loop.say("beat 9.000", "pulse")
        loop.pass_time(0.2)
        assert loop.heard() == []
        loop.pass_time(0.06)
        assert loop.heard() == ["tick"]


# -- the end of the program ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("took_over", [False, True])
def test_a_program_that_ends_while_live_is_followed_by_rest(start: Callable[..., Loop], took_over: bool) -> None:
    loop = ready(start)
    loop.say("live")
    if took_over:
        loop.pass_time(0.5)
    loop.close_pipe()
    assert loop.calls[1:] == REST * (2 if took_over else 1)
    assert loop.log[-1] == f"the program ended without a word while the bench was live. {DONE.format('0.00')}"


def test_a_program_that_ends_at_rest_is_a_line_in_the_log(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    loop.say("live", "rest")
    loop.close_pipe()
    assert loop.calls == ["opened it"]
    assert loop.log == ["the program ended without a word; the source was at rest, nothing was to be done"]
    assert loop.stderr.getvalue() == f"tactor-bench watchdog: {loop.log[0]}\n"


def test_a_program_that_measured_rest_after_a_takeover_ends_at_rest(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    loop.say("live")
    loop.pass_time(0.5)
    loop.say("rest")
    loop.heard()
    loop.close_pipe()
    assert loop.calls[1:] == REST


def test_a_program_that_takes_its_leave_is_not(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    loop.say("live", "rest", "bye")
    loop.thread.join(LONG_S)
    assert not loop.thread.is_alive()
    assert (loop.calls, loop.log, loop.stderr.getvalue()) == (["opened it"], [], "")


# -- requests ------------------------------------------------------------------------------------------------------------


def test_help_is_given_at_once_and_told_to_the_program_alone(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    loop.say("help no answer to 'VOLT?'")
    reason = "the program could not, and requested it: no answer to 'VOLT?'"
    assert loop.heard() == [f"acting {reason}", f"done {DONE.format('0.00')}"]
    assert loop.calls[1:] == REST
    assert loop.log == [f"{reason}. {DONE.format('0.00')}"]
    assert loop.stderr.getvalue() == ""  # the program reports it


def test_help_is_tried_for_two_seconds(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    Source.errors += [LinkError(f"error {i}") for i in range(40)]
    loop.say("help me")
    assert loop.next().startswith("acting ")
    assert loop.next() == "failing"
    assert loop.next() == (
        "could-not The source could NOT be brought to rest within 2 s: error 0. Switch the high voltage OFF at the amplifier "
        "itself before anybody touches the specimen"
    )
    assert loop.slept == 9  # a quarter of a second each
    assert loop.log[0].startswith(
        "the program could not, and requested it: me. The source could NOT be brought to rest"
    )


def test_a_note_goes_into_the_log_alone(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    loop.say("note the program could not confirm rest: 1.2 V")
    assert wait_until(lambda: bool(loop.log))
    assert loop.log == ["the program could not confirm rest: 1.2 V"]
    assert (loop.stderr.getvalue(), loop.heard(), loop.calls) == ("", [], ["opened it"])


# -- a source that does not obey -----------------------------------------------------------------------------------------


def test_it_tries_again_over_a_new_connection_until_the_source_obeys(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    Source.errors += [LinkError("cut"), InstrumentError("refused"), ValueError("a driver's own")]
    loop.say("live")
    loop.close_pipe()
    failed = ["stop", "ramp to 2.5 in 0.15 s"]
    assert loop.calls[1:] == [*failed, *["reconnect", *failed] * 2, "reconnect", *REST]
    assert loop.slept == 3
    assert loop.log[-1].endswith(DONE.format("0.75"))


def test_it_gives_up_after_its_patience_and_names_the_first_failure(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    Source.errors += [LinkError(f"error {i}") for i in range(40)]
    loop.say("live")
    loop.close_pipe()
    assert "within 1 s: error 0. Switch the high voltage OFF at the amplifier itself" in loop.log[-1]
    assert loop.slept == 5
    assert len(loop.log) == 2  # also when it begins to try: nothing else warns of the specimen meanwhile
    assert (
        "The specimen may be live: the source does not obey: error 0. The watchdog tries again for 1 s" in loop.log[0]
    )
    assert loop.stderr.getvalue() == "".join(f"tactor-bench watchdog: {line}\n" for line in loop.log)
    assert any(line.startswith("could-not ") for line in loop.heard())


def test_a_program_that_runs_again_takes_the_source_back_after_a_failed_attempt_and_is_watched(
    start: Callable[..., Loop],
) -> None:
    loop = ready(start)
    Source.errors += [LinkError(f"error {i}") for i in range(3)]
    loop.say("live")
    loop.said_in_sleep = "mine"
    loop.pass_time(0.5)
    heard = [loop.next() for _ in range(3)]
    assert [line.partition(" ")[0] for line in heard] == ["acting", "failing", "could-not"]
    assert (loop.slept, len(Source.errors)) == (1, 2)
    loop.settle()
    loop.said_in_sleep, Source.errors[:] = "", []
    loop.pass_time(0.5)  # the program is silent again
    heard = [line for line in (loop.next(), loop.next(), loop.next()) if line != "tick"]
    assert [line.partition(" ")[0] for line in heard[:2]] == ["acting", "done"]


def test_a_source_that_obeys_but_does_not_rest_is_tried_again(start: Callable[..., Loop]) -> None:
    loop = ready(start)
    Source.rests += [False, True]
    loop.say("live")
    loop.close_pipe()
    assert loop.calls[1:] == [*REST, "reconnect", *REST]
    assert loop.log[-1].endswith(DONE.format("0.25"))


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("ramp_v_per_s", "took_s"), [(2.0, 0.15), (5.0, 0.15), (30.0, 0.05)])
def test_its_ramp_is_ten_volts_per_second_or_that_of_the_bench_where_it_is_faster(
    start: Callable[..., Loop], ramp_v_per_s: float, took_s: float
) -> None:
    loop = ready(start, replace(CONFIG, limits=DriveLimits(ramp_v_per_s=ramp_v_per_s)))
    loop.say("live")
    loop.close_pipe()
    assert loop.calls[2] == f"ramp to 2.5 in {took_s:g} s"


# -- one connection for both ---------------------------------------------------------------------------------------------

SHARED = replace(CONFIG, own_connection=False)


def test_a_hanging_program_that_holds_the_only_connection_is_killed_before_it_is_opened(
    start: Callable[..., Loop],
) -> None:
    loop = ready(start, SHARED)
    assert loop.calls == []
    loop.say("help me")
    assert loop.heard() == ["could-not the watchdog has no separate connection while the program runs"]
    loop.say("live")
    assert loop.killed == []
    loop.now_s += 0.5
    loop.thread.join(LONG_S)
    assert not loop.thread.is_alive()
    assert loop.killed == [(PROGRAM_PID, signal.SIGKILL)]
    assert loop.calls == ["opened it", *REST]
    assert loop.log == [f"{FROZEN.format('0.50')}. {DONE.format('0.00')}"]


def test_a_program_that_cannot_be_killed_is_waited_for_a_second(start: Callable[..., Loop]) -> None:
    loop = ready(start, SHARED)
    loop.say("live")
    loop.per_reading_s = 0.1
    loop.now_s += 0.5
    begin_s = loop.now_s
    loop.thread.join(LONG_S)
    assert not loop.thread.is_alive()
    assert loop.killed == [(PROGRAM_PID, signal.SIGKILL)]
    assert loop.calls == ["opened it", *REST]
    assert 1.0 < loop.now_s - begin_s < 3.0


def test_the_only_connection_is_opened_anew_for_every_attempt(start: Callable[..., Loop]) -> None:
    loop = ready(start, SHARED)
    Source.errors += [LinkError("cut"), LinkError("cut")]
    loop.say("live")
    loop.close_pipe()
    failed = ["stop", "ramp to 2.5 in 0.15 s", "close"]
    attempts = [call for call in loop.calls if call != "reconnect"]
    assert attempts == [*["opened it", *failed] * 2, "opened it", *REST]


# -- start ---------------------------------------------------------------------------------------------------------------


class Link:
    """A connection as the watchdog opens it."""

    made: list["Link"]

    def __init__(self, resource: str, timeout_s: float, backend: str, *, baud: int, lock_key: str) -> None:
        self.arguments, self.closed = (resource, timeout_s, backend, baud, lock_key), False
        self.made.append(self)

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def links(monkeypatch: pytest.MonkeyPatch) -> list[Link]:
    Link.made = []
    monkeypatch.setattr("drivers.transport.VisaLink", Link)
    return Link.made


def test_a_source_with_a_resource_is_opened_by_a_link(start: Callable[..., Loop], links: list[Link]) -> None:
    loop = ready(start, replace(CONFIG, resource="ASRL9::INSTR", backend="@ivi", baud=19200, lock_key="k"))
    assert [link.arguments for link in links] == [("ASRL9::INSTR", 0.2, "@ivi", 19200, "k")]
    assert loop.calls == ["opened it by a link"]
    assert not links[0].closed


def test_a_source_that_cannot_be_opened_is_reported_and_its_link_closed(
    start: Callable[..., Loop], links: list[Link], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(*_: object, **__: object) -> None:
        raise InstrumentError("it is another model")

    monkeypatch.setattr(Source, "__init__", refuses)
    loop = start(replace(CONFIG, resource="ASRL9::INSTR"))
    assert loop.next() == "failed it is another model"
    assert loop.next() == "(end)"
    assert links[0].closed


def test_a_lock_that_another_watchdog_holds_is_reported(
    start: Callable[..., Loop], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[object] = []

    def held(files: object) -> None:
        asked.append(files)
        raise InstrumentError("another watchdog holds it; end it first")

    monkeypatch.setattr(process, "lock_as_watchdog", held)
    loop = start(replace(CONFIG, locks=("a.lock",)))
    assert loop.next() == "failed another watchdog holds it; end it first"
    assert (loop.calls, asked) == ([], [("a.lock",)])


@pytest.mark.parametrize("line", ["", CONFIG.as_line() + "\n"])
def test_the_process_ignores_the_terminal_and_ends_with_its_input(
    start: Callable[..., Loop], monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    loop = ready(start)
    loop.close_pipe()
    ignored: dict[int, object] = {}
    ran: list[object] = []
    fake = SimpleNamespace(
        **{name: getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP", "SIGPIPE")},
        SIG_IGN=signal.SIG_IGN,
        signal=ignored.__setitem__,
    )
    monkeypatch.setattr(process, "signal", fake)
    monkeypatch.setattr(process, "raise_own_priority", lambda: ran.append("first of all programs"))
    monkeypatch.setattr(
        process, "WatchdogLoop", lambda config: SimpleNamespace(run=lambda: ran.append(config.as_line() + "\n"))
    )
    process.sys.stdin = io.StringIO(line)  # type: ignore[attr-defined]
    process.main()
    assert set(ignored) == {signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP, signal.SIGPIPE}
    assert set(ignored.values()) == {signal.SIG_IGN}
    assert ran == ["first of all programs", *([line] if line else [])]
    assert loop.exits == [0]
