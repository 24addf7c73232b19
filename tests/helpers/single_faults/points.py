"""Single faults by enumeration: every system call on a file, and every message on a simulated wire, fails once in each way.

A point is one operation of the program in a forked process of its own, on the virtual clock, in which one call fails. What must hold is
judged from the simulated world's voltages and the bytes on the disk. Used by the test and by `docs/make_single_faults.py`.
"""

import contextlib
import errno
import gc
import io
import json
import math
import mmap
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

from sim_hardware.testing.safe_volts import STEP_V
from tests.helpers.single_faults.system_calls import READS, WRITES, Call, TracedChild

KINDS = ("error", "end", "silence", "delay", "garbage", "no memory", "stop")

WAYS = {
    "file": {
        "error": "EIO: the disk reports an error",
        "end": "a write: ENOSPC, the disk is full; a read: the file ends here",
        "silence": "the call does not return",
        "delay": "the call returns 0.3 s later",
        "garbage": "a read returns other bytes",
        "no memory": "ENOMEM",
    },
    "SCPI": {
        "error": "the connection is closed",
        "end": "the reply ends in its middle; a message without a reply is lost",
        "silence": "no reply; every second message is not carried out either",
        "delay": "the reply comes 4 s later",
        "garbage": "the reply is not text; a message without a reply arrives as other bytes",
        "no memory": "MemoryError in the driver's call",
        "stop": "no message passes from here on, on no connection; the program's own deadlines",
    },
    "card": {
        "error": "NI's error -50808: the transfer failed",
        "end": "the server ends the call: UNAVAILABLE",
        "silence": "no reply",
        "delay": "the reply comes 0.2 s later",
        "garbage": "the reply has other numbers",
        "no memory": "the server has no memory: RESOURCE_EXHAUSTED",
        "stop": "no call is answered from here on, on no connection; the program's own deadlines",
    },
    "serial": {
        "error": "the line is closed",
        "end": "the reply ends in its middle",
        "silence": "no reply",
        "delay": "the reply comes after the driver's timeout",
        "garbage": "the reply is not text",
        "no memory": "MemoryError in the driver's call",
    },
}

TOO_LONG_S = float(os.environ.get("TOO_LONG_S", "30"))
INTERRUPTED_S = 2.0
"""Ctrl-C ends what is not live and waits for a silent disk within this time."""

NOT_LIVE_S, FROZEN_S = 1.2, 4.0
"""Ctrl-C is pressed so long after the disk fell silent, and the disk answers again so long after that."""

SHORT = {
    "DISK": 0.6,
    "BENCH_CLOSING": 2.0,
    "RUN_THREAD": 2.0,
    "CARD_SERVER": 0.6,
    "CARD_BLOCK": 0.4,
    "CARD_OUTPUT": 0.4,
}
SHORT |= {"WAY_TO_REST": 1.0}
"""Deadlines in these processes, s: what follows is the same, sooner."""

RUN = ("--set", "frequencies_hz=100", "--set", "record_s=0.05")


@dataclass(frozen=True, slots=True)
class Operation:
    """What the program does, and which of its calls fail.

    Attributes:
        arguments: of the command; FILE is the run in the folder `runs`.
        boundary: whose calls are counted.
        bench: text of a bench file `bench.toml`.
        card: whether the card is read over gRPC.
        repeat: whether the command must succeed when it is repeated after the fault.
    """

    name: str
    arguments: tuple[str, ...]
    boundary: str = "file"
    bench: str = ""
    card: bool = False
    repeat: bool = True


SIM = ("--bench", "sim", "--speed", "max")
ON_CARD = """name = "card output"
driver = "simulated"
[source]
kind = "card-output"
"""

OPERATIONS = {
    each.name: each
    for each in (
        Operation("run", (*SIM, "--out", "new", "run", "sine-dwell", *RUN)),
        Operation("campaign item", (*SIM, "--out", "campaign", "--specimen", "C", "campaign", "run")),
        Operation(
            "identify --accept",
            (
                "identify",
                "--accept",
                "--by",
                "me",
                "--free",
                "c0,mu",
                "--shapes",
                "4",
                "--plain",
                "--reason",
                "no matter here",
                "FILE",
            ),
        ),
        Operation("backup", ("backup", "--folder", "runs", "copy")),
        Operation("report", ("report", "unnamed", "--folder", "runs", "--out", "report")),
        Operation("run: generator", (*SIM, "--out", "new", "run", "sine-dwell", *RUN), "SCPI"),
        Operation("run: card", (*SIM, "--out", "new", "run", "sine-dwell", *RUN), "card", card=True),
    )
}


