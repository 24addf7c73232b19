"""Programmable DC supplies as a `Source` of levels and steps.

A supply raises its output within a millisecond and lets it *fall* as its load discharges it: without a load this takes tenths of
a second to seconds. Therefore a level counts as reached when the supply measures it, and a fall that takes longer than the bench
file allows is an error. The card's drive channel remains the reference for the volts.

The output is never switched off: off is 0 V (on an E3631A up to 0.6 V of the *other* sign), -500 V on the specimen. Over-voltage
protection trips the output off with the same effect: it is rejected if it could trip. Over-current protection, unlike the current
limit, trips it at an inrush: it is switched off, as are tracking and pairing of outputs.

A supply has no memory for a waveform: a thread steps it along a drive during the run.
"""

import math
import threading
from collections.abc import Callable
from functools import partial

import numpy as np

from drivers.clock import Clock
from drivers.drive_shapes import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, SquareWave, Steps
from drivers.errors import InstrumentError, LinkError
from drivers.supplies.dialects import SupplyChannel
from drivers.transport import Link, RampDown, join_commands

STEP_PERIOD_S = 2e-3
SLOW_WIRE_ROUND_TRIPS = 7
"""Number of replies that the pipelined way from a held level to rest waits for, without the fall of the output."""


class StaircaseThread(threading.Thread):
    """Steps a supply along a drive during the run; ends with the drive or at `stop`."""

    def __init__(self, supply: "DcSupply", drive: Ramp | Steps, clock: Clock) -> None:
        super().__init__(name="DC supply steps", daemon=True)
        self._supply, self._drive, self._clock = supply, drive, clock
        self._stop_requested = threading.Event()
        self._failure: BaseException | None = None
        self._start_s = clock.now()
        self.start()

    def run(self) -> None:
        try:
            while not self._stop_requested.wait(STEP_PERIOD_S):
                t = self._clock.now() - self._start_s
                level_v = self._supply.limited_step_to(float(self._drive.volts(np.array([t]))[0]))
                if level_v != self._supply.idle_level_v():
                    self._supply.set_level(level_v)
                elif t >= self._drive.duration_s:
                    return
        except Exception as error:  # noqa: BLE001 - `stop` returns it to the thread of the run
            self._failure = error

    def stop(self) -> BaseException | None:
        """Stop at the present level; return the error of the thread, if any."""
        self._stop_requested.set()
        self.join()
        return self._failure


LEVEL_TOLERANCE_V = 0.02
"""Programming and read-back accuracy of a bench supply at 5 V, together."""

SETTLED_V = 2e-3
"""Difference of two readings below which the output has stopped falling."""

CURRENT_TOLERANCE_A = 0.01
OVP_MARGIN_V = 0.3
FOREIGN_OUTPUT_RAMP_V_PER_S = 5.0
POLL_S = 0.01


