"""Trials of the fault search: a protocol, a source, an operator and the hazards of one run, drawn from a seed."""

import random
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from pydantic import ValidationError

from app.session.bench_connection import connect
from drivers.errors import BenchError
from protocols.base import Protocol
from protocols.registry import BUILT_IN_PROTOCOLS, PROTOCOLS
from protocols.rehearsal import rehearse
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS, INTERLOCK_FAULTS, SPECIMEN_FAULTS
from tests.helpers.electrical.bench import bench_for
from tests.helpers.fault_matrix import ON_WIRES_ONLY, protocol
from tests.helpers.simulated_bench import simulated
from tests.helpers.single_faults.points import KINDS

SOURCES = ("33511B", "33220A", "DG1032Z", "DG812", "SDG1032X", "AFG3022C")

BENCH_FAULTS = tuple(
    name for name in FAULT_DESCRIPTIONS if name not in (*ON_WIRES_ONLY, *SPECIMEN_FAULTS, *INTERLOCK_FAULTS)
)

OPERATORS = {
    "prompt": "does what a prompt asks",
    "slow": "answers up to 20 s later",
    "forgetful": "confirms high voltage without switching it on",
    "unwilling": "gives the last of the answers offered",
    "absent": "does not answer; Stop is pressed 60 s later",
}

HAZARDS = {
    "bench": "a fault of the simulated bench, which may end later",
    "SCPI": "messages of the source fail, as in the single faults",
    "file": "system calls on the files fail, as in the single faults",
    "hand": "a person at the generator's front panel changes a setting",
    "program": "a second program commands the generator",
    "Stop": "Stop is pressed",
    "pause": "the run is paused, and resumed later",
    "delay": "the program stands still for up to 30 s",
    "kill": "SIGKILL to the program; another one is started up to 30 s later",
}
"""Kinds of hazards, and how often each is drawn."""

WEIGHTS = {"bench": 6, "SCPI": 6, "file": 1, "hand": 3, "program": 2, "Stop": 2, "pause": 2, "delay": 2, "kill": 3}

FRONT_PANEL = {
    "Keysight": ("VOLT 2", "VOLT:OFFS 3", "FREQ 300", "OUTP OFF", "BURS:STAT OFF", "FUNC SQU", "*RST"),
    "Rigol": (
        ":SOUR1:VOLT 2",
        ":SOUR1:VOLT:OFFS 3",
        ":SOUR1:FREQ 300",
        ":OUTP1 OFF",
        ":SOUR1:BURS OFF",
        ":SOUR1:FUNC SQU",
        "*RST",
    ),
    "Siglent": ("C1:BSWV AMP,2", "C1:BSWV OFST,3", "C1:BSWV FRQ,300", "C1:OUTP OFF", "C1:BTWV STATE,OFF", "*RST"),
    "Tektronix": ("SOUR1:VOLT 2", "SOUR1:VOLT:OFFS 3", "SOUR1:FREQ 300", "OUTP1 OFF", "SOUR1:BURS:STAT OFF", "*RST"),
}
"""Messages with the effect of the front panel's keys, by manufacturer."""

FILE_KINDS = tuple(kind for kind in KINDS if kind != "silence")
"""A silent disk keeps HDF5, and with it the run afterwards, from this process: it belongs to the single faults."""

MAKERS = {"33": "Keysight", "DG": "Rigol", "SD": "Siglent", "AF": "Tektronix"}

SECOND_PROGRAM = ("arms", "plays", "ramps")

PLANT_RATE_HZ = 10_000.0
"""Coarse: the beam's motion is not judged."""

LONGEST_S, LONGEST_DELAY_S = 60.0, 30.0
"""Longest rehearsed duration of a trial's run, and longest delay, bench seconds."""


