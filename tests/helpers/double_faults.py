"""Double faults: two faults at the same time under a drive, the volts that follow, and who reports what.

Every cell runs the whole program in a process of its own, with its watchdog, on the real wires of a simulated bench. Used by the test
and by `docs/make_double_faults.py`.
"""

import contextlib
import math
import os
import resource
import signal
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from unittest import mock

import numpy as np
import psutil

from drivers.bench.rest import REST_TOLERANCE_V
from drivers.clock import WallClock
from drivers.watchdog.log import LOG_NAME
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant import InterlockParameters
from sim_hardware.service.served_bench import ServedBench
from sim_hardware.testing.safe_volts import STEP_V
from tests.helpers import one_drive
from tests.helpers.program import Program, start, store_commissioning
from tests.helpers.simulated_bench import simulated
from tests.helpers.waiting import wait_until
from tests.wires.tcp_proxy import TcpProxy

SLOW_WIRE_S = 0.3
"""Delay of every byte on the slow wire, each way."""

WATCHDOG_PATIENCE_S = 5.0
"""Of the bench file: the default is 30 s."""

WATCHDOG = f"silence_s = 1.0\npatience_s = {WATCHDOG_PATIENCE_S}"
"""Table of the bench file: the default of `silence_s` is 0.4 s."""

TOO_LONG_S = 60.0
"""Wall time after which a cell that neither rests nor reports is at fault; the times of the table are measured, not required."""

INTERLOCK = InterlockParameters("port0/line0", "port0/line1", monostable_s=0.5, release_s=0.1)

FAULTS = {
    "program killed": "SIGKILL to the program",
    "program frozen": "SIGSTOP to the program, and SIGCONT when all others have done what they can",
    "watchdog killed": "SIGKILL to the watchdog's process",
    "watchdog frozen": "SIGSTOP to the watchdog's process, until the end",
    "slow wire": "every byte to and from the source takes 0.3 s from then on",
    "wire cut": "the connection to the source is closed, and no new one is accepted",
    "source silent": "the source neither obeys nor replies, and continues what it plays",
    "source off": "the generator loses mains: the amplifier's input is pulled to 0 V",
    "card lost": "the card's USB cable is off",
    "disk full": "no file of the program can grow any more",
    "Stop pressed": "SIGINT to the program, as Ctrl-C",
}

PAIRS = (
    ("program killed", "slow wire"),
    ("program killed", "wire cut"),
    ("program killed", "source silent"),
    ("program killed", "source off"),
    ("program killed", "card lost"),
    ("program killed", "watchdog killed"),
    ("program killed", "watchdog frozen"),
    ("program frozen", "slow wire"),
    ("program frozen", "wire cut"),
    ("program frozen", "source silent"),
    ("program frozen", "card lost"),
    ("program frozen", "watchdog killed"),
    ("watchdog killed", "slow wire"),
    ("watchdog killed", "wire cut"),
    ("watchdog killed", "source silent"),
    ("watchdog killed", "card lost"),
    ("watchdog killed", "disk full"),
    ("watchdog frozen", "Stop pressed"),
    ("source silent", "card lost"),
    ("source silent", "Stop pressed"),
    ("source silent", "disk full"),
    ("wire cut", "card lost"),
    ("wire cut", "Stop pressed"),
    ("slow wire", "Stop pressed"),
    ("slow wire", "card lost"),
    ("source off", "card lost"),
    ("disk full", "Stop pressed"),
    ("card lost", "Stop pressed"),
)

INTERLOCKED = "level with interlock"
"""The drive of the column in which the bench has an interlock."""

DRIVES = ("level", "sine", "arbitrary", "ramp", "sweep", INTERLOCKED)

SAFE_V, OFF_WITHIN_S = 60.0, 1.0
"""Largest volts on the specimen that count as off, and the longest time from the monostable's end until they are reached."""


@dataclass(frozen=True, slots=True)
class SourceKind:
    """A source of the table: simulation parameters, bench file, and how long its drives last."""

    title: str
    truth: dict[str, object]
    bench_file: str = ""
    drive_s: float = 60.0
    on_card: bool = False
    drives: tuple[str, ...] = DRIVES
    level_stop_s: float | None = None
    """What its commissioning record says about Stop from a level; NaN if that cannot be hastened, None without a record."""
    ends_by_itself_s: float = 0.0
    """Latest time at which a drive that is not ended is at rest; 0 where the end of a cell is not waited for."""


