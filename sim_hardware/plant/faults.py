"""Injectable faults of a simulated bench by name, and their active times in bench time."""

import math
import threading

import numpy as np

from model import Array, Mask

FAULT_DESCRIPTIONS = {
    "drive-cable-off": "the cable between generator and amplifier is off: the input is pulled down",
    "generator-power-off": "the generator loses mains: its output drops to the level the amplifier's input is pulled to",
    "output-tripped": "the generator's overload protection has opened its output: the amplifier's input is pulled down",
    "amplifier-limited": "the amplifier is at its current limit: its output follows at a thousandth of its slew rate",
    "sensor-out-of-range": "the laser sees no target and shows its out-of-range voltage",
    "sensor-stuck": "the laser sensor's output is stuck",
    "card-unplugged": "the card's USB cable is off",
    "card-overrun": "the card's buffer was overwritten before it was read",
    "grpc-gone": "the server of the card has died",
    "scpi-silent": "the generator neither obeys nor answers, its output continues",
    "scpi-late": "the generator obeys, but answers after the driver has given up",
    "scpi-garbled": "the generator obeys, its answers arrive as rubbish",
    "scpi-half": "the generator obeys, half of each answer arrives and no end of line",
    "scpi-previous": "the generator obeys, each answer is the one to the query before",
    "scpi-other-model": "another model obeys and answers on the wire; the output of the generator continues",
    "scpi-dropped": "the generator's connection is closed and no new one accepted",
    "interlock-line-off": "the wire of the interlock's heartbeat is off: its monostable sees no edge",
    "interlock-relay-stuck": "the interlock's relay sticks as it is, and stays closed where it is closed",
    "interlock-never-drops": "the interlock's monostable does not drop after an edge",
    "clock-drift": "the generator's clock runs 50 ppm faster than it should",
    "membrane-left-on": "the skin membrane is on the tactor, stretched by 2.54 mm, and is not taken off",
    "membrane-missing": "no membrane hangs between the clamps: the laser sees the base 20 mm below them",
    "weight-mislabelled": "the weight labelled 50 g weighs 61 g",
}
"""Name and description of every fault."""

INTERLOCK_FAULTS = ("interlock-line-off", "interlock-relay-stuck", "interlock-never-drops")
"""Faults of the interlock, without effect on a bench that has none."""

SPECIMEN_FAULTS = ("membrane-left-on", "membrane-missing", "weight-mislabelled")
"""Faults of the weights, masses and membrane that the operator mounts: they change results, not voltages."""


class FaultState:
    """The faults of one bench and their active times."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._intervals: dict[str, list[list[float]]] = {}
        self._active: frozenset[str] = frozenset()
        self.change_count = 0
        """Number of injections and ends of faults."""

    def inject(self, name: str, t: float) -> None:
        """Activate `name` from bench time `t`; no effect if it is active.

        Raises:
            ValueError: there is no such fault.
        """
        if name not in FAULT_DESCRIPTIONS:
            raise ValueError(f"there is no fault {name!r}: choose from {', '.join(FAULT_DESCRIPTIONS)}")
        with self._lock:
            spans = self._intervals.setdefault(name, [])
            if not spans or spans[-1][1] < math.inf:
                spans.append([t, math.inf])
                self._active |= {name}
                self.change_count += 1

    def clear(self, name: str, t: float) -> None:
        """Clear `name` at bench time `t`; no effect if it is not active."""
        with self._lock:
            spans = self._intervals.get(name, [])
            if spans and math.isinf(spans[-1][1]):
                spans[-1][1] = t
                self._active -= {name}
                self.change_count += 1

    def is_active(self, name: str) -> bool:
        """Whether `name` is active now. Instruments ask a dozen times for each message: it takes no lock."""
        return name in self._active

    def active_faults(self) -> tuple[str, ...]:
        """Return all active faults, in the order of `FAULT_DESCRIPTIONS`."""
        return tuple(name for name in FAULT_DESCRIPTIONS if self.is_active(name))

    def was_ever_active(self, name: str) -> bool:
        """Whether `name` was ever active."""
        with self._lock:
            return bool(self._intervals.get(name))

    def active_since(self, name: str, t: Array) -> Array:
        """Return the begin of the fault active at bench times `t`, same shape; NaN without an active fault."""
        with self._lock:
            spans = [tuple(span) for span in self._intervals.get(name, [])]
        begin_s = np.full(t.shape, np.nan)
        for begin, end in spans:
            begin_s[(t >= begin) & (t < end)] = begin
        return begin_s

    def was_active(self, name: str, t: Array) -> Mask:
        """Whether `name` was active at bench times `t`, same shape."""
        return ~np.isnan(self.active_since(name, t)) if self.was_ever_active(name) else np.zeros(t.shape, bool)
