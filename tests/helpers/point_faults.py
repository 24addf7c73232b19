"""Sensor faults planted in the middle of recordings of the simulated bench, and the points that are flagged.

Used by the test and by `docs/make_point_faults.py`. The faults act on the simulated sensor at stated bench times; the program
reads the card as in any run.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.config.bench_file import load_bench
from app.session.bench_connection import BenchConnection
from drivers import LevelAction
from protocols.base import Protocol, Quality
from protocols.registry import PROTOCOLS
from protocols.runfile.reader import Run
from protocols.runner.executor import StepExecutor
from tests.helpers.electrical.bench import bench_for
from tests.helpers.simulated_bench import Ran, laboratory, run

FAULTS = ("stuck", "jump", "dropout", "saturated", "moved")

SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "electrical": {
        "frequencies_hz": (60.0, 100.0, 300.0),
        "levels_v": (3.5, 4.5),
        "wait_s": 1.0,
        "sample_rate_hz": 9975.0,
    },
    "endurance": {
        "cycles": 1000,
        "block_cycles": 100,
        "spacing": "fixed",
        "interval_cycles": 100,
        "resonance_action": "off",
        "damage_action": "off",
    },
    "free-decay": {"edges": 20},
    "hysteresis": {"frequencies_hz": (1.0, 3.0, 5.0, 8.0, 10.0, 12.0, 15.0, 17.0)},
    "latency": {"repeats": 4},
    "mass-resonance": {"sweep_s": 8.0},
    "mass-resonance by dwells": {"method": "dwell", "dwells": 8, "low_hz": 150.0, "high_hz": 350.0},
    "membrane-sag": {"repeats": 10},
    "membrane-series": {"frequencies_hz": (60.0, 110.0, 160.0, 220.0)},
    "sine-dwell": {},
    "square-dwell": {},
    "static-loading": {"repeats": 1},
    "sweep": {"repeats": 10},
    "voltage-steps": {"repeats": 1},
    "wiring-check": {},
}
"""Parameters of each row of the table."""

NOISE_RATIO, RESPONSE_SHARE = 10.0, 0.02
"""Size of a fault: this multiple of the sensor's noise at rest, or this share of the recording's max - min, whichever is larger."""

DROPOUT_S = 5e-3


SPARED_ENTRIES = {"electrical": 1}
"""First entries of a row without a fault: a doubtful connection of the specimen ends the run there, before any higher voltage."""


@dataclass
class Twin:
    """The same run without a fault: its points, and the displacement of each recording by its entry, in order."""

    ran: Ran
    recordings: dict[int, list[np.ndarray]]


@dataclass
class Faults:
    """Plants one fault in one recording of each entry of a run.

    Args:
        lab: the simulated laboratory.
        twin: the run without faults.
        kinds: fault of each entry, in turn.
        seed: of moments, signs and recordings.
        spared: first entries without a fault.
    """

    lab: BenchConnection
    twin: Twin
    kinds: tuple[str, ...]
    seed: int
    spared: int
    planted: dict[int, str] = field(default_factory=dict)
    _seen: dict[int, int] = field(default_factory=dict)
    _moved_m: float = 0.0

    def record(self, make: Callable[[], Any], entry: int, duration_s: float, lead_s: float) -> Any:
        """Return the recording of an entry, made by `make`, with the entry's fault if it is its turn."""
        rng = np.random.default_rng((self.seed, entry))
        number, count = self._seen.get(entry, 0), len(self.twin.recordings[entry])
        self._seen[entry] = number + 1
        chosen = count - 1 if count == 2 else int(rng.integers(count))  # a latency uses the second of two
        if number % count != chosen or entry < self.spared:
            return make()
        kind = self.kinds[(entry + self.seed) % len(self.kinds)]
        self.planted[entry] = kind
        world = self.lab.control
        view, begin_s = world.laser_view, world.clock.now()
        share, sign = float(rng.uniform(0.3, 0.7)), float(rng.choice((-1.0, 1.0)))
        at_s = begin_s + lead_s + share * duration_s
        clean = self.twin.recordings[entry][chosen]
        sensor = self.lab.bench.sensor
        size_m = self.size_m(clean)
        match kind:
            case "stuck":
                world.faults.inject("sensor-stuck", at_s)
            case "jump" | "moved":
                view.apply_action(at_s, "bump-sensor", {"by_m": sign * size_m})
            case "dropout":
                view.apply_action(at_s, "bump-sensor", {"by_m": sign * size_m})
                view.apply_action(at_s + DROPOUT_S, "bump-sensor", {"by_m": -sign * size_m})
            case "saturated":
                noise_m = world.parameters.sensor.noise_m
                top_m = float(clean[int((share + 0.02) * clean.size) :].max()) - 3 * noise_m
                gain = world.parameters.sensor.gain_m_per_v / sensor.gain_m_per_v
                view.apply_action(at_s, "limit-sensor", {"at_m": gain * (top_m - size_m) + self._moved_m})
        recording = make()
        match kind:
            case "stuck":
                world.faults.clear("sensor-stuck", world.clock.now())
            case "jump":
                view.apply_action(world.clock.now(), "bump-sensor", {"by_m": -sign * size_m})
            case "moved":
                self._moved_m += sign * size_m
            case "saturated":
                view.apply_action(world.clock.now(), "limit-sensor", {"at_m": np.inf})
        return recording

    def size_m(self, clean: np.ndarray) -> float:
        """Return the size of a fault in a recording."""
        return max(NOISE_RATIO * self.lab.control.parameters.sensor.noise_m, RESPONSE_SHARE * float(np.ptp(clean)))