SOURCES = {
    "33511B": SourceKind(
        "Keysight 33511B: holds its range, a drive is stopped in steps", {"generator": {"model": "33511B"}}
    ),
    "SDG1032X": SourceKind(
        "Siglent SDG1032X: cannot hold its range, a drive of 9 s at most is waited for",
        {"generator": {"model": "SDG1032X"}},
        drive_s=8.0,
        drives=("level", "sine", "arbitrary", INTERLOCKED),
    ),
    "33511B_commissioned": SourceKind(
        "Keysight 33511B, commissioned: a level is a waveform of 9.6 s that ends by itself",
        {"generator": {"model": "33511B"}},
        drive_s=8.0,
        drives=("level", INTERLOCKED),
        level_stop_s=math.nan,
        ends_by_itself_s=11.0,
    ),
    "SDG1032X_commissioned": SourceKind(
        "Siglent SDG1032X, commissioned: a level is a waveform of 8.6 s, whose end Stop and watchdog hasten",
        {"generator": {"model": "SDG1032X", "traits": "retime=continues"}},
        drive_s=8.0,
        drives=("level", INTERLOCKED),
        level_stop_s=1.2,
        ends_by_itself_s=10.0,
    ),
    "card": SourceKind(
        "analogue output of the card behind a gRPC server: no watchdog (docs/safety.md)",
        {"source": "ao0"},
        '[source]\nkind = "card-output"\n',
        on_card=True,
        drives=("level", "sine", INTERLOCKED),
    ),
}

NOT_ON_CARD = ("watchdog killed", "watchdog frozen", "source off")
"""Faults that a card as the source does not have: it has no watchdog behind a server, and no mains of its own."""


def pairs_of(source: str) -> tuple[tuple[str, str], ...]:
    """Return the pairs that a source can have; on a card, a lost card is a lost source."""
    if not SOURCES[source].on_card:
        return PAIRS
    return tuple(pair for pair in PAIRS if not set(pair) & set(NOT_ON_CARD))


@dataclass(frozen=True, slots=True)
class Report:
    """What was reported, by whom, and how many seconds after the faults."""

    who: str
    what: str
    after_s: float


@dataclass
class DoubleCell:
    """What became of a drive under two faults."""

    source: str
    drive: str
    pair: tuple[str, str]
    rest_s: float = math.nan
    """Seconds after the faults from which on the input was constant at rest; NaN if it was not."""
    off_s: float = math.nan
    """Seconds after the faults from which on the specimen had less than SAFE_V because high voltage was off; NaN if it was not."""
    end_v: float = math.nan
    largest_jump_v: float = 0.0
    lowest_v: float = math.nan
    highest_v: float = math.nan
    exit_code: int | None = None
    reports: list[Report] = field(default_factory=list)
    text: str = ""
    next_text: str = ""
    confirmed_wrongly: bool = False

    @property
    def at_rest(self) -> bool:
        return not math.isnan(self.rest_s)

    @property
    def alarms(self) -> list[Report]:
        """Reports that the specimen may be live."""
        return [report for report in self.reports if report.what in (MAY_BE_LIVE, UNSAFE, COULD_NOT)]

    @property
    def faults(self) -> list[str]:
        """What the product owes and did not keep; empty where all is well."""
        wrong = []
        if self.drive == INTERLOCKED:
            limit_s = INTERLOCK.monostable_s + OFF_WITHIN_S
            if {"program killed", "card lost"} & set(self.pair) and not (
                self.off_s <= limit_s or self.rest_s <= limit_s
            ):
                wrong.append(f"not below {SAFE_V:g} V on the specimen within {limit_s:g} s")
        elif not self.at_rest and not self.alarms:
            wrong.append(f"the input is at {self.end_v:.3f} V and nobody reports it")
        if self.confirmed_wrongly:
            wrong.append("rest was confirmed while the input was not at rest")
        if not self.at_rest and self.exit_code == 0:
            wrong.append("exit code 0")
        if "source off" not in self.pair:
            if self.largest_jump_v > STEP_V + 1e-6:
                wrong.append(f"a jump of {self.largest_jump_v:.3f} V")
            if self.lowest_v < -1e-9 or self.highest_v > 5 + 1e-9:
                wrong.append(f"the input left its range: {self.lowest_v:.3f} to {self.highest_v:.3f} V")
        if any(words in self.text + self.next_text for words in ("an error of this program", "Traceback")):
            wrong.append("an error of the program")
        return wrong

    @property
    def words(self) -> str:
        """The cell of the table."""
        if self.faults:
            return "FAULT: " + "; ".join(self.faults)
        state = f"rest {self.rest_s:.1f} s" if self.at_rest else f"**{self.end_v:.1f} V**"
        if not (math.isnan(self.off_s) or self.rest_s < self.off_s):
            state = f"off {self.off_s:.1f} s"
        return "; ".join([state, *(f"{r.who}: {r.what} {r.after_s:.1f} s" for r in self.alarms)])


