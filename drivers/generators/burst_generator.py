"""What all function generators on this bench have in common: they rest in an armed burst of an arbitrary waveform.

A change of function, load or range can drop a box's output to 0 V, which is -500 V on the specimen. So all of them are set
once, before the output comes up. The function is the arbitrary waveform from first to last: its first point is the idle
level, which is the offset (33220A guide p. 227); a sine is one cycle of it repeated, a sweep or a row of steps is a waveform
played once, and a held level is an idle burst at another offset. Every drive is a finite burst: it comes back to the
offset by itself should this computer die.

Boxes differ in one thing that matters. Those that can freeze their attenuator's range carry a drive's amplitude as
amplitude, and are stopped by taking it down in small steps. Those that cannot would switch a relay on the way: they keep
one amplitude for ever, carry a drive's amplitude in the waveform's points, and are stopped by waiting for the end.

What differs between one burst generator and another: the words of its dialect, and what the box can do.

`drivers.generators.burst_generator` knows what to say when; a subclass of both fills this in.
"""

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from functools import partial
from typing import ClassVar

from drivers.clock import Clock
from drivers.drive import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, Steps
from drivers.errors import InstrumentError, LinkError
from drivers.generators.arbitrary_waveform import SINE, Points, cannot_hold, rendered
from drivers.generators.expected_setting import Setting
from drivers.interfaces import Identity
from drivers.transport.safe_ramp_down import Descent
from drivers.transport.scpi import Link, Scpi


class BurstDialect(ABC):
    """One box of one family on its wire.

    Args:
        link: the wire.
        clock: bench time, which paces the staircases.
        step_v: largest single step of a staircase in volts.
        pace_s: time between the steps of a staircase.

    Raises:
        LinkError: nothing answers on the wire.
        InstrumentError: another instrument answers.
    """

    MODELS: ClassVar[tuple[str, ...]]
    """How the model names begin that this dialect is for, in capitals."""
    SOLD_AS: ClassVar[str]
    HOLDS_RANGE: ClassVar[bool]
    SMOOTHS: ClassVar[bool] = False
    """Whether a filter smooths the waveform from point to point."""
    MOST_CYCLES: ClassVar[int] = 1_000_000

    def __init__(self, link: Link, clock: Clock, *, step_v: float = 0.05, pace_s: float = 0.002) -> None:
        self._scpi = Scpi(link, f"function generator at {link.name}")
        self._clock = clock
        self._step_v = step_v
        self._pace_s = pace_s
        self.identity: Identity = self._scpi.identify()
        if not self.identity.model.upper().startswith(self.MODELS):
            link.close()
            raise InstrumentError(
                f"{link.name} answered as '{self.identity}'; this driver is for {self.SOLD_AS}. "
                "Correct the driver or the resource in the bench file"
            )
        self._scpi.instrument = f"function generator {self.identity.model}"
        self._held: str | None = None  # what is in the waveform memory; unknown at first

    def reconnect(self) -> None:
        self._scpi.link.reopen()
        seen = self._scpi.identify()
        if seen != self.identity:
            raise LinkError(f"{self._scpi.link.name} now answers as '{seen}', not '{self.identity}'")
        self._held = None  # it may have been without power in between

    def close(self) -> None:
        self._scpi.link.close()

    def _vpp(self, points: Points, full_v: float) -> float:  # noqa: ARG002 - some boxes mean the points' own span
        """The amplitude setting at which a full point is `full_v` away from the offset."""
        return 2 * full_v

    @abstractmethod
    def idle_v(self) -> float: ...

    @abstractmethod
    def _armed_state(self, rest_v: float, low_v: float, high_v: float) -> Iterable[Setting]:
        """Everything that `_set_up` sets, as it reads back when the armed box rests; the output's switch apart."""

    @abstractmethod
    def _answer(self, name: str) -> str:
        """What the box answers for a setting of `_armed_state`."""

    @abstractmethod
    def _output_is_on(self) -> bool: ...

    @abstractmethod
    def _forget_errors(self) -> None:
        """Empty the error queue: what others left there is no answer to us."""

    @abstractmethod
    def _set_up(self, rest_v: float, low_v: float, high_v: float) -> None:
        """Everything but switching the output on; ends whatever may be playing once its amplitude is small."""

    @abstractmethod
    def _output_on(self) -> None: ...

    @abstractmethod
    def _offset_words(self, volts: float) -> str:
        """What sets the offset, without a query."""

    @abstractmethod
    def _set_offset(self, volts: float) -> None: ...

    @abstractmethod
    def _amplitude(self) -> float: ...

    @abstractmethod
    def _amplitude_words(self, vpp: float) -> str:
        """What sets the amplitude, without a query."""

    @abstractmethod
    def _set_amplitude(self, vpp: float) -> None: ...

    @abstractmethod
    def _set_rate(self, rate_hz: float, size: int) -> None:
        """Play the whole period of a waveform of `size` points so many times a second, and read that back."""

    @abstractmethod
    def _set_cycles(self, cycles: int) -> None: ...

    @abstractmethod
    def _longest_s(self) -> float:
        """How long a burst with the present settings lasts; 0 where no burst is armed."""

    @abstractmethod
    def _trigger(self) -> None: ...

    @abstractmethod
    def _cut_words(self) -> Sequence[str]:
        """What ends a running burst at once. Its amplitude is next to nothing by then."""

    @abstractmethod
    def _say(self, words: str) -> None:
        """Send one command and confirm it as far as the box can."""

    @abstractmethod
    def _store(self, points: Points) -> None:
        """Make this the waveform, without touching what the output shows at idle."""

    @abstractmethod
    def _most_points(self) -> int: ...


