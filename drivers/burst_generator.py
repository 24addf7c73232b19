"""What all function generators on this bench have in common: they rest in an armed burst of an arbitrary waveform.

A change of function, load or range can drop a box's output to 0 V, which is -500 V on the specimen. So all of them are set
once, before the output comes up. The function is the arbitrary waveform from first to last: its first point is the idle
level, which is the offset (33220A guide p. 227); a sine is one cycle of it repeated, a sweep or a row of steps is a waveform
played once, and a held level is an idle burst at another offset. Every drive is a finite burst: it comes back to the
offset by itself should this computer die.

Boxes differ in one thing that matters. Those that can freeze their attenuator's range carry a drive's amplitude as
amplitude, and are stopped by taking it down in small steps. Those that cannot would switch a relay on the way: they keep
one amplitude for ever, carry a drive's amplitude in the waveform's points, and are stopped by waiting for the end.
"""

import hashlib
import math
from abc import ABC, abstractmethod
from typing import ClassVar

from drivers.clock import Clock
from drivers.drive import Drive, Hold, LinearSweep, Ramp, Sine, Steps
from drivers.errors import InstrumentError, LinkError
from drivers.ports import Identity
from drivers.scpi import Link, Scpi
from drivers.waveform import SINE, Points, rendered

LEVEL_TOLERANCE_V = 1e-3
SMALLEST_VPP = 0.01
"""What a box that carries the drive in its amplitude idles with: too little to matter."""

LONGEST_WAIT_S = 9.0
"""Longest drive of a box that can only be stopped by waiting: the card's buffer holds ten seconds."""

SMOOTHED = 0.1
"""Share of its span that a waveform may move from point to point where a filter smooths it."""