def protocol_of(row: str) -> Protocol:
    """Return the protocol of a row of the table."""
    return PROTOCOLS[row.partition(" by ")[0]](**SETTINGS[row])


@contextmanager
def _bench(row: str, name: str, seed: int) -> Iterator[BenchConnection]:
    config = bench_for(row.partition(" by ")[0], load_bench(name))
    record = {**(config.simulation or {}), "fresh_noise": False, "noise_seed": seed, "seed": seed}
    with laboratory(config.model_copy(update={"simulation": record})) as lab:
        lab.control.history.keeps_past = True
        off = LevelAction.OFF  # an exceeded level would end the run
        lab.bench.levels = replace(lab.bench.levels, rate=off, stroke=off, laser_lost=off, no_response=off)
        yield lab


def clean_run(row: str, bench: str, seed: int, folder: Path) -> Twin:
    """Return a run without faults."""
    with _bench(row, bench, seed) as lab:
        ran = run(protocol_of(row), folder, lab)
    recordings: dict[int, list[np.ndarray]] = {}
    with Run(ran.path) as file:
        for recording in file.trace.recordings():
            recordings.setdefault(recording.entry, []).append(recording.displacement_m)
    return Twin(ran, recordings)


def faulty_run(
    row: str, bench: str, seed: int, folder: Path, twin: Twin, kinds: tuple[str, ...] = FAULTS
) -> Iterator[tuple[str, bool]]:
    """Yield fault, and whether the point is flagged or missing, of each entry."""
    with _bench(row, bench, seed) as lab, pytest.MonkeyPatch.context() as patch:
        faults = Faults(lab, twin, kinds, seed, SPARED_ENTRIES.get(row, 0))
        real = StepExecutor._record

        def recorded(executor: Any, armed: Any, drive: Any, step: Any, settled: Any, entry: int, longest: float) -> Any:
            def make() -> Any:
                return real(executor, armed, drive, step, settled, entry, longest)

            return faults.record(make, entry, step.duration_s, step.lead_s if step.drive is not None else 0.0)

        patch.setattr(StepExecutor, "_record", recorded)
        ran = run(protocol_of(row), folder, lab)
    found = {event.entry: Quality(int(event.point.quality)) for event in ran.events if event.kind == "PointMeasured"}
    for entry, kind in faults.planted.items():
        quality = found.get(entry)
        yield kind, quality is None or not quality.usable