@dataclass(frozen=True, slots=True)
class Point:
    """One call of an operation, and how it fails."""

    operation: str
    number: int
    kind: str


@dataclass
class Outcome:
    """What became of an operation in which a call failed."""

    point: Point
    call: str = ""
    code: int | None = None
    seconds: float = 0.0
    facts: dict[str, Any] = field(default_factory=dict)
    text: str = ""
    interrupted_s: float | None = None
    frozen: bool = False
    """Whether HDF5 waited for the disk with Python's lock held, while nothing was live: Ctrl-C has no effect then."""
    repeated: int | None = None
    broken: list[str] = field(default_factory=list)
    """What does not hold of the files."""

    @property
    def faults(self) -> list[str]:
        """What the program owes and did not keep; empty where all is well."""
        wrong, facts = list(self.broken), self.facts
        if self.code is None:
            return [*wrong, f"it did not end within {TOO_LONG_S:g} s"]
        if self.interrupted_s is not None and self.interrupted_s > 2 * INTERRUPTED_S and not self.frozen:
            wrong.append(f"Ctrl-C took {self.interrupted_s:.1f} s")
        if self.code not in (0, 1, 2, 3, 4):
            wrong.append(f"exit code {self.code}")
        if any(words in self.text for words in ("Traceback", "an error of this program")):
            wrong.append("an error of the program")
        volts = facts.get("volts")
        if volts is not None:
            if volts["largest_jump_v"] > STEP_V + 1e-6:
                wrong.append(f"a jump of {volts['largest_jump_v']:.3f} V")
            if volts["lowest_v"] < -1e-9 or volts["highest_v"] > 5 + 1e-9:
                wrong.append(f"the input left its range: {volts['lowest_v']:.3f} to {volts['highest_v']:.3f} V")
            at_rest = volts["ends_at_rest"] or volts["live_s"] == 0
            if not at_rest and self.code != 3:
                wrong.append(f"the input is at {volts['end_v']:.3f} V, exit code {self.code}")
            if not at_rest and not facts.get("warned"):
                wrong.append(f"the input is at {volts['end_v']:.3f} V and nobody was warned")
            if facts.get("rest") and abs(volts["end_v"] - 2.5) > 0.02:
                wrong.append("rest was confirmed while the input was not at rest")
        if facts.get("acknowledged", 0) > facts.get("kept", 0):
            wrong.append(f"{facts['acknowledged']} points were shown and {facts['kept']} are in the file")
        if self.repeated not in (None, 0):
            wrong.append(f"repeated, it ends with exit code {self.repeated}")
        return wrong


