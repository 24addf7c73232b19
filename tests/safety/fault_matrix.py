"""One cell of the fault matrix: a protocol runs, something breaks at a stated moment, and the world is looked at.

Used by the test and by `docs/make_fault_matrix.py`, which prints the table into the documentation.
"""

import logging
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from app.build import connect
from app.config import BenchConfig
from app.session import header
from drivers.clock import WallClock
from drivers.rest import REST_TOLERANCE_V
from protocols.events import Armed, AtRest, BlockTaken, Event, GoingToRest, Playing, SettleEnded, Status, StreamStarted
from protocols.protocol import Protocol
from protocols.registry import PROTOCOLS
from protocols.runfile import RunFile
from protocols.runner import Runner
from protocols.runreader import Run
from protocols.sine_dwell import SineDwell
from protocols.wiring_check import WiringCheck
from sim_hardware.bench import VirtualBench
from sim_hardware.operator import SimulatedOperator
from sim_hardware.served import ServedBench
from tests.support import simulated

MOMENTS = ("arming", "ramp", "settling", "recording", "stopping")

SHORT: dict[str, Protocol] = {
    "sine-dwell": SineDwell(
        frequencies_hz=(100,), record_s=0.1, min_cycles=10, settle_limit_s=0.5, sample_rate_hz=2000
    ),
    "wiring-check": WiringCheck(record_s=0.5, wait_s=0.1, sample_rate_hz=2000),
}
"""Short forms; a protocol without one is run as it comes."""

MOVES = re.compile(r"VOLT(:OFFS)? [-\d.]|\*TRG")
"""Messages that move the generator's output."""

ON_THE_WAY = 2
"""Before this one of them, after the bench was armed or the way out began, the source is on its way between levels."""

TAKES_THE_DRIVE = ("generator-power-off", "drive-cable-off", "output-tripped")
"""What takes the generator off the amplifier's input, which is then pulled to -500 V on the specimen: no software helps."""


def protocol(name: str) -> Protocol:
    return SHORT.get(name) or PROTOCOLS[name]()


@dataclass(frozen=True, slots=True)
class Cell:
    """What became of a run in which something broke."""

    status: Status
    reason: str
    told_rest: AtRest | None
    at_rest: bool
    """The plant's input stands still at rest, and nothing will move it."""
    end_v: float
    largest_jump_v: float
    file_status: str
    program_errors: tuple[str, ...]
    broke: bool
    watchdog_log: str

    @property
    def faults(self) -> list[str]:
        """What the program owes and did not keep; empty where all is well."""
        wrong = []
        if not self.broke:
            wrong.append("the moment never came")
        if not self.at_rest and self.status is not Status.UNSAFE:
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


class _Breaker:
    """Breaks the fault when the moment has come; it sees the run's events and the messages to the generator."""

    def __init__(self, bench: VirtualBench, fault: str, moment: str) -> None:
        self.bench, self.fault, self.moment = bench, fault, moment
        self.done = False
        self._counting: type | None = {"ramp": Armed, "stopping": GoingToRest}.get(moment)  # type: ignore[assignment]
        self._left: int | None = None
        self._playing = self._settled = False
        handle = bench.port.handle

        def handled(message: str) -> Any:
            if self._left is not None and MOVES.match(message):
                self._left -= 1
                if self._left == 0:
                    self.act()
            return handle(message)

        bench.port.handle = handled  # type: ignore[method-assign]

    def act(self) -> None:
        if not self.done:
            self.done = True
            self.bench.inject(self.fault)

    def __call__(self, event: Event) -> None:
        if self._counting is not None and isinstance(event, self._counting) and self._left is None:
            self._left = ON_THE_WAY
        match event:
            case StreamStarted() if self.moment == "arming":
                self.act()
            case Playing():
                self._playing = True
            case SettleEnded() if self.moment == "recording":
                self._settled = True
            case BlockTaken() if self._settled or (self._playing and self.moment == "settling"):
                self.act()


@cache
def _bench_file() -> BenchConfig:
    # A coarse grid is enough where nobody looks at the beam, and makes the matrix several times as fast.
    return simulated(plant_rate_hz=20_000.0, modes=3)


@contextmanager
def _virtual() -> Iterator[tuple[Any, VirtualBench, Any]]:
    with connect(_bench_file(), None) as lab:
        lab.bench.block_s = 0.2  # fewer writes to the file
        yield lab.bench, lab.control, lab.operator


@contextmanager
def _wires() -> Iterator[tuple[Any, VirtualBench, Any]]:
    bench = VirtualBench(simulated().truth, WallClock(1.0))
    with ExitStack() as stack:
        served = stack.enter_context(ServedBench(bench))
        config = BenchConfig.model_validate(
            {
                "generator": {"resource": f"TCPIP::127.0.0.1::{served.scpi.port}::SOCKET", "timeout_s": 0.3},
                "card": {"server": f"127.0.0.1:{served.card.port}"},
                "sensor": {"delay_s": 1e-4},
                "watchdog": {"patience_s": 1.0},
            }
        )
        yield stack.enter_context(connect(config)).bench, bench, SimulatedOperator(bench)


def cell(fault: str, name: str, moment: str, folder: Path, wires: bool = False) -> Cell:
    """Run protocol `name` and break `fault` at `moment`."""
    errors: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            errors.append(record.getMessage())

    listener = Listener(logging.ERROR)
    logging.getLogger().addHandler(listener)
    opening: Callable[[], Any] = _wires if wires else _virtual
    try:
        with opening() as (bench, world, operator):
            bench.watchdog.log_to(folder)
            breaker = _Breaker(world, fault, moment)
            events: list[Event] = []
            chosen = protocol(name)
            store = RunFile.new(folder, header(chosen, bench, "matrix"))
            status, reason = Runner(chosen, bench, store, operator, [events.append, breaker]).run()
            report = world.report()
    finally:
        logging.getLogger().removeHandler(listener)
    with Run(store.path) as file:
        file_status = file.status
    log = folder / "watchdog.log"
    return Cell(
        status=status,
        reason=reason,
        told_rest=next((e for e in events if isinstance(e, AtRest)), None),
        at_rest=report.ends_at_rest or report.live_s == 0,
        end_v=report.end_v,
        largest_jump_v=report.largest_jump_v,
        file_status=str(file_status),
        program_errors=tuple(errors),
        broke=breaker.done,
        watchdog_log=log.read_text() if log.exists() else "",
    )