class BurstGenerator(ABC):
    """A `Source` (see drivers.ports) over one dialect: a subclass says the words, this class knows what to say when.

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
        self._ends_s: float | None = None  # when what we began ends; unknown at first

    def at_rest(self, rest_v: float) -> bool:
        return (
            self._is_armed()
            and abs(self.idle_v() - rest_v) <= LEVEL_TOLERANCE_V
            and (not self.HOLDS_RANGE or self._amplitude() <= 2 * SMALLEST_VPP)
        )

    def prepare(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._set_up(rest_v, low_v, high_v)
        self._agree(self.idle_v(), rest_v, LEVEL_TOLERANCE_V, "the offset in volts")
        if not self._is_armed(output=False):
            raise InstrumentError(
                f"{self._scpi.instrument} does not read back as an armed burst into an infinite load; the output was not "
                "brought up. Look at its front panel, and switch it off and on"
            )
        self._output_on()
        if not self._is_armed():
            raise InstrumentError(f"{self._scpi.instrument}: its output did not come on; look at its front panel")
        self._ends_s = self._clock.now()

    def play(self, drive: Drive) -> None:
        match drive:
            case Hold(level_v, _):
                self._idle_must_be(level_v)
            case Ramp(start_v, stop_v, duration_s):
                self._idle_must_be(start_v)
                self.move(stop_v, duration_s)
            case Sine(frequency_hz, amplitude_v, offset_v, cycles):
                self._begin(SINE, amplitude_v, frequency_hz, cycles, offset_v)
            case LinearSweep() | Steps():
                jump_v = max(self._step_v, SMOOTHED * (drive.high_v - drive.low_v)) if self.SMOOTHS else self._step_v
                points, full_v = rendered(drive, self._most_points(), jump_v, self._scpi.instrument)
                self._begin(points, full_v, 1 / drive.duration_s, 1, drive.ends_v[0])

    def stop(self) -> None:
        if not self.HOLDS_RANGE:
            if self._ends_s is None:  # begun by somebody else: at the worst just now
                self._ends_s = self._clock.now() + min(self._longest_s(), LONGEST_WAIT_S)
            self._clock.sleep(self._ends_s - self._clock.now())
            return
        # What cutting a running cycle leaves on the output is a few millivolts then, whatever the firmware makes of it.
        amplitude = self._amplitude()
        steps = max(math.ceil((amplitude - SMALLEST_VPP) / 2 / self._step_v), 0)
        for i in range(1, steps + 1):
            self._set_amplitude(amplitude + (SMALLEST_VPP - amplitude) * i / steps)
            self._clock.sleep(self._pace_s)
        self._cut()

    def move(self, level_v: float, duration_s: float) -> None:
        if not self.HOLDS_RANGE:  # whoever has to stop a held level later need not wait for a burst that is long over
            self._set_cycles(1)
            self._set_rate(1000.0, SINE.size)
        start = self.idle_v()
        steps = max(math.ceil(abs(level_v - start) / self._step_v), math.ceil(duration_s / (4 * self._pace_s)), 1)
        for i in range(1, steps + 1):
            self._set_offset(start + (level_v - start) * i / steps)
            self._clock.sleep(duration_s / steps)
        self._idle_must_be(level_v)

    @abstractmethod
    def idle_v(self) -> float: ...

    def reconnect(self) -> None:
        self._scpi.link.reopen()
        seen = self._scpi.identify()
        if seen != self.identity:
            raise LinkError(f"{self._scpi.link.name} now answers as '{seen}', not '{self.identity}'")
        self._held = None  # it may have been without power in between

    def close(self) -> None:
        self._scpi.link.close()

    def _begin(self, points: Points, full_v: float, rate_hz: float, cycles: int, idle_v: float) -> None:
        """Play the waveform so many times, its whole period `rate_hz` times a second, a full point being `full_v`."""
        name, seconds = self._scpi.instrument, cycles / rate_hz
        self._idle_must_be(idle_v)
        if cycles > self.MOST_CYCLES:
            raise InstrumentError(
                f"{name} plays {self.MOST_CYCLES} cycles at most, not {cycles}; shorten the drive. Nothing was sent"
            )
        if not self.HOLDS_RANGE:
            if seconds > LONGEST_WAIT_S:
                raise InstrumentError(
                    f"{name} cannot hold its range, so that a drive can only be stopped by waiting for its end; this one "
                    f"lasts {seconds:.3g} s (limit {LONGEST_WAIT_S:g} s). Shorten it. Nothing was sent"
                )
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
            self._set_amplitude(wanted)
            self._agree(self._amplitude(), wanted, LEVEL_TOLERANCE_V, "the amplitude in volts peak to peak")
        self._ends_s = self._clock.now() + seconds  # before it is told: if its answer is lost, we must assume it plays
        self._trigger()
        self._ends_s = self._clock.now() + seconds

    def _load(self, points: Points) -> None:
        wanted = hashlib.sha256(points.tobytes()).hexdigest()
        if wanted == self._held:
            return
        if self.HOLDS_RANGE:
            self._set_amplitude(SMALLEST_VPP)  # whatever a box does while it takes a waveform, it does it with this
        self._held = None
        self._store(points)
        self._held = wanted

    def _vpp(self, points: Points, full_v: float) -> float:  # noqa: ARG002 - some boxes mean the points' own span
        """The amplitude setting at which a full point is `full_v` away from the offset."""
        return 2 * full_v

    def _agree(self, seen: float, wanted: float, tolerance: float, what: str) -> None:
        if not abs(seen - wanted) <= tolerance:
            raise InstrumentError(
                f"{self._scpi.instrument}: {what} was set to {wanted:.6g} and reads back {seen:.6g} (limit +-{tolerance:.2g}); "
                "it was not played. Look at the instrument's front panel for what it did instead"
            )

    def _idle_must_be(self, level_v: float) -> None:
        seen = self.idle_v()
        if abs(seen - level_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._scpi.instrument} idles at {seen:.4f} V where the drive begins at {level_v:.4f} V; nothing was sent"
            )

    @abstractmethod
    def _is_armed(self, *, output: bool = True) -> bool:
        """Whether it reads back as an armed burst of a waveform into an infinite load, with its output on if asked."""

    @abstractmethod
    def _set_up(self, rest_v: float, low_v: float, high_v: float) -> None:
        """Everything but switching the output on."""

    @abstractmethod
    def _output_on(self) -> None: ...

    @abstractmethod
    def _set_offset(self, volts: float) -> None: ...

    @abstractmethod
    def _amplitude(self) -> float: ...

    @abstractmethod
    def _set_amplitude(self, vpp: float) -> None: ...

    @abstractmethod
    def _set_rate(self, rate_hz: float, size: int) -> None:
        """Play the whole period of a waveform of `size` points so many times a second, and read that back."""

    @abstractmethod
    def _set_cycles(self, cycles: int) -> None: ...

    @abstractmethod
    def _longest_s(self) -> float:
        """How long a burst with the present settings lasts; asked of boxes that cannot hold their range."""

    @abstractmethod
    def _trigger(self) -> None: ...

    @abstractmethod
    def _cut(self) -> None:
        """End a running burst at once; its amplitude is next to nothing by then."""

    @abstractmethod
    def _store(self, points: Points) -> None:
        """Make this the waveform, without touching what the output shows at idle."""

    @abstractmethod
    def _most_points(self) -> int: ...
