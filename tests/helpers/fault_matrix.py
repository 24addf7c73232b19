"""Fault matrix: one protocol, one fault at a stated moment, and the outcome.

Used by the test and by `docs/make_fault_matrix.py`, which prints the table into the documentation.
"""

import logging
import math
import re
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from annotated_types import Interval, Unit
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from app.config.bench_file import BenchConfig
from app.session.bench_connection import connect
from drivers.bench.rest import REST_TOLERANCE_V
from drivers.clock import WallClock
from drivers.errors import BenchError
from protocols.base import (
    BenchArmed,
    BlockStored,
    DriveStarted,
    Event,
    EventBus,
    Protocol,
    RecordingFinished,
    RestMeasured,
    RunStatus,
    ShutdownStarted,
    StreamStarted,
)
from protocols.registry import PROTOCOLS
from protocols.rehearsal import rehearse
from protocols.runfile.reader import Run
from protocols.runner.request import RunControl, RunRequest
from protocols.runner.runner import Runner
from sim_hardware.bench import SimulatedBench
from sim_hardware.operator import SimulatedOperator
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.electrical.bench import bench_for
from tests.helpers.simulated_bench import simulated

MOMENTS = ("arming", "ramp", "settling", "recording", "stopping")

MOVES = re.compile(r"VOLT(:OFFS)? [-\d.]|\*TRG")
"""Messages that move the generator's output."""

ON_THE_WAY = 2
"""Before this one of them, after the bench was armed or the way out began, the source is on its way between levels."""

TAKES_THE_DRIVE = ("generator-power-off", "drive-cable-off", "output-tripped")
"""What takes the generator off the amplifier's input, which is then pulled to -500 V on the specimen: no software helps."""

ON_WIRES_ONLY = ("grpc-gone",)
"""What the virtual clock has no wire for."""

TOO_LONG_S = 900.0
"""Bench time after which a run counts as one that does not end."""


SHORT: dict[str, dict[str, Any]] = {"hysteresis": {"frequencies_hz": (5.0,)}}
"""Where the shortest plan begins for protocols whose first value is their longest."""


@cache
def protocol(name: str) -> Protocol:
    """The protocol, as short as its parameters let it be: each in turn is brought down, where the plan gets shorter."""
    kind = PROTOCOLS[name]
    settings: dict[str, Any] = dict(SHORT.get(name, {}))
    with connect(_bench_file(name), None) as lab:

        def seconds(changed: dict[str, Any]) -> float:
            return rehearse(kind(**changed), lab.bench.amplifier).duration_s

        least_s = seconds(settings)
        for field, value in [*kind().model_dump().items()] * 2:  # what was refused at first may fit later
            for smaller in _smaller(kind.model_fields[field], value):
                try:
                    now_s = seconds({**settings, field: smaller})
                except (ValidationError, ValueError, BenchError):
                    continue
                if now_s < least_s or (now_s == least_s and _unit(kind.model_fields[field]) == "Hz"):
                    settings, least_s = {**settings, field: smaller}, now_s
                    break
    return kind(**settings)


