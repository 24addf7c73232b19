"""LabJack T7 as a `Source`: DAC0 or DAC1 plays drives by stream-out, in a stream of its own.

A device has one stream, so a T7 that plays is not the one that measures. A drive is written whole into the device's buffer, and its
stream has a fixed number of scans: a program that hangs leaves a drive that ends by itself at rest. A periodic drive is one period
that the device repeats. Stop ends the stream: the output keeps the present value, which is read back and left in a line.

Without power an output gives 0 V, -500 V on the specimen, and after a restart the level in its flash. Therefore the driver reads that
level back at every initialization, with high voltage disabled, unless an interlock takes the high voltage away. The device's own
watchdog must be off: it would set an output in one jump, or restart the device.

Sources: drivers/evidence/cards.toml, docs/decisions/0160-labjack-output.md.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.deadlines import Deadline
from drivers.drive_shapes import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, SquareWave
from drivers.errors import InstrumentError
from drivers.labjack.t7_registers import ENABLE, MARK, USER_RAM, WATCHDOG, T7Registers

OUTPUTS = {"DAC0": 1000, "DAC1": 1002}
RESOLUTION_V = 5.0 / 4096
"""Step of the converter of 12 bits: 0.24 V on the specimen under rest, 0.73 V above it."""

LEVEL_TOLERANCE_V = 2 * RESOLUTION_V
LOWEST_V, HIGHEST_V = 0.0, 4.9
"""Range of a drive: the largest output is somewhat below the supply of 5 V."""

BUFFER_BYTES, MOST_VALUES = 16_384, 8191
"""Largest buffer of a stream-out, and its values: one of 2 bytes is lost."""

VALUES_A_REQUEST = 61
"""Floats in a Modbus request of 255 bytes."""

MAX_RATE_HZ, TICKS_HZ, MOST_TICKS = 100e3, 10e6, 65536
"""Largest scan rate of one channel. Scan intervals are multiples of 100 ns; beyond so many of them, of ten times as much, and so on."""

STEP_V, FINE = 0.035, 7
"""Largest step between two values, 21 V on the specimen; where buffer and rate permit it, steps are smaller by the factor."""

VALUES_A_CYCLE = 100
PERIOD_TOLERANCE = 1e-6
"""Relative deviation of a period, from the resolution of the scan interval, for which smaller steps are preferred."""

RATE_TOLERANCE, NUDGES = 1e-5, (-1e-6, 0.0, 1e-6)
"""Largest relative deviation of the rate that is read back, and of the requested one: it is not documented to which side the device
rounds, and its register has 24 bits."""

FADE_S, MARKER_V = 0.05, 0.05
"""Time in which a stopped oscillation goes to its offset, and displacement of the output while the power-up level is read."""

END_MARGIN_S = 0.02
REST_ROUND_TRIPS = 50
"""Messages of Stop and of a ramp to rest."""

TO_BOOTUP = 61991
OUT_TARGET, OUT_BYTES, OUT_LOOP, OUT_SET_LOOP, OUT_ENABLE, OUT_VALUES, OUT_SLOT = (
    4040,
    4050,
    4060,
    4070,
    4090,
    4400,
    4800,
)


@dataclass(frozen=True, slots=True)
class StreamedDrive:
    """A drive as values in the device's buffer.

    Args:
        volts: the values, (N,).
        rate_hz: scans per second.
        loop: number of values, from the end, that are repeated.
        scans: number of scans of the stream.
    """

    volts: NDArray[np.float64]
    rate_hz: float
    loop: int
    scans: int


def _period(drive: Drive) -> tuple[float, int]:
    """Return the duration of the part of a drive that is written, and how often it is played."""
    match drive:
        case Sine() | SquareWave():
            return drive.period_s, drive.cycles
        case PeriodicSweep():
            return drive.period_s, drive.periods
    return drive.duration_s, 1


def _coarsest_rate_hz(drive: Drive) -> float:
    """Return the smallest admissible rate of a drive."""
    rate_hz = drive.slew_v_per_s / STEP_V
    if isinstance(drive, Sine):
        rate_hz = max(rate_hz, VALUES_A_CYCLE * drive.frequency_hz)
    if isinstance(drive, LinearSweep | PeriodicSweep):
        rate_hz = max(rate_hz, VALUES_A_CYCLE * max(drive.start_hz, drive.stop_hz))
    return rate_hz


def streamed(drive: Drive) -> StreamedDrive:
    """Return a drive as values, the smallest steps first whose period is the drive's within a tolerance, or else the best period."""
    period_s, count = _period(drive)
    coarse_hz = _coarsest_rate_hz(drive)
    most = min(MOST_VALUES - 1, MAX_RATE_HZ * period_s, max(FINE * coarse_hz * period_s, 2))
    sizes = np.arange(min(max(math.ceil(coarse_hz * period_s), 2), math.floor(most)), math.floor(most) + 1)
    wanted = np.maximum(TICKS_HZ * period_s / sizes, TICKS_HZ / MAX_RATE_HZ)
    unit = 10 ** np.ceil(np.log10(np.maximum(wanted / MOST_TICKS, 1)))
    ticks = np.rint(wanted / unit) * unit
    errors = np.abs(ticks * sizes / (TICKS_HZ * period_s) - 1)
    best = int(np.flatnonzero(errors <= max(errors.min(), PERIOD_TOLERANCE))[-1])
    size, rate_hz = int(sizes[best]), TICKS_HZ / float(ticks[best])
    if count > 1:
        volts = drive.volts(period_s * np.arange(size) / size)
        return StreamedDrive(volts, rate_hz, size, count * size + 1)
    volts = drive.volts(np.minimum(period_s * np.arange(size + 1) / size, drive.duration_s))
    return StreamedDrive(volts, rate_hz, 1, size + 1)


