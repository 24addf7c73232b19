"""One trial of the fault search in a process of its own, on the virtual clock; the world outlives a program that is killed."""

import contextlib
import io
import json
import mmap
import os
import select
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import psutil

from app.session.bench_connection import BenchConnection, connect
from app.session.session import Session, SessionState
from drivers import Deadline, LinkError
from drivers.drive_shapes import Sine
from protocols import complete_results
from protocols.base import Event, Prompt, RunStatus, ShutdownStarted, SpecimenMounted
from protocols.registry import BUILT_IN_PROTOCOLS, PROTOCOLS
from protocols.runfile import repair_folder
from protocols.runfile.reader import Run
from protocols.runner.request import RunRequest
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.operator import SimulatedOperator
from sim_hardware.wires.in_process_link import InProcessLink
from tests.helpers.fault_matrix import TAKES_THE_DRIVE, protocol
from tests.helpers.fault_search.trial import LONGEST_S, SOURCES, Hazard, Trial, bench_file, drawn
from tests.helpers.fault_search.world import ErrorLog, Watch, World
from tests.helpers.front_panel import press
from tests.helpers.generators import BOXES
from tests.helpers.single_faults.points import decided, silent
from tests.helpers.single_faults.system_calls import Call, TracedChild
from tests.helpers.single_faults.wire_faults import scpi_faults

BLOCK_S = 0.2
TOO_LONG_S = 30.0
"""Real time without an event of the run, and without work of the process, after which a trial counts as one that does not end."""

WORK_S, ENDLESS_WORK_S = 0.1, 600.0
"""Processor time that counts as work, and longest real time without an event all the same."""

_TEXT = 12
"""Place of the facts in the shared memory, after their length and the count of events."""

STOPPED_S = 30.0
"""Longest bench time from Stop to the end of the run."""

ENDLESS_S = 900.0
"""Bench time after which Stop is pressed."""

LOSES = ("end", "silence", "garbage", "no memory", "stop")
"""Kinds of failures of a message after which the source has not received it."""

AFTERWARDS = {"frequencies_hz": (100.0,), "record_s": 0.05}
"""The sine dwell that must succeed afterwards."""


class Person:
    """Answers the prompts of a run (protocols.base.Operator) as one of OPERATORS.

    Args:
        odd_from: number of prompts after which the person is absent or unwilling.
    """

    def __init__(self, bench: SimulatedBench, kind: str, odd_from: int) -> None:
        self._bench, self._kind, self._normal = bench, kind, odd_from
        self._hands = SimulatedOperator(bench, patience_s=1.0)
        self._answers: dict[int, tuple[float, str]] = {}
        self.absent_s = float("inf")
        """Since when a prompt is not answered."""

    def clear_specimen(self, mountings: Sequence[SpecimenMounted] = (), cycles: float | None = None) -> None:
        if not self._bench.history.high_voltage_on:
            self._hands.clear_specimen(mountings, cycles)

    def show(self, ask_id: int, prompt: Prompt) -> None:
        self._normal -= 1
        odd, now_s = self._normal < 0, self._bench.clock.now()
        if self._kind == "forgetful" and prompt.action == "enable-high-voltage":
            self._answers[ask_id] = now_s, prompt.choices[0]
        elif self._kind == "unwilling" and odd and len(prompt.choices) > 1:
            self._answers[ask_id] = now_s, prompt.choices[-1]
        elif self._kind == "absent" and odd:
            self.absent_s = min(self.absent_s, now_s)
        else:
            self._hands.show(ask_id, prompt)
            if self._kind == "slow":
                self._answers[ask_id] = now_s + 2.0 * (7 * ask_id % 11), prompt.choices[0]

    def answer(self, ask_id: int) -> str | None:
        if ask_id not in self._answers:
            return self._hands.answer(ask_id)
        due_s, answer = self._answers[ask_id]
        return answer if self._bench.clock.now() >= due_s else None