def _smaller(info: FieldInfo, value: Any) -> Iterator[Any]:
    """Smaller values of a parameter, the smallest first."""
    if isinstance(value, tuple) and len(value) > 1:
        yield from ((value[0],), (value[0], value[-1]), value[:3], (value[0], value[len(value) // 2], value[-1]))
    if isinstance(value, bool) or not isinstance(value, int | float):
        return
    floor = next(
        (getattr(m, "ge", None) or getattr(m, "gt", None) for m in info.metadata if isinstance(m, Interval)), 0
    )
    if _unit(info) == "Hz" and value >= 500:  # a sample rate: less to compute
        yield from (rate for rate in (500.0, 1000.0, 2000.0, 2500.0) if rate < value)
    if _unit(info) in ("s", "1"):
        whole = isinstance(value, int)
        steps = (floor or 0, max(floor or 0, value / 20), max(floor or 0, value / 4), value / 2)
        yield from (math.ceil(step) if whole else step for step in steps if 0 < step < value)


def _unit(info: FieldInfo) -> str:
    return str(next((m.unit for m in info.metadata if isinstance(m, Unit)), ""))


@dataclass(frozen=True, slots=True)
class Cell:
    """What became of a run in which something broke."""

    status: RunStatus
    reason: str
    told_rest: RestMeasured | None
    at_rest: bool
    """Return whether the plant's input is constant at rest and will remain so."""
    end_v: float
    largest_jump_v: float
    file_status: str
    program_errors: tuple[str, ...]
    broke: bool
    ended: bool
    watchdog_log: str

    @property
    def faults(self) -> list[str]:
        """What the program owes and did not keep; empty where all is well."""
        wrong = []
        if not self.broke:
            wrong.append(f"the moment never came: {self.reason}")
        if not self.ended:
            wrong.append(f"it did not end within {TOO_LONG_S:g} s")
        if not self.at_rest and self.status is not RunStatus.UNSAFE:
            wrong.append(f"the input is at {self.end_v:.3f} V and the run says {self.status}")
        if self.told_rest is not None and self.told_rest.confirmed and abs(self.end_v - 2.5) > REST_TOLERANCE_V:
            wrong.append(f"rest was confirmed with {self.end_v:.3f} V at the input")
        if self.file_status != self.status:
            wrong.append(f"the file says {self.file_status}, the run {self.status}")
        wrong += self.program_errors
        return wrong

    @property
    def words(self) -> str:
        """The cell of the table."""
        if self.faults:
            return "FAULT: " + "; ".join(self.faults)
        return f"{self.status}, {'at rest' if self.at_rest else 'not at rest'}"


class _Looker:
    """Learns from a run in which nothing breaks when a protocol's moments come."""

    def __init__(self, bench: SimulatedBench) -> None:
        self._clock = bench.clock
        self._anchor_s: float | None = None
        self._live, self._leaving = False, False
        self.record_after_s: float | None = None
        self.moves_live, self.moves_leaving = 0, 0
        _on_moves(bench, self._moved)

    def _moved(self) -> None:
        self.moves_leaving += self._leaving
        self.moves_live += self._live and not self._leaving

    def __call__(self, event: Event) -> None:
        now_s = self._clock.now()
        match event:
            case BenchArmed():
                self._live, self._anchor_s = True, now_s
            case DriveStarted() if self.record_after_s is None:
                self._anchor_s = now_s
            case RecordingFinished(rows=(first, last)) if self.record_after_s is None and self._anchor_s is not None:
                self.record_after_s = max(now_s - self._anchor_s - 0.5 * (last - first) / self.rate_hz, 0.0)
            case StreamStarted(rate_hz):
                self.rate_hz = rate_hz
            case ShutdownStarted():
                self._leaving = True


class _Breaker:
    """Injects the fault at its moment; observes the run's events and the messages to the generator."""

    def __init__(self, bench: SimulatedBench, fault: str, moment: str, seen: "Moments") -> None:
        self.bench, self.fault, self.moment, self._seen = bench, fault, moment, seen
        self.done = False
        self._counting: type | None = {"ramp": BenchArmed, "stopping": ShutdownStarted}.get(moment)
        self._left: int | None = None
        self._anchor_s: float | None = None
        _on_moves(bench, self._moved)

    def _moved(self) -> None:
        if self._left is not None:
            self._left -= 1
            if self._left == 0:
                self.act()

    def act(self) -> None:
        if not self.done:
            self.done = True
            self.bench.inject(self.fault)

    def __call__(self, event: Event) -> None:
        now_s = self.bench.clock.now()
        if self._counting is not None and isinstance(event, self._counting) and self._left is None:
            self._left = ON_THE_WAY
            if self.moment == "stopping" and self._seen.moves_leaving < ON_THE_WAY:
                self.act()  # it is at rest already, and stays there
        match event:
            case StreamStarted() if self.moment == "arming":
                self.act()
            case BenchArmed():
                self._anchor_s = now_s
            case DriveStarted():
                self._anchor_s = now_s
            case BlockStored() if self._anchor_s is not None and self.moment in ("settling", "recording"):
                if self.moment == "settling" or now_s - self._anchor_s >= (self._seen.record_after_s or 0.0):
                    self.act()


@dataclass(frozen=True, slots=True)
class Moments:
    """Which moments a protocol has, and when they come."""

    names: tuple[str, ...]
    record_after_s: float | None
    moves_leaving: int


@cache
def moments_of(name: str) -> Moments:
    """From a run in which nothing breaks, which must end well."""
    with tempfile.TemporaryDirectory() as folder, _virtual(name) as (bench, world, operator):
        looker = _Looker(world)
        request = RunRequest(protocol(name), Path(folder), "matrix")
        ended = Runner(request, bench, operator, EventBus(looker)).run()
        assert ended.status is RunStatus.COMPLETED, f"{name} without a fault: {ended.reason}"
    missing = {"ramp"} if looker.moves_live < ON_THE_WAY else set()
    return Moments(tuple(m for m in MOMENTS if m not in missing), looker.record_after_s, looker.moves_leaving)


def _on_moves(bench: SimulatedBench, told: Callable[[], None]) -> None:
    """Call back before every message that moves the generator's output."""
    handle = bench.message_port.handle

    def handled(message: str) -> Any:
        if MOVES.match(message):
            told()
        return handle(message)

    bench.message_port.handle = handled  # type: ignore[method-assign]


@cache
def _bench_file(name: str) -> BenchConfig:
    # The beam's motion is not checked here: a coarse grid suffices and makes the matrix several times as fast.
    return bench_for(name, simulated(plant_rate_hz=20_000.0, modes=3))


@contextmanager
def _virtual(name: str) -> Iterator[tuple[Any, SimulatedBench, Any]]:
    with connect(_bench_file(name), None) as lab:
        lab.bench.block_s = 0.2  # fewer writes to the file
        yield lab.bench, lab.control, lab.operator


@contextmanager
def _wires(name: str) -> Iterator[tuple[Any, SimulatedBench, Any]]:
    bench = SimulatedBench(simulated().simulation_parameters, WallClock(1.0))
    with ExitStack() as stack:
        served = stack.enter_context(ServedBench(bench))
        config = BenchConfig.model_validate(
            {
                "channels": [each.model_dump() for each in _bench_file(name).channels],
                "generator": {"resource": f"TCPIP::127.0.0.1::{served.scpi.port}::SOCKET", "timeout_s": 1.0},
                "card": {"server": f"127.0.0.1:{served.card.port}"},
                "sensor": {"delay_s": 1e-4},
                "watchdog": {"patience_s": 1.0, "silence_s": 5.0},  # what a busy computer may hold up a program
            }
        )
        yield (
            stack.enter_context(connect(config, without_commissioning="simulated bench on its wires")).bench,
            bench,
            SimulatedOperator(bench),
        )


def cell(fault: str, name: str, moment: str, folder: Path, wires: bool = False) -> Cell:
    """Run protocol `name` and break `fault` at `moment`."""
    errors: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            errors.append(record.getMessage())

    listener = Listener(logging.ERROR)
    logging.getLogger().addHandler(listener)
    opening: Callable[[str], Any] = _wires if wires else _virtual
    try:
        with opening(name) as (bench, world, operator):
            bench.watchdog.set_log_folder(folder)
            # As on a generator that is not commissioned: a level played as a waveform is ramped by the instrument itself.
            bench.amplifier.holds_by_offset = moment == "ramp"
            breaker = _Breaker(world, fault, moment, moments_of(name))
            events: list[Event] = []
            cancel = threading.Event()
            begin_s = bench.clock.now()

            def patience(_: Event) -> None:
                if bench.clock.now() - begin_s > TOO_LONG_S:
                    cancel.set()

            request = RunRequest(protocol(name), folder, "matrix")
            observers = EventBus(events.append, breaker, patience)
            runner = Runner(request, bench, operator, observers, RunControl(cancel))
            ended = runner.run()
            status, reason = ended.status, ended.reason
            report = world.report()
    finally:
        logging.getLogger().removeHandler(listener)
    with Run(runner.path) as file:
        file_status = file.record.status
    log = folder / "watchdog.log"
    return Cell(
        status=status,
        reason=reason,
        told_rest=next((e for e in events if isinstance(e, RestMeasured)), None),
        at_rest=report.ends_at_rest or report.live_s == 0,
        end_v=report.end_v,
        largest_jump_v=report.largest_jump_v,
        file_status=str(file_status),
        program_errors=tuple(errors),
        broke=breaker.done,
        ended=not cancel.is_set(),
        watchdog_log=log.read_text() if log.exists() else "",
    )