MAY_BE_LIVE, UNSAFE, COULD_NOT, DONE = "may be live", "unsafe", "could not", "brought to rest"

SAID_BY_PROGRAM = {"DANGER: ": MAY_BE_LIVE, "UNSAFE: ": UNSAFE}
SAID_BY_WATCHDOG = {
    "does not obey": MAY_BE_LIVE,
    "could NOT be brought to rest": COULD_NOT,
    "was brought to rest": DONE,
}


class NotLiveError(Exception):
    """The program ended before the faults were injected."""


class Scene:
    """A program that plays one drive on the wires of a bench, and the faults that meet it."""

    def __init__(self, source: str, drive: str, folder: Path, stack: ExitStack, watchdog: str = WATCHDOG) -> None:
        """`watchdog` is the bench file's table."""
        self.kind, self.folder = SOURCES[source], folder
        parameters = simulated(plant_rate_hz=20_000.0, modes=3, **self.kind.truth).simulation_parameters
        interlock = ""
        if drive == INTERLOCKED:
            parameters = replace(parameters, interlock=INTERLOCK)
            interlock = f"[interlock]\nline = '{INTERLOCK.line}'\nstate_line = '{INTERLOCK.state_line}'\n"
        self.bench = SimulatedBench(parameters, WallClock(1.0))
        self.served = stack.enter_context(ServedBench(self.bench))
        self.proxy = stack.enter_context(
            TcpProxy(self.served.card.port if self.kind.on_card else self.served.scpi.port)
        )
        card = self.proxy.port if self.kind.on_card else self.served.card.port
        (folder / "bench.toml").write_text(
            f'name = "bench under test"\n{self.kind.bench_file}'
            f'[generator]\nresource = "{self.proxy.resource}"\ntimeout_s = 1.0\n'
            f'[card]\nserver = "127.0.0.1:{card}"\n'
            f"[sensor]\ndelay_s = 1e-4\n"
            f"[levels]\nlaser_lost = 'warning'\nstroke = 'warning'\n"
            f"[amplifier]\nramp_v_per_s = {1.0 if drive == 'ramp' else 5.0}\nway_to_rest_s = 10\n"
            f"[watchdog]\n{watchdog}\n{interlock}"
        )
        self.settings = f"drive={'level' if drive == INTERLOCKED else drive}", f"drive_s={self.kind.drive_s}"
        if self.kind.level_stop_s is not None:
            with self.data_folder():
                store_commissioning(self.proxy.resource, self.kind.level_stop_s)
        self.program = self.start(stack)
        self.drive = drive

    def data_folder(self) -> AbstractContextManager[object]:
        """Records of commissionings are in the folder of the cell."""
        return mock.patch.dict(os.environ, {"XDG_DATA_HOME": str(self.folder / "data")})

    def start(self, stack: ExitStack) -> Program:
        with self.data_folder():
            program = start(self.bench, self.folder, *self.settings, protocol=one_drive.__file__)
        stack.callback(program.close)
        return program

    def go_live(self) -> None:
        """Until the drive is on the specimen; a ramp, until it is in its middle.

        Raises:
            NotLiveError: the program ended before; on a computer that is too busy.
        """
        try:
            self.program.arm()
            self.program.wait_for("high voltage is on")
        except AssertionError:
            raise NotLiveError(self.program.text[-300:]) from None
        while not self._is_under_way():
            if self.program.process.poll() is not None:
                raise NotLiveError(self.program.text[-300:])
            time.sleep(0.02)
        children = psutil.Process(self.program.process.pid).children()
        self.watchdog = next((p for p in children if "drivers.watchdog.process" in command_line(p)), None)

    def _is_under_way(self) -> bool:
        report = self.bench.report()
        least_v = {"ramp": 3.2, "level": 3.99, INTERLOCKED: 3.99}.get(self.drive)
        return report.end_v > least_v if least_v else report.outside_rest_s > 0.2

    def break_(self, fault: str) -> None:
        """Inject a fault."""
        process = self.program.process
        match fault:
            case "program killed":
                process.kill()
            case "program frozen":
                process.send_signal(signal.SIGSTOP)
            case "watchdog killed" if self.watchdog is not None:
                self.watchdog.kill()
            case "watchdog frozen" if self.watchdog is not None:
                self.watchdog.suspend()
            case "slow wire":
                self.proxy.delay_s = SLOW_WIRE_S
            case "wire cut":
                self.bench.inject("grpc-gone" if self.kind.on_card else "scpi-dropped")
            case "source silent" if self.kind.on_card:
                self.proxy.silent = True
            case "source silent":
                self.bench.inject("scpi-silent")
            case "source off":
                self.bench.inject("generator-power-off")
            case "card lost":
                self.bench.inject("card-unplugged")
            case "disk full":
                resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (1, 1))
            case "Stop pressed":
                process.send_signal(signal.SIGINT)

    def log(self) -> str:
        file = self.folder / LOG_NAME
        return file.read_text() if file.exists() else ""

    def clean_up(self) -> None:
        """Let go of a frozen watchdog."""
        with contextlib.suppress(psutil.Error):
            if self.watchdog is not None:
                self.watchdog.resume()


