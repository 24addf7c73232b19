"""A lab's own generator drivers, written for version 0.1.0 of the program. Not to be adapted: see README.md."""

import logging
from collections.abc import Iterable

import numpy as np

from drivers.burst_dialect import BurstDialect
from drivers.burst_generator import SMALLEST_VPP, BurstGenerator
from drivers.clock import Clock
from drivers.descent import Descent
from drivers.drive import Drive
from drivers.errors import BenchError, InstrumentError, LinkError
from drivers.keysight_33200 import Keysight33200
from drivers.ports import Choosy, Identity, Source
from drivers.scpi import Link, Scpi
from drivers.scpi_burst import ScpiBurstGenerator
from drivers.setting import Setting, between, near, word
from drivers.waveform import SINE, Points, block

log = logging.getLogger(__name__)

ALSO_USED = (BenchError, BurstDialect, BurstGenerator, Choosy, Descent, InstrumentError, LinkError, Scpi, Source)
"""Other labs import these."""

FULL_SCALE = 8191


class LabGenerator(ScpiBurstGenerator):
    """The dialect of a relabelled 33220A, written from the shared base of the program's own drivers."""

    MODELS = ("33220",)
    SOLD_AS = "Lab FG-20"
    HOLDS_RANGE = True
    MOST_CYCLES = 50_000

    def _armed_state(self, rest_v: float, low_v: float, high_v: float) -> Iterable[Setting]:
        yield self._load_state()
        yield from self._shared_state(rest_v)
        yield from (
            word("FUNC", "USER"),
            word("FUNC:USER", "VOLATILE"),
            near("BURS:PHAS", 0.0, 1e-3),
            word("TRIG:SOUR", "BUS"),
            between("VOLT", 0.0, 2 * SMALLEST_VPP),
            word("VOLT:RANG:AUTO", "0"),
        )

    def _set_up(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._declare_load()
        self._tell("VOLT:UNIT VPP", "UNIT:ANGL DEG", "VOLT:RANG:AUTO ON", "SWE:STAT OFF")
        self._tell(f"VOLT {SMALLEST_VPP}", "BURS:STAT OFF", f"VOLT:OFFS {rest_v:.6f}", "FORM:BORD NORM")
        self._held = None
        self._load(SINE)
        self._tell("FUNC:USER VOLATILE", "FUNC USER", "FREQ 100")
        self._tell("BURS:MODE TRIG", "BURS:NCYC 1", "BURS:PHAS 0", "TRIG:SOUR BUS", "BURS:STAT ON")
        self._freeze_range(rest_v, high_v - low_v)

    def _store(self, points: Points) -> None:
        counts = np.rint(points * FULL_SCALE).astype(">i2")
        self._tell(f"DATA:DAC VOLATILE,{block(counts.tobytes())}")

    def _vpp(self, points: Points, full_v: float) -> float:
        return float(np.ptp(points)) * full_v

    def _most_points(self) -> int:
        return 65_536


class WatchedGenerator:
    """A whole `Source` of its own that writes down what it is asked for; it has a generator of the program inside."""

    MODELS = ("33220",)

    def __init__(self, link: Link, clock: Clock, *, step_v: float = 0.05) -> None:
        self._box = Keysight33200(link, clock, step_v=step_v)
        self._clock = clock
        self.asked: list[str] = []

    @property
    def identity(self) -> Identity:
        return self._box.identity

    def at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        self._note("at_rest")
        return self._box.at_rest(rest_v, low_v, high_v)

    def prepare(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._note("prepare")
        self._box.prepare(rest_v, low_v, high_v)

    def play(self, drive: Drive) -> None:
        self._note("play")
        self._box.play(drive)

    def stop(self) -> None:
        self._note("stop")
        self._box.stop()

    def move(self, level_v: float, duration_s: float) -> None:
        self._note("move")
        self._box.move(level_v, duration_s)

    def idle_v(self) -> float:
        self._note("idle_v")
        return self._box.idle_v()

    def cannot(self, drive: Drive) -> str:
        self._note("cannot")
        return self._box.cannot(drive)

    def reconnect(self) -> None:
        self._box.reconnect()

    def close(self) -> None:
        self._box.close()

    def _note(self, what: str) -> None:
        self.asked.append(what)
        log.info("%.3f s: %s", self._clock.now(), what)
