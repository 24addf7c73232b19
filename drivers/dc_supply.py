"""Programmable DC supplies as a `Source` that can hold and step, and nothing faster.

A supply pushes its output up within a millisecond and lets it *fall* as its load takes the charge out: without a load
that takes tenths of a second to seconds. So a level counts as reached when the supply measures it there, and a fall that
takes longer than the bench file says is a sentence. The card's drive channel stays the truth about the volts.

The output is never switched off from here: off is 0 V (on an E3631A up to 0.6 V of the *other* sign), -500 V on the
specimen. Over-voltage protection trips the output off and so does the same: it is refused where it could trip.
"""

import math
import re
import threading
from functools import partial

from drivers.clock import Clock
from drivers.descent import Descent
from drivers.drive import Drive, Hold, LinearSweep, Ramp, Sine, Steps
from drivers.errors import InstrumentError, LinkError
from drivers.ports import Identity
from drivers.scpi import Link, Scpi
from drivers.supply_dialects import DIALECTS
from drivers.supply_stairs import Stairs

LEVEL_TOLERANCE_V = 0.02
"""Programming and read-back accuracy of a bench supply at 5 V, together."""

STILL_V = 2e-3
"""Two readings that differ by less: the output has stopped falling."""

CURRENT_TOLERANCE_A = 0.01
OVP_MARGIN_V = 0.3
POLL_S = 0.01