LEVEL_TOLERANCE_V = 1e-3
SMALLEST_VPP = 0.01
"""What a box that carries the drive in its amplitude idles with: too little to matter."""

CALM_V_PER_S = 5.0
"""How fast a level that an earlier program left is brought to rest before the box is set up anew."""

LONGEST_WAIT_S = 9.0
"""Longest drive of a box that can only be stopped by waiting: the card's buffer holds ten seconds."""

SMOOTHED = 0.1
"""Share of its span that a waveform may move from point to point where a filter smooths it."""


class BurstGenerator(BurstDialect):
    """A `Source` (see drivers.interfaces) over one dialect."""

    _ends_s: float | None = None
    """When what we began ends; unknown at first."""
    _rest_v: float | None = None
    """Where rest is: on the way there nothing is a reason to stay away from it."""
    _vpp_told: float | None = None
    _offset_told: float | None = None
    """What the box was told last, for when it cannot be asked."""

    def at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        self._rest_v = rest_v
        self._held = None  # whoever used the front panel may have put another waveform there
        if not self._output_is_on() or self._wrong(rest_v, low_v, high_v):
            return False
        if not self.HOLDS_RANGE:
            self.stop()  # a burst that somebody else began is seen in no setting
        return True

    def prepare(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._rest_v, self._held = rest_v, None
        self._forget_errors()
        limits = rest_v, low_v, high_v
        if self._output_is_on() and self._is_ours(*limits):
            self._calm(rest_v)
        if not self._output_is_on() or self._wrong(*limits):  # or else nothing that could drop the output is touched
            self._set_up(*limits)
            if wrong := self._wrong(*limits):
                output = "is on as it was found" if self._output_is_on() else "was not brought up"
                raise InstrumentError(
                    f"{self._scpi.instrument} does not read back as it was set up ({wrong}); its output {output}. Look at "
                    "its front panel, and switch it off and on"
                )
            self._output_on()
            if not self._output_is_on():
                raise InstrumentError(f"{self._scpi.instrument}: its output did not come on; look at its front panel")
        self._ends_s = self._clock.now()

    def play(self, drive: Drive) -> None:
        if why := self.cannot(drive):
            raise InstrumentError(why)
        match drive:
            case Hold(level_v, _):
                self._idle_must_be(level_v)
            case Ramp(start_v, stop_v, duration_s):
                self._idle_must_be(start_v)
                self.move(stop_v, duration_s)
            case Sine(frequency_hz, amplitude_v, offset_v, cycles):
                self._begin(SINE, amplitude_v, frequency_hz, cycles, offset_v)
            case LinearSweep() | Steps():
                points, full_v = rendered(drive, self._most_points(), self._jump_v(drive))
                self._begin(points, full_v, 1 / drive.duration_s, 1, drive.ends_v[0])
            case PeriodicSweep():
                points, full_v = rendered(drive, self._most_points(), self._jump_v(drive))
                self._begin(points, full_v, 1 / drive.period_s, drive.periods, drive.offset_v)

    def cannot(self, drive: Drive) -> str:
        name = self._scpi.instrument
        if isinstance(drive, LinearSweep | PeriodicSweep | Steps) and (
            why := cannot_hold(drive, self._most_points(), self._jump_v(drive))
        ):
            return f"{name}: {why}"
        cycles = drive.cycles if isinstance(drive, Sine) else drive.periods if isinstance(drive, PeriodicSweep) else 1
        if cycles > self.MOST_CYCLES:
            return f"{name} plays {self.MOST_CYCLES} cycles at most, not {cycles}; shorten the drive. Nothing was sent"
        if not self.HOLDS_RANGE and not isinstance(drive, Hold | Ramp) and drive.duration_s > LONGEST_WAIT_S:
            return (
                f"{name} cannot hold its range, so that a drive can only be stopped by waiting for its end; this one "
                f"lasts {drive.duration_s:.3g} s (limit {LONGEST_WAIT_S:g} s). Shorten it. Nothing was sent"
            )
        return ""

    def _jump_v(self, drive: Drive) -> float:
        return max(self._step_v, SMOOTHED * (drive.high_v - drive.low_v)) if self.SMOOTHS else self._step_v

    def stop(self) -> None:
        if not self.HOLDS_RANGE:
            self._wait_for_the_end()
            return
        way = Descent(self._scpi.link)
        way.ask(self._forget_errors)  # or the first step would be answered by what somebody else left in the queue
        amplitude = way.ask(self._amplitude)
        if amplitude is None:
            amplitude = self._vpp_told
        if amplitude is None:
            way.end()  # neither asked nor told: a step could be one up
            return
        # What cutting a running cycle leaves on the output is a few millivolts then, whatever the firmware makes of it.
        steps = max(math.ceil((amplitude - SMALLEST_VPP) / 2 / self._step_v), 0)
        for i in range(1, steps + 1):
            self._vpp_told = vpp = amplitude + (SMALLEST_VPP - amplitude) * i / steps
            way.step(self._amplitude_words(vpp), partial(self._set_amplitude, vpp))
            self._clock.sleep(self._pace_s)
        for words in self._cut_words():
            way.step(words, partial(self._say, words))
        left = way.ask(self._amplitude)
        way.end()
        if left is not None:
            self._agree(left, SMALLEST_VPP, SMALLEST_VPP, "the amplitude in volts peak to peak")

    def move(self, level_v: float, duration_s: float) -> None:
        way = Descent(self._scpi.link, stubborn=level_v == self._rest_v)
        start = way.ask(self.idle_v)
        if start is None:
            start = self._offset_told
        if start is None:
            way.end()
            return
        steps = max(math.ceil(abs(level_v - start) / self._step_v), math.ceil(duration_s / (4 * self._pace_s)), 1)
        for i in range(1, steps + 1):
            volts = start + (level_v - start) * i / steps
            self._offset_told = volts  # before it is told: if its answer is lost, we must assume that it obeyed
            way.step(self._offset_words(volts), partial(self._set_offset, volts))
            self._clock.sleep(duration_s / steps)
        reached = way.ask(self.idle_v)
        way.end()
        if reached is not None:
            self._agree(reached, level_v, LEVEL_TOLERANCE_V, "the offset in volts")

    def _wrong(self, rest_v: float, low_v: float, high_v: float) -> str:
        """The first setting that is not as it should be when armed and at rest, in words; empty where all are."""
        for setting in self._armed_state(rest_v, low_v, high_v):
            answer = self._answer(setting.name)
            if not setting.holds(answer):
                return f"{setting.name} is {answer[:40]}, not {setting.wanted}"
        return ""

    def _is_ours(self, rest_v: float, low_v: float, high_v: float) -> bool:
        """Whether it is armed as we arm it, whatever it plays or holds. In another state our volts may mean others."""
        how = (s for s in self._armed_state(rest_v, low_v, high_v) if s.words or math.isinf(s.high))
        return all(setting.holds(self._answer(setting.name)) for setting in how)

    def _calm(self, rest_v: float) -> None:
        """What an earlier program left playing or holding comes to rest as any drive does.

        High voltage is disabled here, and everything is set anew afterwards. But a person may have switched the wrong
        amplifier, and a specimen survives a mistake that is made gently.
        """
        self.stop()
        self.move(rest_v, abs(self.idle_v() - rest_v) / CALM_V_PER_S)

    def _wait_for_the_end(self) -> None:
        if self._ends_s is None:  # begun by somebody else: at the worst just now
            try:
                longest_s = self._longest_s()
            except LinkError:
                longest_s = LONGEST_WAIT_S
            self._ends_s = self._clock.now() + min(longest_s, LONGEST_WAIT_S)
        self._clock.sleep(self._ends_s - self._clock.now())
        Descent(self._scpi.link).ask(self._make_next_burst_short)

    def _make_next_burst_short(self) -> None:
        """Whoever finds the box idle later, and cannot know since when, need not wait long for a burst that is over."""
        self._set_cycles(1)
        self._set_rate(1000.0, SINE.size)

    def _change_amplitude(self, vpp: float) -> None:
        self._vpp_told = vpp
        self._set_amplitude(vpp)

    def _begin(self, points: Points, full_v: float, rate_hz: float, cycles: int, idle_v: float) -> None:
        """Play the waveform so many times, its whole period `rate_hz` times a second, a full point being `full_v`."""
        name, seconds = self._scpi.instrument, cycles / rate_hz
        self._idle_must_be(idle_v)
        if not self.HOLDS_RANGE:
            most_v = self._amplitude() / 2
            if full_v > most_v + LEVEL_TOLERANCE_V:
                raise InstrumentError(
                    f"{name} was set up for {most_v:.3g} V at most around where it idles, not {full_v:.3g} V; "
                    "lower the drive's amplitude, or arm the bench anew. Nothing was sent"
                )
            points, full_v = points * (full_v / most_v), most_v
        self._load(points)
        self._set_rate(rate_hz, points.size)
        self._set_cycles(cycles)
        if self.HOLDS_RANGE:
            wanted = self._vpp(points, full_v)
            self._change_amplitude(wanted)
            self._agree(self._amplitude(), wanted, LEVEL_TOLERANCE_V, "the amplitude in volts peak to peak")
        self._ends_s = self._clock.now() + seconds  # before it is told: if its answer is lost, we must assume it plays
        self._trigger()
        self._ends_s = self._clock.now() + seconds

    def _load(self, points: Points) -> None:
        wanted = hashlib.sha256(points.tobytes()).hexdigest()
        if wanted == self._held:
            return
        if self.HOLDS_RANGE:
            self._change_amplitude(SMALLEST_VPP)  # whatever a box does while it takes a waveform, it does it with this
        self._held = None
        self._store(points)
        self._held = wanted

    def _agree(self, seen: float, wanted: float, tolerance: float, what: str) -> None:
        if not abs(seen - wanted) <= tolerance:
            raise InstrumentError(
                f"{self._scpi.instrument}: {what} was set to {wanted:.6g} and reads back {seen:.6g} (limit ±{tolerance:.2g}); "
                "nothing more was sent. Look at the instrument's front panel for what it did instead"
            )

    def _idle_must_be(self, level_v: float) -> None:
        seen = self.idle_v()
        if abs(seen - level_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._scpi.instrument} idles at {seen:.4f} V where the drive begins at {level_v:.4f} V; nothing was sent"
            )
