"""Plant of the simulated bench: amplifier and tactor on a fixed time grid, simulated on demand.

Input volts pass the amplifier's static map, its high-voltage switch and its slew limit. They and the weights on the
tactor drive its modes (sim_hardware.plant.stepper). When the setup changes during a run, the motion continues from its
present state with the modes of the new setup.
"""

import math
import threading
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import asdict, dataclass, replace
from enum import IntEnum
from itertools import pairwise
from typing import Any

import numpy as np

from drivers import Clock
from model import Array, flexible_clamp_lengths
from sim_hardware.plant.ageing import SpecimenAge
from sim_hardware.plant.creep import CreepModel
from sim_hardware.plant.faults import FaultState
from sim_hardware.plant.hysteresis import HysteresisModel
from sim_hardware.plant.parameters import AmplifierParameters, SimulationParameters
from sim_hardware.plant.room import Room
from sim_hardware.plant.setup_state import SetupState, initial_state, weight_force_n
from sim_hardware.plant.specimen_current import SpecimenCurrent
from sim_hardware.plant.stepper import BLOCK, Stepper, limit_slew
from sim_hardware.plant.voltage_history import VoltageHistory

CURRENT_LIMIT_SLEW_FRACTION = 1e-3
"""Share of its slew rate that the amplifier keeps at its current limit."""

RINGING_TOLERANCE_M = 1e-15
"""Largest ringing that counts as no motion."""

CREEP_TOLERANCE_M = 1e-9
"""Largest lag of the motion behind the creeping rest position that counts as no motion."""

PIECE_STEPS = 512 * BLOCK
"""Largest number of grid steps simulated together: longer arrays exceed the processor's cache."""

RINGING_STEPS = 80 * BLOCK
"""Number of grid steps under a constant drive between tests for ringing."""

_ADVANCING = (
    *("_next_step", "_valid_from", "_stepper", "_state", "_previous_specimen_v", "_previous_bending_v"),
    *("_previous_force_n", "_previous_bent_v", "_previous_pressing_n"),
)
_ADVANCING_MODELS = ("_voltage_creep", "_force_creep", "_hysteresis", "_specimen_current")
"""State changed by a simulated step, in addition to the rings."""

TOUCHDOWN_S = 2e-3
"""Duration of a weight's first touch."""


@dataclass(frozen=True, slots=True)
class SetupChange:
    """From `start_s` the setup is `state`; until `end_s` the weights' force changes to `final_force_n`.

    `impulse_ns` is the impulse of a weight at its touchdown.
    """

    start_s: float
    end_s: float
    state: SetupState
    initial_force_n: float = 0.0
    final_force_n: float = 0.0
    impulse_ns: float = 0.0

    def force_n(self, t: Array) -> Array:
        """Return the force at times `t` (n,), all after `start_s`."""
        share = np.clip((t - self.start_s) / max(self.end_s - self.start_s, 1e-9), 0.0, 1.0)
        force = self.initial_force_n + (self.final_force_n - self.initial_force_n) * share**2 * (3 - 2 * share)
        touch = np.clip((t - self.start_s) / TOUCHDOWN_S, 0.0, 1.0)
        return np.asarray(force + self.impulse_ns / TOUCHDOWN_S * math.pi / 2 * np.sin(math.pi * touch))


class ElectricalQuantity(IntEnum):
    """Electrical quantity of the specimen, at an input of the card."""

    VOLTAGE = 0
    CURRENT = 1
    CHARGE = 2