@dataclass
class Hazards:
    """Lets the hazards of a trial happen, each at its tick; also the counter of the messages that fail (wire_faults.Counter)."""

    trial: Trial
    world: World
    ticks_without: int
    session: Session | None = None
    die: Any = None
    """Called where the program is killed, with the bench time until the next start."""
    ticks: int = 0
    kind: str = ""
    _count: int = 0
    active: bool = True
    _acting: bool = False
    _leaving: bool = False
    _due: dict[int, int] = field(default_factory=dict)
    """Tick at which each hazard that has begun ends."""
    stopped_s: float = float("inf")
    happened: list[str] = field(default_factory=list)

    def is_due(self, call: str) -> bool:
        """Count a message; return whether it fails."""
        if self._acting or not self.active:
            return False
        self.tick()
        self._count += 1
        failing = [
            hazard
            for k, hazard in enumerate(self.trial.hazards)
            if hazard.kind == "SCPI" and self.ticks < self._due.get(k, 0)
        ]
        self.kind = failing[0].what if failing else ""
        self.world.lost += self.kind in LOSES and "?" not in call
        return bool(failing)

    def __call__(self, event: Event) -> None:
        if not self._acting and self.active:
            self._leaving |= isinstance(event, ShutdownStarted)
            self.tick()

    def tick(self) -> None:
        self.ticks += 1
        for k, hazard in enumerate(self.trial.hazards):
            if hazard.kind == "file":
                continue
            begin = int(hazard.at * self.ticks_without)
            if k not in self._due and self.ticks >= begin:
                self._due[k] = self.ticks + hazard.lasts if hazard.lasts else sys.maxsize
                if self._is_too_late(hazard):
                    continue
                self.happened.append(f"{hazard.kind} {hazard.what}".strip())
                self._act(hazard)
            elif self._due.get(k) == self.ticks:
                self._end(hazard)
        if self.session is not None and self.world.now_s > ENDLESS_S:
            self.stop()

    def _is_too_late(self, hazard: Hazard) -> bool:
        """Whether the drive would be taken after the card has seen the last rest of the run, which nothing can report."""
        takes = hazard.kind in ("hand", "program") or hazard.what in TAKES_THE_DRIVE
        return takes and self._leaving and not self.world.live

    def stop(self) -> None:
        self.stopped_s = min(self.stopped_s, self.world.now_s)
        if self.session is not None:
            self.session.stop()

    def _act(self, hazard: Hazard) -> None:
        bench = self.world.bench
        self._acting = True
        try:
            match hazard.kind:
                case "bench" if hazard.what in TAKES_THE_DRIVE:
                    self.world.disturb(partial(bench.inject, hazard.what))
                case "bench":
                    bench.inject(hazard.what)
                case "hand":
                    self.world.disturb(partial(self._press, hazard.what))
                case "program":
                    self.world.disturb(partial(self._command, hazard.what))
                case "Stop":
                    self.stop()
                case "pause" if self.session is not None:
                    self.session.pause()
                case "delay":
                    bench.clock.sleep(hazard.seconds)
                case "kill" if self.die is not None:
                    self.die(hazard.seconds)
        finally:
            self._acting = False

    def _end(self, hazard: Hazard) -> None:
        self._acting = True
        try:
            if hazard.kind == "bench":
                self.world.disturb(partial(self.world.bench.clear, hazard.what))
            if hazard.kind == "pause" and self.session is not None:
                self.session.resume()
        finally:
            self._acting = False

    def _press(self, key: str) -> None:
        with contextlib.suppress(LinkError):
            press(self.world.bench.link(), key)

    def _command(self, what: str) -> None:
        """Let a second program command the source."""
        with contextlib.suppress(Exception):
            other = BOXES[self.trial.source](self.world.bench.link(), self.world.bench.clock)
            match what:
                case "arms":
                    other.initialize_at_rest(2.5, 0.0, 5.0)
                case "plays":
                    other.start_drive(Sine(170.0, 1.0, 2.5, 2000))
                case _:
                    other.ramp_to(1.5, 0.1)


@contextmanager
def opened(world: World, trial: Trial, person: Person) -> Iterator[BenchConnection]:
    """Open the program's bench on a world."""
    with (
        mock.patch("sim_hardware.SimulatedBench", return_value=world.bench),
        mock.patch("sim_hardware.VirtualClock", return_value=world.bench.clock),
        connect(bench_file(trial.source, trial.protocol), None, BLOCK_S) as connection,
    ):
        connection.bench.amplifier.holds_by_offset = trial.by_offset
        yield BenchConnection(connection.bench, person, connection.control)