class T7Output:
    """An analogue output of a T7 as a `Source` (see drivers.interfaces).

    Args:
        device: IP address; with a relay also its two ports, `192.0.2.9:1502:1702`.
        channel: `DAC0` or `DAC1`.
        clock: bench time.
        checks_power_up: whether the stored power-up level must be rest: without an interlock, except in a watchdog, which never
            initializes.

    Raises:
        InstrumentError: the device does not answer, or is another one.
    """

    unattended_end = "a drive plays to its end and is at rest; a held level stays"

    def __init__(self, device: str, channel: str, clock: Clock, *, checks_power_up: bool = True) -> None:
        self._clock, self._address, self._checks_power_up = clock, OUTPUTS[channel], checks_power_up
        self._registers = T7Registers(device)
        self.identity = self._registers.identity
        self._description = f"{self._registers.description} {channel}"
        self._is_admitted = not checks_power_up
        self._drive: Drive | None = None
        begin_s = clock.now()
        self._level_v()
        self._reply_s = clock.now() - begin_s

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        return (
            self._is_admitted and not self._registers.read_integer(WATCHDOG) and not self._is_off(rest_v, low_v, high_v)
        )

    def is_left_live(self, rest_v: float, low_v: float, high_v: float) -> bool:
        return self._is_off(rest_v, low_v, high_v)

    def _is_off(self, rest_v: float, low_v: float, high_v: float) -> bool:
        """Whether a drive or another level than rest is at the output."""
        del low_v, high_v
        return self._is_playing() or abs(self._level_v() - rest_v) > LEVEL_TOLERANCE_V

    def initialize_at_rest(self, rest_v: float, low_v: float, high_v: float) -> None:
        del low_v, high_v
        self._is_admitted = False
        if self._registers.read_integer(WATCHDOG):
            raise InstrumentError(
                f"the watchdog of {self._registers.description} is on, and would set its outputs in a jump or restart it; switch it off: "
                "WATCHDOG_ENABLE_DEFAULT = 0"
            )
        self.stop()
        self.ramp_to(rest_v, 0.5)
        if self._checks_power_up:
            self._check_power_up_level(rest_v)
        self._is_admitted = True

    def _check_power_up_level(self, rest_v: float) -> None:
        """Apply the stored level, as a restart does, and read it back."""
        self._registers.write_float(self._address, rest_v - MARKER_V)
        self._registers.write_short(TO_BOOTUP, 1)
        stored_v = self._level_v()
        self._registers.write_float(self._address, rest_v)
        if abs(stored_v - rest_v) > RESOLUTION_V:
            raise InstrumentError(
                f"{self._description} starts at {stored_v:.4f} V when its power comes back, and rest is {rest_v:g} V (limit "
                f"{1e3 * RESOLUTION_V:.1f} mV); store {rest_v:g} V as its power-up level (Kipling, Power-Up Defaults), or wire the interlock"
            )

    def reason_unsupported(self, drive: Drive) -> str:
        if not LOWEST_V <= drive.low_v <= drive.high_v <= HIGHEST_V:
            return (
                f"{self._description} gives {LOWEST_V:g} to {HIGHEST_V:g} V, the limit of its supply, and a {drive.kind} from "
                f"{drive.low_v:.4g} to {drive.high_v:.4g} V is asked for; lower its amplitude. Nothing was sent"
            )
        rate_hz, (period_s, _) = _coarsest_rate_hz(drive), _period(drive)
        if rate_hz > MAX_RATE_HZ:
            return (
                f"{self._description}: a {drive.kind} of this frequency and slope takes {rate_hz:.4g} values/s, the limit is "
                f"{MAX_RATE_HZ:g}; lower its frequency or amplitude. Nothing was sent"
            )
        if not isinstance(drive, Hold) and (count := math.ceil(rate_hz * period_s)) > MOST_VALUES - 1:
            return (
                f"{self._description}: a {drive.kind} of {period_s:.4g} s takes {count} values, and its buffer holds {MOST_VALUES - 1}; "
                "shorten it, lower its frequency or amplitude, or use a generator. Nothing was sent"
            )
        return ""

    def unattended_rest_s(self, drive: Drive, rest_v: float) -> float:
        del rest_v
        return math.inf if isinstance(drive, Hold) else drive.duration_s

    def predict_rest_s(self, distance_v: float, ramp_v_per_s: float) -> float:
        return FADE_S + distance_v / ramp_v_per_s + 2 * END_MARGIN_S + REST_ROUND_TRIPS * self._reply_s

    def start_drive(self, drive: Drive) -> None:
        if self._is_playing():
            raise InstrumentError(f"{self._description} still plays; stop that first. Nothing was sent")
        idle_v, begins_v = self._level_v(), drive.end_levels_v[0]
        if abs(idle_v - begins_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._description} idles at {idle_v:.4f} V where the drive begins at {begins_v:.4f} V; nothing was sent"
            )
        if why := self.reason_unsupported(drive):
            raise InstrumentError(why)
        if not isinstance(drive, Hold):
            self._play(drive)

    def stop(self) -> None:
        drive, self._drive = self._drive, None
        if not self._registers.end_stream(InstrumentError):  # in mid-wave, at the present value
            return
        level_v = self._level_v()
        if drive is not None and not drive.low_v - STEP_V <= level_v <= drive.high_v + STEP_V:
            raise InstrumentError(
                f"{self._description} reads back {level_v:.3f} V after it was stopped in a drive from {drive.low_v:.3f} to "
                f"{drive.high_v:.3f} V; its level is not known. Switch high voltage off at the amplifier, and restart the LabJack"
            )
        offset_v = float(getattr(drive, "offset_v", level_v))
        if abs(offset_v - level_v) > RESOLUTION_V:
            self._play_to_end(Ramp(level_v, offset_v, FADE_S))

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        self._registers.end_stream(InstrumentError)
        begins_v = self._level_v()
        if abs(level_v - begins_v) > RESOLUTION_V:
            ramp = Ramp(begins_v, level_v, duration_s)
            if why := self.reason_unsupported(ramp):
                raise InstrumentError(why)
            self._play_to_end(ramp)
        self._registers.write_float(self._address, level_v)

    def idle_level_v(self) -> float:
        if self._drive is not None and self._is_playing():
            return self._drive.end_levels_v[1]
        return self._level_v()

    def reconnect(self) -> None:
        self._registers.reopen()

    def close(self) -> None:
        self._registers.close()

    def _level_v(self) -> float:
        """Return the level of the output, also of one that a stopped stream has left."""
        return self._registers.read_float(self._address)

    def _is_playing(self) -> bool:
        return bool(self._registers.read_integer(ENABLE))

    def _play(self, drive: Drive) -> float:
        """Write a drive and start it; return its duration."""
        registers, wave = self._registers, streamed(drive)
        registers.write_integers(OUT_ENABLE, 0)  # empties the buffer
        registers.write_integers(OUT_TARGET, self._address)
        registers.write_integers(OUT_BYTES, BUFFER_BYTES)
        registers.write_integers(OUT_ENABLE, 1)
        registers.write_integers(OUT_LOOP, wave.loop)
        for first in range(0, wave.volts.size, VALUES_A_REQUEST):
            registers.write_floats(OUT_VALUES, *wave.volts[first : first + VALUES_A_REQUEST].tolist())
        registers.write_integers(OUT_SET_LOOP, 1)
        for nudge in NUDGES:
            rate_hz = registers.configure_stream(wave.rate_hz * (1 + nudge), (OUT_SLOT,), 1, wave.scans)
            if abs(rate_hz / wave.rate_hz - 1) < RATE_TOLERANCE:
                break
        else:
            raise InstrumentError(
                f"{self._description} plays {rate_hz:g} values/s instead of {wave.rate_hz:g} (limit {RATE_TOLERANCE:g} of it); update its "
                "firmware, or use a generator. Nothing was played"
            )
        registers.write_integers(USER_RAM, MARK)
        self._drive = drive  # set before the start: if the reply is lost, a playing drive must be assumed
        registers.write_integers(ENABLE, 1)
        return wave.scans / rate_hz

    def _play_to_end(self, ramp: Ramp) -> None:
        duration_s = self._play(ramp)
        self._clock.sleep(duration_s + END_MARGIN_S)
        deadline_s = self._clock.now() + Deadline.CARD_SERVER.seconds * float(getattr(self._clock, "speed", 1.0))
        while self._is_playing():
            if self._clock.now() > deadline_s:
                raise InstrumentError(
                    f"{self._description} still plays {Deadline.CARD_SERVER.seconds:g} s after the end of a ramp; switch high voltage off "
                    "at the amplifier, and restart the LabJack"
                )
            self._clock.sleep(END_MARGIN_S)
        self._drive = None
