"""Keysight 33500B/33600A (Trueform) function generators.

Rest is an *armed burst*: the box idles at offset + waveform at the burst's start phase, which for a sine at 0 degrees
is the offset (33210A guide p. 215; 81160A p. 357). So the function is a sine from the first moment to the last, a drive
starts at the offset with known phase, a finite burst comes back to rest by itself should this computer die, and a DC
level is a burst that idles at another offset. Nothing here changes the function, the load or the range while the
output is on: each of those can drop the output to 0 V, which is -500 V on the specimen.

Sources: 33500 Operating and Service Guide, chapters BURSt, VOLTage, OUTPut; traps collected in docs/safety.md.
"""

import math

from drivers.clock import Clock
from drivers.drive import Drive, Hold, Ramp, Sine
from drivers.errors import InstrumentError, LinkError
from drivers.ports import Identity
from drivers.scpi import Link, Scpi

LEVEL_TOLERANCE_V = 1e-3
SMALLEST_VPP = 0.01
"""A burst idles with this amplitude armed: the least the box takes at this range, and too little to matter."""


class Keysight33500:
    """A `Source` (see drivers.ports) that idles in an armed burst.

    Args:
        link: the wire.
        clock: bench time, which paces the staircases.
        step_v: largest single step of a staircase in volts.
        pace_s: time between the steps of a staircase.

    Raises:
        LinkError: nothing answers on the wire.
        InstrumentError: another instrument answers.
    """

    def __init__(self, link: Link, clock: Clock, *, step_v: float = 0.05, pace_s: float = 0.002) -> None:
        self._scpi = Scpi(link, f"function generator at {link.name}")
        self._clock = clock
        self._step_v = step_v
        self._pace_s = pace_s
        self.identity: Identity = self._scpi.identify()
        if not self.identity.model.upper().startswith(("335", "336")):
            link.close()
            raise InstrumentError(
                f"{link.name} answered as '{self.identity}'; this driver is for Keysight 33500B and 33600A. "
                "Correct the driver or the resource in the bench file"
            )
        self._scpi.instrument = f"function generator {self.identity.model}"

    def at_rest(self, rest_v: float) -> bool:
        ask, number = self._scpi.ask, self._scpi.ask_number
        return (
            number("OUTP?") == 1
            and number("OUTP:LOAD?") > 1e9
            and ask("FUNC?") == "SIN"
            and number("BURS:STAT?") == 1
            and ask("TRIG:SOUR?") == "BUS"
            and abs(self.idle_v() - rest_v) <= LEVEL_TOLERANCE_V
            and number("VOLT?") <= 2 * SMALLEST_VPP
        )

    def prepare(self, rest_v: float, low_v: float, high_v: float) -> None:
        tell = self._scpi.tell
        tell("*CLS")
        tell("VOLT:LIM:STAT OFF")  # limits forbid changing the load, so the load comes first
        tell("OUTP:LOAD INF")  # declared 50 ohm, the amplifier would get twice what is asked
        self._scpi.confirm("OUTP:LOAD?", 9.9e37, 1e36, "the load (infinite)")
        for command in ("VOLT:UNIT VPP", "UNIT:ANGL DEG", "VOLT:RANG:AUTO ON", "FREQ 100"):
            tell(command)
        # In this order no intermediate setting conflicts with the box's present one.
        for command in (f"VOLT {SMALLEST_VPP}", "FUNC SIN", f"VOLT:OFFS {rest_v:.6f}"):
            tell(command)
        for command in ("BURS:MODE TRIG", "BURS:NCYC 1", "BURS:PHAS 0", "TRIG:SOUR BUS", "BURS:STAT ON"):
            tell(command)
        # Freeze the attenuator at the range of the largest sine this bench may ask for: a relay that switches later
        # drops the output to 0 V for some milliseconds (E1441A guide p. 99).
        for command in (f"VOLT {high_v - low_v:.6f}", "VOLT:RANG:AUTO OFF", f"VOLT {SMALLEST_VPP}"):
            tell(command)
        # The armed but idle burst counts against the box's limits, so they leave room for its small amplitude.
        low_v, high_v = low_v - SMALLEST_VPP / 2, high_v + SMALLEST_VPP / 2
        for command in (f"VOLT:LIM:LOW {low_v:.6f}", f"VOLT:LIM:HIGH {high_v:.6f}", "VOLT:LIM:STAT ON"):
            tell(command)
        self._scpi.confirm("VOLT:OFFS?", rest_v, LEVEL_TOLERANCE_V, "the offset in volts")
        self._scpi.confirm("VOLT?", SMALLEST_VPP, LEVEL_TOLERANCE_V, "the amplitude in volts peak to peak")
        self._scpi.confirm("BURS:STAT?", 1, 0, "burst mode")
        tell("OUTP ON")
        self._scpi.confirm("OUTP?", 1, 0, "the output")

    def play(self, drive: Drive) -> None:
        match drive:
            case Sine(frequency_hz, amplitude_v, offset_v, cycles):
                self._idle_must_be(offset_v)
                tell = self._scpi.tell
                tell(f"FREQ {frequency_hz:.9g}")
                tell(f"BURS:NCYC {cycles:d}")
                tell(f"VOLT {2 * amplitude_v:.6f}")
                self._scpi.confirm("FREQ?", frequency_hz, 1e-6 * frequency_hz + 1e-6, "the frequency in hertz")
                self._scpi.confirm("VOLT?", 2 * amplitude_v, LEVEL_TOLERANCE_V, "the amplitude in volts peak to peak")
                tell("*TRG")
            case Hold(level_v, _):
                self._idle_must_be(level_v)
            case Ramp(start_v, stop_v, duration_s):
                self._idle_must_be(start_v)
                self.move(stop_v, duration_s)
            case _:
                raise InstrumentError(
                    f"{self._scpi.instrument}: this driver cannot play a {type(drive).__name__} yet; nothing was sent"
                )

    def stop(self) -> None:
        # The amplitude goes down in steps before the burst is aborted: what ABORt leaves on the output when it cuts a
        # running cycle is then a few millivolts, whatever the firmware makes of it.
        amplitude = self._scpi.ask_number("VOLT?")
        steps = max(math.ceil((amplitude - SMALLEST_VPP) / 2 / self._step_v), 0)
        for i in range(1, steps + 1):
            self._scpi.tell(f"VOLT {amplitude + (SMALLEST_VPP - amplitude) * i / steps:.6f}")
            self._clock.sleep(self._pace_s)
        self._scpi.tell("ABOR")

    def move(self, level_v: float, duration_s: float) -> None:
        start = self.idle_v()
        steps = max(math.ceil(abs(level_v - start) / self._step_v), math.ceil(duration_s / (4 * self._pace_s)), 1)
        for i in range(1, steps + 1):
            self._scpi.tell(f"VOLT:OFFS {start + (level_v - start) * i / steps:.6f}")
            self._clock.sleep(duration_s / steps)
        self._idle_must_be(level_v)

    def idle_v(self) -> float:
        return self._scpi.ask_number("VOLT:OFFS?")

    def reconnect(self) -> None:
        self._scpi.link.reopen()
        seen = self._scpi.identify()
        if seen != self.identity:
            raise LinkError(f"{self._scpi.link.name} now answers as '{seen}', not '{self.identity}'")

    def close(self) -> None:
        self._scpi.link.close()

    def _idle_must_be(self, level_v: float) -> None:
        seen = self.idle_v()
        if abs(seen - level_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._scpi.instrument} idles at {seen:.4f} V where the drive begins at {level_v:.4f} V; nothing was sent"
            )