@contextmanager
def watched_links(watch: "Watching") -> Iterator[None]:
    """Note the failures and the answers of the program's link."""
    check, timeout, read = InProcessLink._check_connected, InProcessLink._raise_timeout, InProcessLink.read

    def checked(link: Any) -> None:
        try:
            check(link)
        except LinkError:
            watch.failed()
            raise

    def raised(link: Any, reason: str) -> None:
        try:
            timeout(link, reason)
        finally:
            watch.failed()  # until the reply is overdue the program sees no failure

    def answered(link: Any) -> str:
        text = read(link)
        watch.answered()
        return text

    with (
        mock.patch.object(InProcessLink, "_check_connected", checked),
        mock.patch.object(InProcessLink, "_raise_timeout", raised),
        mock.patch.object(InProcessLink, "read", answered),
    ):
        yield


class Watching:
    """The watch of the present run, while no other hand acts."""

    def __init__(self, hazards: Hazards, beat: Callable[[], None]) -> None:
        self.watch: Watch | None = None
        self._hazards, self._beat = hazards, beat

    def failed(self) -> None:
        if self.watch is not None and not self._hazards._acting:
            self.watch.source_failed()

    def answered(self) -> None:
        if self.watch is not None and not self._hazards._acting:
            self.watch.source_answered()

    def __call__(self, event: Event) -> None:
        self._beat()
        if self.watch is not None:
            self.watch(event)


class Played:
    """The program on a world: the run of the trial, and the one afterwards."""

    def __init__(self, trial: Trial, ticks: int, folder: Path, tell: Any, beat: Callable[[], None]) -> None:
        self.trial, self.folder, self.tell = trial, folder, tell
        config = bench_file(trial.source, trial.protocol)
        self.world = World(SimulatedBench(config.simulation_parameters, VirtualClock()))
        self.world.bench.history.keeps_past = True
        self.hazards = Hazards(trial, self.world, ticks)
        self.watching = Watching(self.hazards, beat)
        self.log = ErrorLog()
        self.facts: dict[str, Any] = {"wrong": [], "acknowledged": [], "status": "", "ticks": 0, "happened": []}

    def play(self) -> None:
        """Play the trial; put the facts into shared memory as they come to be known."""
        import logging

        logging.getLogger().addHandler(self.log)
        trial = self.trial
        made = PROTOCOLS[trial.protocol](**trial.settings)
        self.hazards.die = self.die
        with scpi_faults(self.hazards), watched_links(self.watching):
            person = Person(self.world.bench, trial.operator, trial.seed % 5)
            session = self._session(person)
            watch = self._run(session, made, self.folder, person)
            self.hazards.active = False
            late_s = self.world.now_s - self.hazards.stopped_s
            wrong = [*watch.conclude(made.high_voltage), *self.world.wrong_volts(), *self.log.lines]
            if late_s > STOPPED_S:
                wrong.append(f"the run ended {late_s:.0f} s after Stop")
            self.note(watch, wrong)
            self.facts["wrong"] += self.usable(session, person)
            self.tell(self.facts)

    def note(self, watch: Watch, wrong: list[str], status: str = "") -> None:
        ended = watch.ended
        self.facts |= {
            "wrong": wrong,
            "acknowledged": watch.acknowledged,
            "status": status or (str(ended.status) if ended else "no bench"),
            "verdict": str(ended.verdict.outcome) if ended else "",
            "reason": ended.reason if ended else "",
            "ticks": self.hazards.ticks,
            "happened": self.hazards.happened,
        }
        self.tell(self.facts)

    @property
    def later_folder(self) -> Path:
        """Folder of the run afterwards: the same one, where its files do not belong to those that fail."""
        fails = any(hazard.kind == "file" for hazard in self.trial.hazards)
        return self.folder.parent / "afterwards" if fails else self.folder

    def _session(self, person: Person) -> Session:
        session = Session(
            partial(opened, self.world, self.trial, person), [self.watching, self.hazards], person, ends_at_stop=False
        )
        # Hazards of the opening find both, whichever thread is faster.
        self.hazards.session = session
        self.watching.watch = Watch(self.world, BLOCK_S)
        session.start()
        return session

    def _run(self, session: Session, made: Any, folder: Path, person: Person) -> Watch:
        self.watching.watch = watch = Watch(self.world, BLOCK_S)
        session.run(RunRequest(made, folder, "search"))
        while not session.finished.wait(0.05):
            if self.world.now_s - person.absent_s > LONGEST_S:
                self.hazards.stop()
        if watch.ended is None and session.outcome is not None:
            watch.ended = session.outcome
        return watch

    def usable(self, session: Session | None, person: Person) -> list[str]:
        """Return what is wrong with a bench whose faults have ended: a run must succeed, at most on a newly opened bench."""
        bench = self.world.bench
        if self.world.live:
            bench.disable_hv()  # as the operator was told
        bench.clear()
        if not bench.history.high_voltage_on:
            bench.perform_action("tidy-up", {})
        bench.clock.sleep(5.0)
        self.world.begin_part()
        made, reason = PROTOCOLS["sine-dwell"](**AFTERWARDS), ""
        person._kind, person.absent_s = "prompt", float("inf")
        for anew in (True,) if self.trial.reopens or session is None else (False, True):
            if anew:
                if session is not None:
                    session.close()
                session = self._session(person)
            assert session is not None
            watch = self._run(session, made, self.later_folder, person)
            if watch.ended is not None and watch.ended.status is RunStatus.COMPLETED:
                session.close()
                return [f"afterwards {each}" for each in (*watch.conclude(True), *self.world.wrong_volts())]
            reason = watch.ended.reason if watch.ended else "no run"
            if session.state is SessionState.IDLE:
                self.facts["reopened"] = reason
        session.close()
        return [f"the bench is not usable afterwards: {reason}"]

    def die(self, seconds: float) -> None:
        """Kill the program; its world stays in the memory of a copy, in which another program starts."""
        watch = self.watching.watch
        assert watch is not None
        self.note(watch, [*watch.wrong, *self.world.wrong_volts(), *self.log.lines], "killed")
        if copy := os.fork():
            self.tell({**self.facts, "copy": copy})
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.05)  # until the program is dead
        code = 70
        try:
            self.hazards.active = False
            self.facts["wrong"] += self.next_start(seconds)
            self.tell(self.facts)
            code = 0
        finally:
            os._exit(code)

    def next_start(self, seconds: float) -> list[str]:
        """Return what is wrong with the start of another program on the world."""
        bench = self.world.bench
        bench.clear()
        bench.clock.sleep(seconds)
        disturbed = self.world.disturbed is not None
        self.world.begin_part()
        person = Person(bench, "prompt", 0)
        session = self._session(person)
        watch = self._run(session, PROTOCOLS["sine-dwell"](**AFTERWARDS), self.later_folder, person)
        session.close()
        wrong = watch.conclude(True)
        if not disturbed:
            wrong += self.world.wrong_volts()
        if watch.ended is None or watch.ended.status is not RunStatus.COMPLETED:
            wrong.append(f"it did not succeed: {watch.ended.reason if watch.ended else 'no run'}")
        return [f"after the kill, the next start: {each}" for each in wrong]


