"""Injectable faults of a simulated bench by name, and their active times in bench time."""

import math
import threading
import tomllib
from importlib.resources import files

import numpy as np

from model import Array, Mask

FAULTS: dict[str, dict[str, str]] = tomllib.loads(
    files("sim_hardware.plant").joinpath("faults.toml").read_text("utf-8")
)
"""Group, short name and description of every fault, by its name."""

FAULT_DESCRIPTIONS = {name: fault["description"] for name, fault in FAULTS.items()}

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