@dataclass(frozen=True, slots=True)
class Hazard:
    """Something that happens at a tick of the run.

    Attributes:
        kind: one of HAZARDS.
        what: the fault, message, action; the way of failing for SCPI and file.
        at: tick (a message to the source, or an event of the run), as a share of the ticks of a run without hazards; of a file
            hazard, number of the system call.
        lasts: ticks, messages or calls until its end; 0: it does not end.
        seconds: its duration in bench time, of a delay and of a kill.
    """

    kind: str
    what: str = ""
    at: float = 0.0
    lasts: int = 0
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class Trial:
    """One run of the search.

    Attributes:
        by_offset: whether a level is held by the generator's offset, as without a commissioning record.
        reopens: whether the bench is opened anew for the run afterwards, in the place of the same session.
    """

    seed: int
    source: str
    by_offset: bool
    protocol: str
    settings: dict[str, Any] = field(hash=False)
    operator: str
    hazards: tuple[Hazard, ...]
    reopens: bool

    @property
    def words(self) -> str:
        """The trial in one line."""
        hazards = "; ".join(
            f"{each.kind} {each.what} at {each.at:.4g}"
            + (f" for {each.lasts}" if each.lasts else "")
            + (f" {each.seconds:.3g} s" if each.seconds else "")
            for each in self.hazards
        )
        held = ", levels by offset" if self.by_offset else ""
        return f"{self.protocol} on {self.source}{held}, operator {self.operator}: {hazards or 'no hazard'}"


LATER = {"electrical": 6000, "endurance": 6000}
"""First seed of the protocols that joined the search later: a seed keeps its trial."""


def drawn(seed: int) -> Trial:
    """Return the trial of a seed."""
    draw = random.Random(seed)
    source = draw.choice(SOURCES)
    name = draw.choice([name for name in BUILT_IN_PROTOCOLS if seed >= LATER.get(name, 0)])
    operator = draw.choices(list(OPERATORS), (16, 2, 1, 1, 1))[0]
    count = draw.choices((0, 1, 2, 3), (1, 8, 8, 3))[0]
    hazards = tuple(_hazard(draw, source) for _ in range(count))
    if any(each.kind == "kill" for each in hazards):  # the copy of a traced process would not be answered
        hazards = tuple(each for each in hazards if each.kind != "file")
    by_offset = draw.random() < 0.5
    settings = _settings(draw, source, name)
    return Trial(seed, source, by_offset, name, settings, operator, hazards, draw.random() < 0.3)


def _hazard(draw: random.Random, source: str) -> Hazard:
    kind = draw.choices(list(WEIGHTS), list(WEIGHTS.values()))[0]
    at, lasts = draw.random(), draw.choice((0, draw.randint(1, 3), draw.randint(1, 30)))
    match kind:
        case "bench":
            return Hazard(kind, draw.choice(BENCH_FAULTS), at, lasts)
        case "SCPI":
            return Hazard(kind, draw.choice(KINDS), at, max(lasts, 1))
        case "file":
            return Hazard(kind, draw.choice(FILE_KINDS), draw.randint(0, 90), 1)
        case "hand":
            return Hazard(kind, draw.choice(FRONT_PANEL[MAKERS[source[:2]]]), at)
        case "program":
            return Hazard(kind, draw.choice(SECOND_PROGRAM), at)
        case "pause":
            return Hazard(kind, at=at, lasts=draw.randint(1, 30))
        case "delay" | "kill":
            return Hazard(kind, at=at, seconds=LONGEST_DELAY_S ** draw.uniform(-0.5, 1.0))
        case _:
            return Hazard(kind, at=at)


def bench_file(source: str, name: str) -> Any:
    """Return the bench file of a source, with the inputs that the protocol needs; on a coarse plant."""
    return bench_for(name, simulated(plant_rate_hz=PLANT_RATE_HZ, modes=3, generator={"model": source}))


def _settings(draw: random.Random, source: str, name: str) -> dict[str, Any]:
    """Return the protocol's shortest settings with some of their numbers changed, where its plan stays allowed and short."""
    settings = protocol(name).model_dump()
    for field_name, value in settings.items():
        if isinstance(value, float) and draw.random() < 0.3:
            changed = {**settings, field_name: float(f"{value * draw.uniform(0.8, 1.5):.3g}")}
            if (made := _allowed(source, name, changed)) is not None:
                settings = made.model_dump()
    return settings


@cache
def _amplifier(source: str, name: str) -> Any:
    with connect(bench_file(source, name), None) as lab:
        return lab.bench.amplifier


def _allowed(source: str, name: str, settings: dict[str, Any]) -> Protocol | None:
    try:
        made = PROTOCOLS[name](**settings)
        return made if rehearse(made, _amplifier(source, name)).duration_s <= LONGEST_S else None
    except (ValidationError, ValueError, BenchError):
        return None
