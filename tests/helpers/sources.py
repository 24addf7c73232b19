"""Every supported source on a simulated bench, and what each protocol does there: runs, is adapted, or is refused."""

import re
from dataclasses import dataclass
from typing import Any

from app.config.bench_file import BenchConfig
from drivers.errors import BenchError
from protocols.base import Protocol
from protocols.registry import BUILT_IN_PROTOCOLS, PROTOCOLS
from protocols.rehearsal import adapt_to_source, rehearse
from tests.helpers.simulated_bench import laboratory, simulated

GENERATORS = (
    "33511B",
    "33210A",
    "33220A",
    "33250A",
    "DG1032Z",
    "DG812",
    "DG4162",
    "SDG1032X",
    "SDG2042X",
    "AFG3022C",
    "AFG1022",
)
"""A model of each size of memory of each driver."""

ALIKE = {
    "33511B": ("33522B", "33622A", "EDU33211A", "EDU33212A", "FG33532A"),
    "33220A": ("G5100A",),
    "DG1032Z": ("DG1022Z",),
    "DG812": ("DG811", "DG832", "DG952", "DG2072"),
    "SDG2042X": ("SDG2122X", "SDG6022X"),
    "AFG3022C": ("AFG3021C", "AFG3102", "AFG31022", "AFG31052", "AFG31101"),
}
"""Models for which the row of another one stands: the same driver, and nothing that it asks of the model differs."""

CARD, SUPPLY, LABJACK = "card's analogue output", "DC supply (E36312A)", "LabJack T7"

SOURCES = (*GENERATORS, CARD, LABJACK, SUPPLY)

SHORTER: dict[str, dict[str, Any]] = {
    "static-loading": {"weights_kg": (0.02,), "repeats": 1},
    "mass-resonance": {"masses_kg": (7.75e-3,), "sweep_s": 20.0, "piece_s": 10.0},
    "voltage-steps": {"levels_v": (0.5, 5.0), "repeats": 1},
    "hysteresis": {"frequencies_hz": (0.5, 1.0, 2.0, 5.0), "cycles": 4},
    "sine-dwell": {"frequencies_hz": (25.0, 150.0)},
    "square-dwell": {"frequencies_hz": (60.0, 160.0)},
    "membrane-series": {"frequencies_hz": (150.0,), "elongations_m": (6.35e-3,)},
    "free-decay": {"edges": 2},
    "latency": {"frequencies_hz": (150.0,), "repeats": 1},
    "endurance": {"cycles": 500, "block_cycles": 500},
    "electrical": {"frequencies_hz": (20.0, 400.0), "drives_v": (5.0,), "levels_v": (5.0,), "wait_s": 1.0},
}
"""Fewer points with the same drives, to run a protocol on every source."""


def source_bench(name: str) -> BenchConfig:
    """Return the bench file of a simulated bench with this source."""
    if name in GENERATORS:
        return simulated(generator={"model": name})
    if name == SUPPLY:
        return BenchConfig.model_validate({**simulated().model_dump(), "source": {"kind": "dc-supply"}})
    if name == LABJACK:
        table = {"kind": "labjack-output", "external_power": True}
        return BenchConfig.model_validate({**simulated().model_dump(), "source": table})
    truth = simulated(source="ao0")
    return BenchConfig.model_validate({**truth.model_dump(), "source": {"kind": "card-output"}})


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a protocol does on a source before anything is driven.

    Attributes:
        runs: whether it is played there.
        note: what is adapted, or why it is refused; empty where it runs as it is.
        unattended_s: after how long its longest drive is at rest by itself, program and watchdog dead.
    """

    runs: bool
    note: str = ""
    unattended_s: float = 0.0


def rehearsed(protocol: Protocol, lab: Any, source: str) -> Outcome:
    """Rehearse a protocol on a connected bench."""
    amplifier = lab.bench.amplifier
    try:
        rehearse(protocol, amplifier)
    except BenchError as refusal:
        return Outcome(False, _anonymous(str(refusal), source))
    note = _anonymous(adapt_to_source(protocol, amplifier).message, source)
    return Outcome(True, note, longest_unattended_s(protocol, amplifier))


def longest_unattended_s(protocol: Protocol, amplifier: Any) -> float:
    """Return after how long every drive of a protocol is at rest by itself, program and watchdog dead.

    In seconds, of the longest drive; infinite if one of them stays, 0 if nothing is driven.
    """
    rest_v = amplifier.map.rest_v
    adapted = protocol.adapted(rest_v, amplifier.reason_unsupported)
    drives = (drive for entry in adapted.plan(rest_v) for drive in entry.drives)
    return max((amplifier.unattended_rest_s(drive) for drive in drives), default=0.0)


def outcomes() -> dict[str, dict[str, Outcome]]:
    """Rehearse every protocol with its defaults on every source; by source, then by protocol."""
    found: dict[str, dict[str, Outcome]] = {}
    for source in SOURCES:
        with laboratory(source_bench(source)) as lab:
            found[source] = {
                name: rehearsed(PROTOCOLS[name].model_validate({}), lab, source) for name in BUILT_IN_PROTOCOLS
            }
    return found


def _anonymous(text: str, source: str) -> str:
    """Return a message without the name of the model, so that models with the same limits share it."""
    text = re.sub(r"(function generator|DC supply) [\w-]+", r"the \1", text)
    text = re.sub(r"T7 at [\d.]+ DAC0", "the LabJack", text)
    return text.replace(source, "the source")