@dataclass
class Result:
    """What became of a trial."""

    trial: Trial
    facts: dict[str, Any]
    seconds: float
    wrong: list[str]


class Search:
    """Plays trials in forked processes of a warm program.

    Args:
        place: a folder; the working directory is in it from then on.
    """

    def __init__(self, place: Path) -> None:
        self._place = place.resolve()
        for name in ("CACHE", "CONFIG", "DATA", "STATE"):
            os.environ[f"XDG_{name}_HOME"] = str(self._place / "home" / name.lower())
        for deadline in (Deadline.RUN_THREAD, Deadline.DISK, Deadline.STOPPED_RUN):
            deadline.seconds = 300.0  # a busy computer must not end a run
        self._shared = mmap.mmap(-1, 1 << 22)
        self._ticks: dict[str, int] = {}
        self._beat = b"", 0.0
        """The count of events that was seen last, and when it had changed."""
        self._worked = 0.0, 0.0
        """When the process was last seen at work, and its processor time then."""
        with silent():
            for name in BUILT_IN_PROTOCOLS:
                calm = Trial(0, SOURCES[0], False, name, protocol(name).model_dump(), "prompt", (), False)
                facts: dict[str, Any] = {}
                played = Played(calm, 1, self._place / "warm" / "new", facts.update, lambda: None)
                played.play()
                assert (facts["status"], facts["wrong"]) == ("completed", []), (name, facts)
                self._ticks[name] = facts["ticks"]
        for seed in range(50):
            drawn(seed)  # what is cached is computed once
        shutil.rmtree(self._place / "warm")

    def play(self, trial: Trial) -> Result:
        """Play a trial; return what followed."""
        folder = self._place / "trial" / "new"
        shutil.rmtree(folder.parent, ignore_errors=True)
        folder.mkdir(parents=True)
        self._shared[:_TEXT] = bytes(_TEXT)
        failed: list[str] = []
        files = [hazard for hazard in trial.hazards if hazard.kind == "file"]
        began_s = time.monotonic()
        self._beat, self._worked = (b"", began_s), (began_s, 0.0)
        readable, writable = os.pipe()
        child = TracedChild(
            partial(self._work, trial, folder, readable),
            (str(folder),) if files else (),
            partial(_decide, files, failed),
        )
        os.close(writable)
        code = None
        while code is None and self._goes_on(child.pid):
            code = child.serve(0.05)
        wrong: list[str] = []
        if code is None:
            child.release()
            child.kill()
            wrong.append(f"it did not end: {TOO_LONG_S:g} s without an event or work")
        child.close()
        facts = self._told()
        while code == -signal.SIGKILL and not select.select([readable], [], [], 0.05)[0]:  # a copy has the other end
            if not self._goes_on(facts["copy"]):
                wrong.append(f"the next start did not end: {TOO_LONG_S:g} s without an event")
                os.kill(facts["copy"], signal.SIGKILL)
                break
        os.close(readable)
        facts = self._told() or facts
        if code not in (0, None) and not (code == -signal.SIGKILL and facts.get("status") == "killed"):
            wrong.append(f"the process ended with {code}")
        facts["happened"] = [*facts.get("happened", []), *failed]
        wrong += facts.get("wrong", [])
        wrong += self._lost_points(folder, facts.get("acknowledged", []))
        return Result(trial, facts, time.monotonic() - began_s, wrong)

    def _work(self, trial: Trial, folder: Path, readable: int) -> int:
        os.close(readable)
        sys.stdout = sys.stderr = io.StringIO()
        Played(trial, round(1.1 * self._ticks[trial.protocol]), folder, self._tell, self._count_event).play()
        return 0

    def _goes_on(self, pid: int) -> bool:
        """Whether there was an event lately, or the process, which has to share a busy computer, is at work."""
        count, now_s = self._shared[4:_TEXT], time.monotonic()
        if count != self._beat[0]:
            self._beat = count, now_s
            self._worked = now_s, 0.0
        with contextlib.suppress(psutil.Error):
            times = psutil.Process(pid).cpu_times()
            if times.user + times.system > self._worked[1] + WORK_S:
                self._worked = now_s, times.user + times.system
        return now_s - self._worked[0] < TOO_LONG_S and now_s - self._beat[1] < ENDLESS_WORK_S

    def _told(self) -> dict[str, Any]:
        length = int.from_bytes(self._shared[:4], "little")
        return dict(json.loads(self._shared[_TEXT : _TEXT + length])) if length else {}

    def _count_event(self) -> None:
        count = int.from_bytes(self._shared[4:_TEXT], "little") + 1
        self._shared[4:_TEXT] = count.to_bytes(_TEXT - 4, "little")

    def _tell(self, facts: dict[str, Any]) -> None:
        text = json.dumps(facts).encode()
        self._shared[_TEXT : _TEXT + len(text)] = text
        self._shared[:4] = len(text).to_bytes(4, "little")

    def _lost_points(self, folder: Path, acknowledged: list[dict[str, float]]) -> list[str]:
        """Return what is wrong with the files: after the repair of the next start, every point that was shown is in one of them."""
        list(repair_folder(folder, complete_results))
        kept: list[dict[str, Any]] = []
        wrong = []
        for file in sorted(folder.glob("*.h5")):
            try:
                with Run(file) as run:
                    kept.append(run.points())
            except Exception as error:  # noqa: BLE001 - what cannot be opened is reported
                if acknowledged:
                    wrong.append(f"{file.name} cannot be opened: {error}")
        lost = (point for point in acknowledged if not any(_has(columns, point) for columns in kept))
        return [*wrong, *(f"a point that was shown is not in a file: {point}" for point in lost)]


def _has(columns: dict[str, Any], point: dict[str, float]) -> bool:
    import numpy as np

    shown = {name: value for name, value in point.items() if name in columns and columns[name].ndim == 1}
    same = [
        np.isclose(columns[name].astype(float), value, rtol=1e-6, atol=0, equal_nan=True)
        for name, value in shown.items()
    ]
    return bool(same) and bool(np.logical_and.reduce(same).any())


def _decide(files: list[Hazard], failed: list[str], number: int, call: Call) -> object:
    for hazard in files:
        if number == int(hazard.at):
            failed.append(f"file {hazard.what}")
            return decided(hazard.what, call)
    return None