def command_line(process: psutil.Process) -> list[str]:
    """Arguments of a process; none of one that has ended meanwhile."""
    try:
        return process.cmdline()
    except psutil.Error:
        return []


ATTEMPTS = 3
"""At bringing a drive onto the specimen, which a computer that is too busy may prevent."""


def double_cell(source: str, drive: str, pair: tuple[str, str], folder: Path) -> DoubleCell:
    """Play a drive, inject both faults, and return what followed.

    Raises:
        NotLiveError: the drive did not come onto the specimen.
    """
    for attempt in range(1, ATTEMPTS + 1):
        (own := folder / str(attempt)).mkdir(parents=True)
        try:
            return _double_cell(source, drive, pair, own)
        except NotLiveError:
            if attempt == ATTEMPTS:
                raise
    raise AssertionError


def _double_cell(source: str, drive: str, pair: tuple[str, str], folder: Path) -> DoubleCell:
    seen = DoubleCell(source, drive, pair)
    with open_scene(source, drive, folder) as (scene, stack):
        scene.go_live()
        bench, program = scene.bench, scene.program
        began_s, began_bench_s = time.monotonic(), bench.now()
        for fault in pair:
            scene.break_(fault)
        told: list[Report] = []

        def listen() -> None:
            for words, what in SAID_BY_WATCHDOG.items():
                if words in scene.log() and not any(r.who == "watchdog" and r.what == what for r in told):
                    told.append(Report("watchdog", what, time.monotonic() - began_s))

        def settled() -> bool:
            """Whether every party that can still act has done so."""
            listen()
            can_act = "program killed" not in pair and "program frozen" not in pair
            if can_act:
                return program.process.poll() is not None
            dead_watchdog = scene.watchdog is None or {"watchdog killed", "watchdog frozen"} & set(pair)
            if dead_watchdog:
                return True
            return any(report.what in (COULD_NOT, DONE) for report in told)

        wait_until(settled, TOO_LONG_S)
        if "program killed" in pair:
            program.process.wait()
        if "program frozen" in pair:
            program.process.send_signal(signal.SIGCONT)
            wait_until(lambda: listen() or program.process.poll() is not None, TOO_LONG_S)
        if program.process.poll() is None:
            seen.text = "the program did not end"
        else:
            seen.exit_code = program.process.wait()
            time.sleep(
                0.2
            )  # its last lines: the end of its pipe is not waited for, because a frozen watchdog holds it, too
        listen()
        seen.text += program.text
        for words, what in SAID_BY_PROGRAM.items():
            at = next((t for line, t in zip(program.said, program.said_s, strict=True) if words in line), None)
            if at is not None and at >= began_s - 0.5:
                told.append(Report("program", what, at - began_s))
        confirmed_s = next(
            (t for line, t in zip(program.said, program.said_s, strict=True) if "At rest: the card" in line), None
        )
        seen.confirmed_wrongly = confirmed_s is not None and not bench.report().ends_at_rest
        if not bench.report().ends_at_rest and not any(r.what in (UNSAFE, COULD_NOT) for r in told):
            _next_start(scene, seen, told, stack, began_s)
        if not bench.report().ends_at_rest:
            wait_until(lambda: bench.report().ends_at_rest, began_s + scene.kind.ends_by_itself_s - time.monotonic())
        if drive == INTERLOCKED:
            wait_until(
                lambda: bench.report().ends_at_rest or not bench.history.high_voltage_on,
                INTERLOCK.monostable_s + OFF_WITHIN_S,
            )
        report = bench.report()
        seen.end_v, seen.largest_jump_v = report.end_v, report.largest_jump_v
        seen.lowest_v, seen.highest_v = report.lowest_v, report.highest_v
        if report.ends_at_rest or _stays_at_rest(bench):
            seen.rest_s = rest_since(bench, began_bench_s) - began_bench_s
        if not bench.history.high_voltage_on:
            seen.off_s = live_until(bench, began_bench_s) - began_bench_s
        seen.reports = sorted(told, key=lambda r: r.after_s)
    return seen