class Plant:
    """Displacement of the tactor's centre for the volts at the amplifier's input, and the weights on it.

    It remembers the last `window_s`; an unobserved gap longer than the tactor's own memory is not simulated.
    """

    def __init__(
        self, parameters: SimulationParameters, history: VoltageHistory, faults: FaultState | None = None
    ) -> None:
        self._parameters = parameters
        self._history = history
        self._faults = faults or FaultState()
        self._amplifier: AmplifierParameters = parameters.amplifier
        self._bending = parameters.electrical.bending
        self._rate = parameters.plant_rate_hz
        self._ring = np.zeros(max(BLOCK, math.ceil(parameters.window_s * self._rate / BLOCK) * BLOCK))
        self._electrical_rings = np.zeros((len(ElectricalQuantity), 0))
        """Of each quantity, kept after the first acquisition of one."""
        self._specimen_current: SpecimenCurrent | None = None
        self._lock = threading.RLock()
        self.room = Room(parameters.room)
        self._age = SpecimenAge(parameters.ageing, history, self.room)
        self._steppers: dict[tuple[object, ...], Stepper] = {}
        self._changes = [SetupChange(-math.inf, -math.inf, initial_state(parameters))]
        self._starts = [-math.inf]
        beyond = parameters.beyond
        self._voltage_creep = CreepModel(beyond.creep_per_decade, 1 / self._rate)
        self._force_creep = CreepModel(beyond.creep_per_decade, 1 / self._rate)
        map_ = parameters.amplifier.map
        self._hysteresis = HysteresisModel(
            beyond.hysteresis_width, *map_.specimen_v(np.array([map_.low_v, map_.high_v]))
        )
        self._previous_bent_v = self._previous_pressing_n = 0.0  # without creep
        self._next_step = 0  # first grid step not yet simulated
        self._valid_from = 0
        self._stepper = self._stepper_for(self._changes[0].state)
        self._state = self._stepper.steady_state(0.0, 0.0)
        self._previous_specimen_v = self._previous_bending_v = self._previous_force_n = 0.0
        self._last_step = 0  # first grid step never simulated
        self._checkpoint: dict[str, Any] | None = None
        """State before the provisional steps."""
        self._checkpoint_count = self._confirmed_step = 0
        self._is_reading_ahead = False

    @property
    def change_count(self) -> int:
        """Number of changes of voltage, faults and set-up."""
        return self._history.change_count + self._faults.change_count + len(self._changes)

    @contextmanager
    def reading_ahead(self, now_s: float) -> Iterator[None]:
        """Context of speculative simulation beyond `now_s`: a change discards the steps, `confirm` keeps them."""
        with self._lock, self._history.reading_ahead(now_s):
            self.discard_ahead()
            self._checkpoint = {name: getattr(self, name) for name in _ADVANCING}
            self._checkpoint |= {name: copy(getattr(self, name)) for name in _ADVANCING_MODELS}
            self._checkpoint_count, self._confirmed_step = self.change_count, self._next_step
            self._is_reading_ahead = True
            try:
                yield
            finally:
                self._is_reading_ahead = False

    def confirm(self, now_s: float) -> None:
        """Make the provisional steps until `now_s` final."""
        with self._lock:
            self._confirmed_step = math.floor(now_s * self._rate + 1e-6) // BLOCK * BLOCK
            self._history.mark_read((self._confirmed_step - 1) / self._rate)
            if self._confirmed_step >= self._next_step:
                self._checkpoint = None

    def discard_ahead(self) -> None:
        """Discard the provisional steps: simulate the final ones anew from the last checkpoint."""
        with self._lock:
            if self._checkpoint is None:
                return
            vars(self).update(self._checkpoint)
            self._checkpoint = None
            self._advance(self._confirmed_step - 1)

    def available_at(self, t: float) -> float:
        """Return the earliest bench time at which the displacement at `t` is final."""
        return ((math.ceil(t * self._rate) + 1) // BLOCK + 1) * BLOCK / self._rate

    def available_until(self, now: float) -> float:
        """Return the latest time with a final displacement at `now`."""
        return (math.floor(now * self._rate + 1e-6) // BLOCK * BLOCK - 2) / self._rate

    def schedule_change(
        self,
        clock: Clock,
        update: Callable[[SetupState], SetupState],
        delay_s: float = 0.0,
        transition_s: float = 0.0,
        landing_m_per_s: float = 0.0,
    ) -> float:
        """Change the set-up `delay_s` from now, or after the previous change; return the bench time of its end.

        `transition_s` is the duration of putting weights down or lifting them off; they land at `landing_m_per_s`.
        """
        # The plant's lock first, then the history's: the order in which a reader takes them.
        with self._lock, self._history.at_instant(clock) as now_s:
            last = self._changes[-1]
            start_s = max(now_s + delay_s, last.end_s)
            start_s = math.ceil(start_s * self._rate / BLOCK) * BLOCK / self._rate
            end_s = start_s + math.ceil(transition_s * self._rate / BLOCK) * BLOCK / self._rate
            now = update(last.state)
            after_n = weight_force_n(now, self._parameters, self._faults.is_active("weight-mislabelled"))
            placed_kg = sum(now.weights_kg) - sum(last.state.weights_kg)
            if placed_kg >= 0:
                self._append(SetupChange(start_s, end_s, now, last.final_force_n, after_n, placed_kg * landing_m_per_s))
            else:  # a held weight moves with the tactor until it is lifted off
                self._append(
                    SetupChange(
                        start_s, end_s, replace(now, weights_kg=last.state.weights_kg), last.final_force_n, after_n
                    )
                )
                self._append(SetupChange(end_s, end_s, now, after_n, after_n))
            return end_s

    @property
    def setup_state(self) -> SetupState:
        """The setup after all scheduled changes are complete."""
        return self._changes[-1].state

    def max_force_n(self, t: Array) -> Array:
        """Return the largest force of the weights until each time `t` (n,)."""
        with self._lock:
            reached = np.maximum.accumulate([change.final_force_n for change in self._changes])
            ends = [change.end_s for change in self._changes]
        return np.asarray(reached[np.searchsorted(ends, t, side="right") - 1])

    def displacement(self, t: Array) -> Array:
        """Return metres at past times `t`, ascending, shape (n,); 0 before the begin of the bench.

        By the cubic through four grid points, less h^2 / 12 w'': the drive of the stepper, linear over each step h, divides the response
        by 1 + (omega h)^2 / 12. Raises ValueError for times beyond the memory of the plant.
        """
        (before, low, high, after), share = self._around(self._ring, t)
        left = 1 - share
        w = left * low + share * high
        w -= left * (share * (1 + left) / 6 + 1 / 12) * (before - 2 * low + high)
        w -= share * (left * (1 + share) / 6 + 1 / 12) * (low - 2 * high + after)
        return np.where(t < 0, 0.0, w)

    def keep_electrical(self) -> None:
        """Keep volts on the specimen, current into it and charge, for `electrical`."""
        with self._lock:
            if self._specimen_current is None:
                self._electrical_rings = np.zeros((len(ElectricalQuantity), self._ring.size))
                self._electrical_rings[ElectricalQuantity.VOLTAGE] = self._previous_specimen_v
                self._specimen_current = SpecimenCurrent(self._parameters, self._previous_specimen_v)

    def electrical(self, quantity: ElectricalQuantity, t: Array) -> Array:
        """Return volts at the amplifier's output, amperes at its monitor, or coulombs sensed at past times `t`, as `displacement`."""
        self.keep_electrical()
        if quantity is ElectricalQuantity.CURRENT:  # a value of its ring is the mean over the step before it
            t = np.maximum(t - max(self._amplifier.current_monitor_delay_s - 0.5 / self._rate, 0.0), 0.0)
        (_, low, high, _), share = self._around(self._electrical_rings[quantity], t)
        return np.where(t < 0, 0.0, low + share * (high - low))

    def _around(self, ring: Array, t: Array) -> tuple[Array, Array]:
        """Return the values (4, n) at two grid points before and two after each time `t` (n,), and its place between the middle ones."""
        if not t.size:
            return np.zeros((4, 0)), np.zeros(0)
        place = np.maximum(t * self._rate, 0.0)
        low = place.astype(np.int64)
        with self._lock:
            first = max(0, int(low[0]) - 1)
            self._simulate(first, math.ceil(place[-1] - 1e-6) + 1)
            if first < max(self._valid_from, self._last_step - self._ring.size):
                memory_s = self._ring.size / self._rate
                raise ValueError(f"the plant remembers {memory_s:g} s; {t[0]:.3f} s is further back than that")
            values = ring.take(np.maximum(low + np.arange(-1, 3)[:, None], 0), mode="wrap")
        return values, place - low

    def _append(self, change: SetupChange) -> None:
        self._changes.append(change)
        self._starts.append(change.start_s)

    def _change_index(self, step: int) -> int:
        """Number of the change in force at a grid step."""
        return bisect_right(self._starts, (step + 1e-3) / self._rate) - 1

    def _stepper_for(self, state: SetupState) -> Stepper:
        difference = self._parameters.beyond.side_difference
        tactor = self._parameters.room.tactor_at(
            self._parameters.tactor, self.room.tactor_c(self._next_step / self._rate)
        )
        # A load bends the plate towards the lower side; a voltage bends it in both directions, with the mean.
        k2 = tactor.k2 * (1 + state.side * difference / 2) if state.weights_kg else tactor.k2
        key = (state.mass_kg, state.skin, k2, state.plate_mountings, tactor, self._age.value)
        if key not in self._steppers:
            bends = self._parameters.mounting.difference("plate", state.plate_mountings, self._parameters.seed)
            lengths = flexible_clamp_lengths(asdict(tactor), bends)
            there = self._age.tactor(replace(tactor, m_add=state.mass_kg, k2=k2, **lengths))
            self._steppers[key] = Stepper.for_tactor(there, state.skin, self._parameters.modes, 1 / self._rate)
        return self._steppers[key]

    def _simulate(self, first: int, last: int) -> None:
        if self._checkpoint_count != self.change_count and not self._is_reading_ahead:
            self.discard_ahead()
        self._skip_unobserved(first)
        self._advance(last)

    def _advance(self, last: int) -> None:
        """Simulate until a grid step, to the end of its block."""
        while self._next_step <= last:
            number = self._change_index(self._next_step)
            change = self._changes[number]
            self._age.reach(self._next_step / self._rate, change.state.earlier_cycles, self._specimen_current)
            stepper = self._stepper_for(change.state)
            if stepper is not self._stepper:
                self._state = stepper.converted_state(
                    self._stepper, self._state, self._previous_bending_v, self._previous_force_n
                )
                self._stepper = stepper
            # Bounded blocks limit memory when a long span is requested.
            stop = min((last // BLOCK + 1) * BLOCK, self._next_step + min(PIECE_STEPS, self._ring.size))
            if number + 1 < len(self._starts):
                stop = min(stop, round(self._starts[number + 1] * self._rate))
            if (still := self._quasi_static_displacement(change, stepper, stop)) is not None:
                w = still
                specimen = np.full(w.size, self._previous_specimen_v)
            else:
                if self._history.constant_between(self._next_step / self._rate, (stop - 1) / self._rate):
                    stop = min(stop, self._next_step + RINGING_STEPS)
                specimen = self._slew_limited(
                    self._next_step, self._requested_voltage(self._next_step, stop, change.state)
                )
                volts = self._bending_voltage(specimen, change.state)
                if (slow := self._slow_forces(change, stepper, stop)) is not None:
                    newtons, per_s = slow
                else:
                    newtons, per_s = self._forces(change, self._next_step, stop), None
                w, self._state = stepper.run(
                    volts, self._previous_bending_v, newtons, self._previous_force_n, self._state, per_s
                )
                self._previous_bending_v, self._previous_force_n = float(volts[-1]), float(newtons[-1])
            w = self._age.displacement(w)
            rings = [(self._ring, w)]
            if self._specimen_current is not None:
                outputs = self._specimen_current.process(specimen, change.state.side * w)
                rings += zip(self._electrical_rings, (specimen, *outputs), strict=True)
            begin = self._next_step % self._ring.size
            head = min(w.size, self._ring.size - begin)
            for ring, values in rings:
                ring[begin : begin + head] = values[:head]
                ring[: w.size - head] = values[head:]
            self._next_step = stop
            self._last_step = max(self._last_step, stop)

    def _quasi_static_displacement(self, change: SetupChange, stepper: Stepper, stop: int) -> Array | None:
        """Return the displacement with its creep until a grid step, for a constant drive without ringing; else None.

        Half of a bench's time is rest, and a held level is then as quick.
        """
        first_s = self._next_step / self._rate
        if first_s <= change.end_s + TOUCHDOWN_S or self._faults.was_ever_active("amplifier-limited"):
            return None
        if (constant := self._history.constant_between(first_s, (stop - 1) / self._rate)) is None:
            return None
        input_v, hv = constant
        specimen_v = float(self._amplifier.map.specimen_v(input_v)) if hv and not change.state.shorted else 0.0
        if specimen_v != self._previous_specimen_v:
            return None
        bent_v = float(self._hysteresis.process(np.array([self._bending * specimen_v]))[0])
        pressing_n = change.state.side * change.final_force_n  # keeps its creep when it is turned
        blocks = (stop - self._next_step) // BLOCK
        drives = [
            [change.state.side * each for each in creep.hold(drive, blocks)]
            for creep, drive in ((self._voltage_creep, bent_v), (self._force_creep, pressing_n))
        ]
        (volts, volts_per_s), (newtons, newtons_per_s) = drives
        starts = [float(each[0]) for each in (volts, newtons, volts_per_s, newtons_per_s)]
        ends = [float(each[-1]) for each in (volts, newtons, volts_per_s, newtons_per_s)]
        jump_m = stepper.yield_V * (starts[0] - self._previous_bending_v)
        jump_m += stepper.yield_F * (starts[1] - self._previous_force_n)
        ringing = np.abs(self._state - stepper.steady_state(*starts)).max(initial=0.0) * stepper.ringing
        tolerance_m = CREEP_TOLERANCE_M if self._parameters.beyond.creep_per_decade else RINGING_TOLERANCE_M
        if max(ringing, abs(jump_m)) > tolerance_m:
            return None
        if not self._parameters.beyond.creep_per_decade:
            return np.full(stop - self._next_step, stepper.yield_V * starts[0] + stepper.yield_F * starts[1])
        gap_s = blocks * BLOCK / self._rate
        self._voltage_creep.advance(bent_v, gap_s)
        self._force_creep.advance(pressing_n, gap_s)
        self._previous_bent_v, self._previous_pressing_n = bent_v, pressing_n
        self._previous_bending_v, self._previous_force_n = ends[:2]
        self._state = stepper.steady_state(*ends)
        edges = stepper.yield_V * volts + stepper.yield_F * newtons
        edges += stepper.delay_V * volts_per_s + stepper.delay_F * newtons_per_s
        return np.asarray(edges[:-1, None] + np.diff(edges)[:, None] * ((np.arange(BLOCK) + 1) / BLOCK)).ravel()

    def _skip_unobserved(self, first: int) -> None:
        """Skip the part of an unobserved span that has decayed before the next observation."""
        stepper = self._stepper_for(self._changes[self._change_index(first)].state)
        if stepper.slowest_decay <= 0:
            return
        start = (first - math.ceil(40 / stepper.slowest_decay * self._rate)) // BLOCK * BLOCK
        if start <= self._next_step + BLOCK:
            return
        change = self._changes[self._change_index(start - 1)]
        gap_s = (start - self._next_step) / self._rate
        self._age.reach(start / self._rate, change.state.earlier_cycles, self._specimen_current)
        self._next_step = self._valid_from = start
        volts = self._requested_voltage(start - 1, start, change.state)
        self._previous_specimen_v = float(volts[0])
        self._previous_bent_v = float(self._hysteresis.process(self._bending * volts)[0])
        side = change.state.side
        self._previous_pressing_n = side * float(self._weight_forces(change, start - 1, start)[0])
        self._voltage_creep.advance(self._previous_bent_v, gap_s)
        self._force_creep.advance(side * change.final_force_n, gap_s)
        if self._specimen_current is not None:
            self._specimen_current.advance(self._previous_specimen_v, gap_s)
        self._previous_bending_v = side * self._voltage_creep.crept(self._previous_bent_v)
        self._previous_force_n = side * self._force_creep.crept(self._previous_pressing_n)
        self._stepper = self._stepper_for(change.state)
        self._state = self._stepper.steady_state(self._previous_bending_v, self._previous_force_n)

    def _slow_forces(self, change: SetupChange, stepper: Stepper, stop: int) -> tuple[Array, Array] | None:
        """Return constant weights with their creep, and its rate, at the edges of blocks until `stop`; None if it is too fast."""
        pressing_n = change.state.side * change.final_force_n
        is_constant = self._next_step / self._rate > change.end_s + TOUCHDOWN_S
        if not is_constant or self._previous_pressing_n != pressing_n or not self._parameters.beyond.creep_per_decade:
            return None
        curvature = self._force_creep.curvature(pressing_n)
        if abs(stepper.yield_F) * curvature / float(np.abs(stepper.poles).min()) ** 2 > CREEP_TOLERANCE_M:
            return None
        newtons, newtons_per_s = self._force_creep.hold(pressing_n, (stop - self._next_step) // BLOCK)
        self._force_creep.advance(pressing_n, (stop - self._next_step) / self._rate)
        side = change.state.side
        return side * newtons, side * newtons_per_s

    def _forces(self, change: SetupChange, first: int, stop: int) -> Array:
        """Return the force of the weights at grid steps first..stop, all within one change, with its creep."""
        pressing = change.state.side * self._weight_forces(change, first, stop)
        before_n, self._previous_pressing_n = self._previous_pressing_n, float(pressing[-1])
        return change.state.side * self._force_creep.process(pressing, before_n)

    def _weight_forces(self, change: SetupChange, first: int, stop: int) -> Array:
        if first / self._rate > change.end_s + TOUCHDOWN_S:
            return np.full(stop - first, change.final_force_n)
        return change.force_n(np.arange(first, stop) / self._rate)

    def _bending_voltage(self, volts: Array, state: SetupState) -> Array:
        """Return the effective volts of the specimen with hysteresis and creep, with the sign of the upper side."""
        self._previous_specimen_v = float(volts[-1])
        bent = self._hysteresis.process(self._bending * volts)
        before_v, self._previous_bent_v = self._previous_bent_v, float(bent[-1])
        return state.side * self._voltage_creep.process(bent, before_v)

    def _slew_limited(self, first: int, requested: Array) -> Array:
        """Return the amplifier's output for its target volts from grid step `first`, by stretches of its limit."""
        if not self._faults.was_ever_active("amplifier-limited"):
            return limit_slew(requested, self._previous_specimen_v, self._amplifier.slew_v_per_s / self._rate)
        limited = self._faults.was_active("amplifier-limited", np.arange(first, first + requested.size) / self._rate)
        edges = [0, *(np.flatnonzero(np.diff(limited)) + 1).tolist(), requested.size]
        step_v, before_v = self._amplifier.slew_v_per_s / self._rate, self._previous_specimen_v
        volts = np.empty_like(requested)
        for begin, end in pairwise(edges):
            most_v = step_v * (CURRENT_LIMIT_SLEW_FRACTION if limited[begin] else 1.0)
            volts[begin:end] = limit_slew(requested[begin:end], before_v, most_v)
            before_v = float(volts[end - 1])
        return volts

    def _requested_voltage(self, first: int, stop: int, state: SetupState) -> Array:
        """Return the amplifier's target volts on the specimen, grid steps first..stop; 0 for shorted electrodes."""
        volts, hv = self._history.read(np.arange(first, stop) / self._rate)
        requested_v = self._amplifier.map.specimen_v(volts)
        if state.shorted:
            return np.zeros_like(requested_v)
        return requested_v if hv.all() else np.where(hv, requested_v, 0.0)