class Laboratory:
    """A folder with a run, a campaign and caches, of which each point has a copy; and the program, imported and warm.

    Args:
        place: of the folder; the working directory is in it from then on.
    """

    def __init__(self, place: Path) -> None:
        self.home, self._template = place / "home", place / "template"
        self.home.mkdir(parents=True)
        for name in ("CACHE", "CONFIG", "DATA", "STATE"):
            os.environ[f"XDG_{name}_HOME"] = str(self.home / name.lower())
        os.chdir(self.home)
        with silent():
            from app.cli.main import main

            self._main = main
            assert (
                main([*SIM, "--out", "runs", "run", "sine-dwell", "--set", "frequencies_hz=100,120,140,160,180,200"])
                == 0
            )
            assert main([*SIM, "--out", "campaign", "--specimen", "C", "campaign", "new"]) == 0
        (self.home / "card-output.toml").write_text(ON_CARD)
        shutil.copytree(self.home, self._template)
        for operation in OPERATIONS.values():  # what is imported late is imported now
            if operation.boundary == "file":
                with silent():
                    main(self.arguments(operation))
                self.restore()
        gc.collect()
        gc.freeze()

    def restore(self) -> None:
        """Put the folder back as it was before the first point."""
        os.chdir("/")
        shutil.rmtree(self.home)
        shutil.copytree(self._template, self.home)
        os.chdir(self.home)

    def arguments(self, operation: Operation) -> list[str]:
        (file,) = Path("runs").glob("*.h5")
        return [str(file) if word == "FILE" else word for word in operation.arguments]

    def count(self, name: str) -> list[str]:
        """Return the calls of an operation in which nothing fails."""
        seen: list[str] = []
        outcome = self._run(Point(name, -1, "error"), seen)
        assert outcome.code == 0, outcome.text
        return seen

    def run(self, point: Point) -> Outcome:
        """Let one call fail; return what followed."""
        return self._run(point, [])

    def _run(self, point: Point, seen: list[str]) -> Outcome:
        operation = OPERATIONS[point.operation]
        outcome = Outcome(point)
        files = _hashes(self.home / "runs")
        shared = mmap.mmap(-1, 1 << 16)
        """First whether the bench is live, then the facts as JSON."""
        began_s = time.monotonic()
        with (self.home.parent / "said").open("w+b") as said:
            child = TracedChild(
                partial(_work, self._main, self.arguments(operation), operation, point, shared, said.fileno()),
                (str(self.home),),
                partial(_decide, operation, point, outcome, seen),
            )
            try:
                outcome.code = self._serve(child, shared, outcome)
            finally:
                child.close()
            said.seek(0)
            outcome.text = said.read().decode(errors="replace")
        outcome.seconds = time.monotonic() - began_s
        length = int.from_bytes(shared[1:5], "little")
        outcome.facts = json.loads(shared[5 : 5 + length]) if length else {}
        outcome.call = outcome.facts.get("call", outcome.call)
        seen += outcome.facts.get("calls", [])
        if point.number >= 0:
            self._look_at_files(operation, outcome, files)
        self.restore()
        return outcome

    def _serve(self, child: TracedChild, shared: mmap.mmap, outcome: Outcome) -> int | None:
        """Answer the child's calls to its end; press Ctrl-C where it waits for a silent disk and nothing is live."""
        until_s, held_s, pressed_s = time.monotonic() + TOO_LONG_S, math.inf, math.inf
        while time.monotonic() < until_s:
            code = child.serve(0.25)
            now_s = time.monotonic()
            if code is not None:
                outcome.interrupted_s = now_s - pressed_s if pressed_s < now_s else None
                return code
            if not child.held or shared[0] != 0:
                continue
            held_s = min(held_s, now_s)
            if pressed_s > now_s and now_s - held_s > NOT_LIVE_S:
                pressed_s = now_s
                os.kill(child.pid, signal.SIGINT)
            if now_s - pressed_s > FROZEN_S:
                outcome.frozen = True  # the interpreter is: what it owes, it owes when the disk answers again
                child.release()
        child.kill()
        return None

    def _look_at_files(self, operation: Operation, outcome: Outcome, before: dict[str, str]) -> None:
        from protocols import complete_results
        from protocols.runfile import repair_folder
        from protocols.runfile.reader import Run

        for name, was in before.items():
            if name.endswith(".h5") and _hashes(self.home / "runs").get(name) != was:
                outcome.broken.append(f"{name} was changed")
        kept = 0
        for folder in ("new", "campaign"):
            path = self.home / folder
            if path.is_dir():
                list(repair_folder(path, complete_results))
                for file in path.glob("*.h5"):
                    try:
                        with Run(file) as run:
                            kept = max(kept, run.record.point_count)
                    except Exception as error:  # noqa: BLE001 - what cannot be opened is reported
                        if outcome.facts.get("acknowledged"):
                            outcome.broken.append(f"{file.name} cannot be opened: {error}")
        outcome.facts["kept"] = kept
        if operation.repeat and outcome.code:  # a campaign that succeeded would go on with its next item
            with silent() as said:
                outcome.repeated = _in_child(partial(self._main, self.arguments(operation)))
            outcome.text += said.getvalue()