def _next_start(scene: Scene, seen: DoubleCell, told: list[Report], stack: ExitStack, began_s: float) -> None:
    """Start the program again: it must report, before it asks the operator anything, or bring the source to rest."""
    del began_s
    started_s = time.monotonic()
    following = scene.start(stack)

    def reacted() -> bool:
        return (
            following.process.poll() is not None
            or "must be ON now" in following.text
            or "voltage OFF." in following.text
        )

    wait_until(reacted, TOO_LONG_S)
    if following.process.poll() is None:
        following.process.send_signal(signal.SIGINT)
    following.end()
    seen.next_text, seen.exit_code = following.text, following.process.returncode
    for words, what in {**SAID_BY_PROGRAM, **SAID_BY_WATCHDOG}.items():
        at = next((t for line, t in zip(following.said, following.said_s, strict=True) if words in line), None)
        if at is not None:
            told.append(Report("next start", what, at - started_s))


def rest_since(bench: SimulatedBench, begin_s: float) -> float:
    """Return the bench time from which on the input has been at rest, not before `begin_s`."""
    entries, end_s, since = bench.history.entries(), bench.now(), begin_s
    for entry, following in zip(entries, [*entries[1:], None], strict=True):
        stop_s = end_s if following is None else min(following.start_s, end_s)
        t = np.arange(max(entry.start_s, begin_s), stop_s, 5e-4)
        away = np.flatnonzero(np.abs(entry.segment.volts(t) - 2.5) > REST_TOLERANCE_V / 2) if t.size else t
        if away.size:
            since = float(t[int(away[-1])])
    return since


def live_until(bench: SimulatedBench, begin_s: float) -> float:
    """Return the last bench time at which the specimen had more than SAFE_V; `begin_s` if it was before."""
    bench.history.settle(bench.now())
    entries, until_s = bench.history.entries(), begin_s
    for entry, following in zip(entries, [*entries[1:], None], strict=True):
        t = np.arange(max(entry.start_s, begin_s), bench.now() if following is None else following.start_s, 5e-4)
        volts = (
            bench.parameters.amplifier.map.specimen_v(entry.segment.volts(t)) if entry.hv and t.size else np.zeros(0)
        )
        live = np.flatnonzero(np.abs(volts) > SAFE_V)
        until_s = float(t[live[-1]]) if live.size else until_s
    # The history has high voltage until the volts on the specimen are gone: relay and amplifier included.
    return until_s


def _stays_at_rest(bench: SimulatedBench) -> bool:
    """Return whether the input is at rest in what is left of the samples that the card plays."""
    segment, now_s = bench.history.entries()[-1].segment, bench.now()
    t = np.arange(now_s, min(max(segment.constant_from_s, now_s) + 1e-3, now_s + 120.0), 5e-4)
    return bool(np.abs(segment.volts(t) - 2.5).max() <= REST_TOLERANCE_V / 2)


@contextmanager
def open_scene(source: str, drive: str, folder: Path, watchdog: str = WATCHDOG) -> Iterator[tuple[Scene, ExitStack]]:
    """Start a program that plays a drive; end it with its bench at the end."""
    with ExitStack() as stack:
        scene = Scene(source, drive, folder, stack, watchdog)
        stack.callback(lambda: scene.clean_up() if hasattr(scene, "watchdog") else None)
        yield scene, stack