class DcSupply:
    """One output of a supply as a `Source` (see drivers.ports). It holds and steps.

    Args:
        link: the wire.
        clock: bench time.
        channel: the output's number.
        current_limit_a: what the amplifier's input may draw before the supply gives way and its volts drop.
        fall_time_s: how long the output may take to fall through the whole range.
        step_v: largest single step of a staircase.

    Attributes:
        fall_s: the longest wait for a level so far, in bench seconds.

    Raises:
        LinkError: nothing answers on the wire.
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
        self._scpi = Scpi(link, f"DC supply at {link.name}")
        self._clock, self._channel = clock, channel
        self._current_a, self._fall_time_s, self._step_v = current_limit_a, fall_time_s, step_v
        self.identity: Identity = self._scpi.identify()
        fits = [d for d in DIALECTS if re.match(d.models, self.identity.model, re.IGNORECASE)]
        if not fits:
            link.close()
            raise InstrumentError(
                f"{link.name} answered as '{self.identity}'; this driver is for {', '.join(d.name for d in DIALECTS)}. "
                "Correct the driver or the resource in the bench file"
            )
        self._words = fits[0]
        self._scpi.instrument = f"DC supply {self.identity.model}"
        self._level_v = math.nan
        self._rest_v: float | None = None
        self._lock = threading.RLock()
        self._stairs: Stairs | None = None
        self.fall_s = 0.0

    def at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        del low_v
        self._rest_v = rest_v
        return (
            not self._plays()
            and self._is_on()
            and abs(self._measure() - rest_v) <= LEVEL_TOLERANCE_V
            and abs(self._number(self._words.current_is) - self._current_a) <= CURRENT_TOLERANCE_A
            and not self._could_trip(high_v)
        )

    def prepare(self, rest_v: float, low_v: float, high_v: float) -> None:
        del low_v
        self._rest_v = rest_v
        self._stop_stairs()
        self._forget_errors()
        if trouble := self._could_trip(high_v):
            raise InstrumentError(f"{self._scpi.instrument}: {trouble}")
        self._tell(self._words.current, self._current_a)
        self.set_level(rest_v)
        self._tell(self._words.on, 0.0)
        if not self._is_on():
            raise InstrumentError(f"{self._scpi.instrument}: its output does not come on; look at its front panel")
        self._arrive(rest_v)

    def play(self, drive: Drive) -> None:
        match drive:
            case Hold():
                self._must_begin_here(drive)
            case Ramp() | Steps():
                self._must_begin_here(drive)
                self._stairs = Stairs(self, drive, self._clock)
            case Sine() | LinearSweep():
                raise InstrumentError(self.cannot(drive))

    def cannot(self, drive: Drive) -> str:
        if not isinstance(drive, Sine | LinearSweep):
            return ""
        return (
            f"{self._scpi.instrument} can hold and step, but not play a {type(drive).__name__}: its output falls "
            f"in up to {self._fall_time_s:g} s. Use a generator or the card's output for it. Nothing was sent"
        )

    def stop(self) -> None:
        self._stop_stairs()
        Descent(self._scpi.link).ask(self._forget_errors)
        self._arrive(self.idle_v())

    def move(self, level_v: float, duration_s: float) -> None:
        self._stop_stairs()
        way = Descent(self._scpi.link, stubborn=level_v == self._rest_v)
        start_v = self.idle_v()
        steps = max(math.ceil(abs(level_v - start_v) / self._step_v), 1)
        for i in range(1, steps + 1):
            volts = start_v + (level_v - start_v) * i / steps
            way.step(self._command(self._words.volts, volts), partial(self.set_level, volts))
            self._level_v = volts
            self._clock.sleep(duration_s / steps)
        way.end()
        self._arrive(level_v)

    def idle_v(self) -> float:
        if math.isnan(self._level_v):
            self._level_v = self._measure()  # whoever set it before us: where it measures is where we start from
        return self._level_v

    def reconnect(self) -> None:
        with self._lock:
            self._scpi.link.reopen()
            seen = self._scpi.identify()
        if seen != self.identity:
            raise LinkError(f"{self._scpi.link.name} now answers as '{seen}', not '{self.identity}'")
        self._level_v = math.nan

    def close(self) -> None:
        stairs, self._stairs = self._stairs, None
        if stairs is not None:
            stairs.end()
        self._scpi.link.close()

    def set_level(self, level_v: float) -> None:
        """One step, at once."""
        self._tell(self._words.volts, level_v)
        self._level_v = level_v

    def towards(self, wanted_v: float) -> float:
        """The level at most one step from the present one."""
        idle_v = self.idle_v()
        return idle_v + min(max(wanted_v - idle_v, -self._step_v), self._step_v)

    def _arrive(self, level_v: float) -> None:
        """Wait until the output measures its level; falling takes a while."""
        began_s, before_v = self._clock.now(), math.inf
        while True:
            seen_v = self._measure()
            if abs(seen_v - level_v) <= LEVEL_TOLERANCE_V and abs(seen_v - before_v) <= STILL_V:
                break
            before_v = seen_v
            waited_s = self._clock.now() - began_s
            if waited_s > self._fall_time_s:
                state = "is on" if self._is_on() else "has switched itself OFF"
                raise InstrumentError(
                    f"{self._scpi.instrument} was set to {level_v:.3f} V and measures {seen_v:.3f} V after {waited_s:.1f} s "
                    f"(limit {self._fall_time_s:g} s; its output {state}). If it falls slowly, put 1 kohm across its output "
                    "or raise fall_time_s; if it is low, look at its current limit and protection"
                )
            self._clock.sleep(POLL_S)
        self.fall_s = max(self.fall_s, self._clock.now() - began_s)

    def _could_trip(self, high_v: float) -> str:
        """What is wrong with the over-voltage protection, in a sentence; empty where it cannot take the output off."""
        words = self._words
        if words.tripped and self._says_yes(words.tripped):
            return "its over-voltage protection has tripped; clear it at the front panel"
        if words.ovp and self._says_yes(words.ovp):
            ovp_v, least_v = self._number(words.ovp_v), high_v + OVP_MARGIN_V
            if ovp_v < least_v:
                return (
                    f"its over-voltage protection at {ovp_v:g} V could trip within the amplifier's {high_v:g} V. A trip is "
                    f"0 V, -500 V on the specimen: set it to at least {least_v:g} V or off"
                )
        return ""

    def _must_begin_here(self, drive: Drive) -> None:
        if self._plays():
            raise InstrumentError(f"{self._scpi.instrument} still plays; stop that first. Nothing was sent")
        idle_v, begins_v = self.idle_v(), drive.ends_v[0]
        if abs(idle_v - begins_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._scpi.instrument} idles at {idle_v:.4f} V where the drive begins at {begins_v:.4f} V; "
                "nothing was sent"
            )

    def _plays(self) -> bool:
        return self._stairs is not None and self._stairs.is_alive()

    def _stop_stairs(self) -> None:
        stairs, self._stairs = self._stairs, None
        if stairs is not None and (failure := stairs.end()) is not None:
            raise failure

    def _is_on(self) -> bool:
        if self._words.status_word:
            with self._lock:
                answer = self._scpi.ask(self._words.is_on)
            try:
                return bool(int(answer, 16) >> (3 + self._channel) & 1)
            except ValueError:
                raise LinkError(
                    f"{self._scpi.instrument}: '{answer[:60]}' is no status word; check the cable"
                ) from None
        return self._says_yes(self._words.is_on)

    def _says_yes(self, query: str) -> bool:
        with self._lock:
            answer = self._scpi.ask(query.format(ch=self._channel)).upper()
        if answer not in ("1", "+1", "ON", "YES", "0", "+0", "OFF", "NO"):
            raise LinkError(f"{self._scpi.instrument}: '{answer[:60]}', which is no yes or no; check the cable")
        return answer in ("1", "+1", "ON", "YES")

    def _measure(self) -> float:
        return self._number(self._words.measure)

    def _number(self, query: str) -> float:
        with self._lock:
            return self._scpi.ask_number(query.format(ch=self._channel))

    def _command(self, words: str, value: float) -> str:
        return words.format(ch=self._channel, v=value)

    def _forget_errors(self) -> None:
        self._tell("*CLS", 0.0)

    def _tell(self, words: str, value: float) -> None:
        command = self._command(words, value)
        with self._lock:
            if self._words.compound:
                self._scpi.tell(command)
                return
            self._scpi.link.write(command)
            answer = self._scpi.ask("SYST:ERR?")
        name, code = self._scpi.instrument, re.match(r"\s*[+-]?\d+", answer)
        if code is None:
            raise LinkError(f"{name}: '{command}' was answered by '{answer[:60]}', which is no error report")
        if int(code[0]):
            raise InstrumentError(f"{name} refused '{command}': {answer}")