def points_of(name: str, calls: Sequence[str], kinds: Sequence[str] = KINDS) -> Iterator[Point]:
    """Yield the points of an operation with these calls: each call in each way in which it can fail."""
    for number, call in enumerate(calls):
        for kind in kinds:
            if OPERATIONS[name].boundary == "file":
                word = call.partition(" ")[0]
                if (
                    kind not in WAYS["file"]
                    or (kind == "garbage" and word not in READS)
                    or (kind == "end" and word not in (*READS, *WRITES, "openat", "mkdir"))
                ):
                    continue
            yield Point(name, number, kind)


def _decide(operation: Operation, point: Point, outcome: Outcome, seen: list[str], number: int, call: Call) -> object:
    """Return how a system call of the child is answered."""
    if operation.boundary != "file":
        return None
    label = f"{call.name} {Path(call.path).suffix or Path(call.path).name}"
    if point.number < 0:
        seen.append(label)
    if number != point.number:
        return None
    outcome.call = label
    return decided(point.kind, call)


def decided(kind: str, call: Call) -> object:
    """Return how a system call that fails in this way is answered."""
    match kind:
        case "error":
            return errno.EIO
        case "end":
            return "end" if call.name in READS else errno.ENOSPC
        case "silence":
            return "hold"
        case "delay":
            time.sleep(0.3)
            return None
        case "garbage":
            return "garbage" if call.name in READS else errno.EIO  # the calls of two runs differ by some
        case _:
            return errno.ENOMEM


def _work(main: Any, arguments: list[str], operation: Operation, point: Point, shared: mmap.mmap, said: int) -> int:
    """Do the operation in a forked process, with its wires tapped; put the facts into shared memory."""
    os.dup2(said, 1)
    os.dup2(said, 2)
    sys.stdout, sys.stderr = (os.fdopen(n, "w", buffering=1, closefd=False) for n in (1, 2))
    from drivers import Deadline
    from tests.helpers.single_faults.wire_faults import tap

    for name, seconds in SHORT.items() if point.kind != "stop" else ():
        Deadline[name].seconds = seconds
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    facts: dict[str, Any] = {"acknowledged": 0, "warned": False, "rest": None}
    benches: list[Any] = []
    with _observed(facts, benches, shared), tap(operation, point, facts):
        code = main(arguments)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if benches:
        report = benches[-1].report()
        facts["volts"] = {name: getattr(report, name) for name in report.__slots__}
    from drivers import threads_left_behind

    facts["left"] = threads_left_behind()
    text = json.dumps(facts).encode()
    shared[5 : 5 + len(text)] = text
    shared[1:5] = len(text).to_bytes(4, "little")
    return int(code)


@contextlib.contextmanager
def _observed(facts: dict[str, Any], benches: list[Any], shared: mmap.mmap) -> Iterator[None]:
    """Note the simulated benches and the events of their runs."""
    from protocols.base import EventBus
    from sim_hardware.bench import SimulatedBench

    make, publish = SimulatedBench.__init__, EventBus.publish

    def made(bench: Any, *arguments: Any, **named: Any) -> None:
        make(bench, *arguments, **named)
        bench.history.keeps_past = True
        benches.append(bench)

    def published(bus: Any, event: Any) -> None:
        publish(bus, event)
        match event.kind:
            case "PointMeasured":
                facts["acknowledged"] += 1
            case "MayBeLive":
                facts["warned"] = True
            case "Armed":
                shared[0] = 1
            case "AtRest":
                facts["rest"], shared[0] = event.confirmed, 0
            case "RunEnded":
                facts["warned"] |= event.status == "unsafe"
                shared[0] = 0

    with mock.patch.object(SimulatedBench, "__init__", made), mock.patch.object(EventBus, "publish", published):
        yield


@contextlib.contextmanager
def silent() -> Iterator[io.StringIO]:
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        yield text


def _in_child(work: Callable[[], int]) -> int:
    """Return the exit code of a forked process that does something."""
    pid = os.fork()
    if pid == 0:
        code = 70
        try:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            code = int(work())
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def _hashes(folder: Path) -> dict[str, str]:
    from protocols.base import file_hash

    return {path.name: file_hash(path) for path in folder.iterdir() if path.is_file()}