class DcSupply:
    """One output of a supply as a `Source` (see drivers.interfaces) of levels and steps.

    Args:
        link: the connection.
        clock: bench time.
        channel: the output's number.
        current_limit_a: current limit for the amplifier's input; above it the voltage drops.
        fall_time_s: longest fall of the output through the whole range.
        step_v: largest single step of a staircase.

    Attributes:
        longest_settling_s: the longest wait for a level, in bench seconds.

    Raises:
        LinkError: nothing answers.
        InstrumentError: another instrument answers.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock,
        *,
        channel: int = 1,
        current_limit_a: float = 0.1,
        fall_time_s: float = 2.0,
        step_v: float = 0.05,
    ) -> None:
        self._output = SupplyChannel(link, channel, clock.now)
        self._name, self.identity = self._output.name, self._output.identity
        self._clock = clock
        self._current_limit_a, self._fall_time_s, self._step_v = current_limit_a, fall_time_s, step_v
        self._level_v = math.nan
        self._rest_v: float | None = None
        self._staircase: StaircaseThread | None = None
        self.on_failure: Callable[[BaseException], None] = lambda _: None
        self.longest_settling_s = 0.0

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        del low_v
        self._rest_v = rest_v
        return (
            not self._is_stepping()
            and self._output.is_output_on()
            and abs(self._output.measured_v() - rest_v) <= LEVEL_TOLERANCE_V
            and abs(self._output.current_limit_a() - self._current_limit_a) <= CURRENT_TOLERANCE_A
            and not self._output.reason_ovp_may_trip(high_v + OVP_MARGIN_V)
            and not self._output.persistent_mismatch()
        )

    def is_left_live(self, rest_v: float, low_v: float, high_v: float) -> bool:
        del low_v, high_v
        return self._output.is_output_on() and abs(self._output.measured_v() - rest_v) > LEVEL_TOLERANCE_V

    def initialize_at_rest(self, rest_v: float, low_v: float, high_v: float) -> None:
        del low_v
        self._rest_v = rest_v
        self._stop_staircase()
        self._output.clear_error_queue()
        if trouble := self._output.reason_ovp_may_trip(high_v + OVP_MARGIN_V):
            raise InstrumentError(f"{self._name}: {trouble}")
        self._output.reset_persistent_settings()
        if trouble := self._output.persistent_mismatch():
            raise InstrumentError(
                f"{self._name}: {trouble}, and it does not obey. It could take the output to 0 V, -500 V on the specimen, or to "
                "another level: switch it off at the front panel"
            )
        self._output.set_current_limit(self._current_limit_a)
        if self._output.is_output_on():  # a level of an earlier program is ramped to rest like any other
            self.ramp_to(rest_v, abs(self.idle_level_v() - rest_v) / FOREIGN_OUTPUT_RAMP_V_PER_S)
        self.set_level(rest_v)
        self._output.enable_output()
        if not self._output.is_output_on():
            raise InstrumentError(f"{self._name}: its output does not come on; look at its front panel")
        self._wait_for_level(rest_v)

    def start_drive(self, drive: Drive) -> None:
        match drive:
            case Hold():
                self._check_start_level(drive)
            case Ramp() | Steps():
                self._check_start_level(drive)
                self._staircase = StaircaseThread(self, drive, self._clock)
            case Sine() | LinearSweep() | PeriodicSweep() | SquareWave():
                raise InstrumentError(self.reason_unsupported(drive))

    def reason_unsupported(self, drive: Drive) -> str:
        steepest = self._step_v / STEP_PERIOD_S
        if isinstance(drive, Steps) and drive.slew_v_per_s > steepest * (1 + 1e-9):
            return (
                f"{self._name} follows {steepest:.3g} V/s at most, not {drive.slew_v_per_s:.4g} V/s; lengthen the rise of the "
                "steps, or use a generator or the card's output. Nothing was sent"
            )
        if not isinstance(drive, Sine | LinearSweep | PeriodicSweep | SquareWave):
            return ""
        return (
            f"{self._name} can hold and step, but not play a {drive.kind}: its output falls "
            f"in up to {self._fall_time_s:g} s. Use a generator or the card's output for it. Nothing was sent"
        )

    unattended_end = "the output stays at the level that was reached"

    def unattended_rest_s(self, drive: Drive, rest_v: float) -> float:
        del drive, rest_v
        return math.inf

    def stop(self) -> None:
        self._stop_staircase()
        RampDown(self._output.link).query(self._output.clear_error_queue)
        self._wait_for_level(self.idle_level_v())

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        self._stop_staircase()
        way = RampDown(
            self._output.link,
            best_effort=self._rest_v in (None, level_v),  # unknown in a watchdog, which only ramps to rest
            slow_reply_s=lambda: self._output.slow_reply_s,
            now=self._clock.now,
            join=join_commands,
            on_failure=self.on_failure,
        )
        start_v = self.idle_level_v()
        steps = max(math.ceil(abs(level_v - start_v) / self._step_v), 1)
        way.limit_duration(duration_s, steps, self._output.reply_s, getattr(self._clock, "speed", 1.0))
        try:
            for i in range(1, steps + 1):
                volts = start_v + (level_v - start_v) * i / steps
                way.step(self._output.voltage_command(volts), partial(self.set_level, volts))
                self._level_v = volts
                self._clock.sleep(duration_s / steps)
            way.flush()
        except LinkError:
            if way.is_pipelined:
                self._level_v = math.nan  # the number of executed steps is measured before the next ramp
            raise
        way.raise_first_error()
        self._wait_for_level(level_v)

    def predict_rest_s(self, distance_v: float, ramp_v_per_s: float) -> float:
        ramp_s = distance_v / ramp_v_per_s
        round_trips = SLOW_WIRE_ROUND_TRIPS
        if not self._output.slow_reply_s:
            round_trips += max(math.ceil(distance_v / self._step_v), 1)
        return ramp_s + round_trips * self._output.reply_s

    def idle_level_v(self) -> float:
        if math.isnan(self._level_v):
            self._level_v = self._output.measured_v()  # level of an earlier program: start from the measured level
        return self._level_v

    def is_output_on(self) -> bool:
        return self._output.is_output_on()

    def reconnect(self) -> None:
        self._output.reopen()
        self._level_v = math.nan

    def close(self) -> None:
        stairs, self._staircase = self._staircase, None
        if stairs is not None:
            stairs.stop()
        self._output.link.close()

    def set_level(self, level_v: float) -> None:
        """Set a level in one step."""
        self._output.set_voltage(level_v)
        self._level_v = level_v

    def limited_step_to(self, target_v: float) -> float:
        """Return the level towards the target, at most one step from the present one."""
        idle_v = self.idle_level_v()
        return idle_v + min(max(target_v - idle_v, -self._step_v), self._step_v)

    def _wait_for_level(self, level_v: float) -> None:
        """Wait until the output measures its level; falling is slow."""
        began_s, before_v = self._clock.now(), math.inf
        while True:
            seen_v = self._output.measured_v()
            if abs(seen_v - level_v) <= LEVEL_TOLERANCE_V and abs(seen_v - before_v) <= SETTLED_V:
                break
            before_v = seen_v
            waited_s = self._clock.now() - began_s
            if waited_s > self._fall_time_s:
                state = "is on" if self._output.is_output_on() else "has switched itself OFF"
                raise InstrumentError(
                    f"{self._name} was set to {level_v:.3f} V and measures {seen_v:.3f} V after {waited_s:.1f} s "
                    f"(limit {self._fall_time_s:g} s; its output {state}). If it falls slowly, put 1 kohm across its output "
                    "or raise fall_time_s; if it is low, look at its current limit and protection"
                )
            self._clock.sleep(POLL_S)
        self.longest_settling_s = max(self.longest_settling_s, self._clock.now() - began_s)

    def _check_start_level(self, drive: Drive) -> None:
        if self._is_stepping():
            raise InstrumentError(f"{self._name} still plays; stop that first. Nothing was sent")
        idle_v, begins_v = self.idle_level_v(), drive.end_levels_v[0]
        if abs(idle_v - begins_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._name} idles at {idle_v:.4f} V where the drive begins at {begins_v:.4f} V; nothing was sent"
            )

    def _is_stepping(self) -> bool:
        return self._staircase is not None and self._staircase.is_alive()

    def _stop_staircase(self) -> None:
        stairs, self._staircase = self._staircase, None
        if stairs is not None and (failure := stairs.stop()) is not None:
            raise failure
