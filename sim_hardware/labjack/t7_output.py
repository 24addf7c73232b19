"""Analogue outputs of a simulated LabJack T7, and the stream-out that plays samples on one of them."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from drivers import Clock
from model import Array
from sim_hardware.labjack import t7_registers as registers
from sim_hardware.labjack.t7_registers import RegisterError
from sim_hardware.nidaq import SimulatedAnalogOutput, to_counts
from sim_hardware.plant import ArbitraryWaveform, PeriodicSegment

STEP_V, HIGHEST_V = 5.0 / 4096, 4.95
"""Resolution, and the largest voltage with a supply of 5 V."""

MOST_BYTES, BYTES_PER_VALUE = 16_384, 2
UNLIMITED_S = 600.0
"""Duration for which a repeated stream without a number of scans is computed."""


class SimulatedT7Output:
    """DAC0 and DAC1: 0 V without power and while the device starts, then the stored level.

    Args:
        outputs: by register, 1000 and 1002.
        clock: bench time.
        stored_v: power-up level in the flash.
        clock_ppm: error of the clock of its scans.
    """

    def __init__(
        self, outputs: Mapping[int, SimulatedAnalogOutput], clock: Clock, stored_v: float, clock_ppm: float
    ) -> None:
        self._outputs, self._clock, self.stored_v, self._clock_ppm = outputs, clock, stored_v, clock_ppm
        self._values: list[float] = []
        self._position = 0
        """Values that have been consumed."""
        self._settings = dict.fromkeys(registers.STREAM_OUT, 0)
        self._begin_s, self._end_s, self._rate_hz = 0.0, -math.inf, 1.0
        self.power_up()

    @property
    def is_playing(self) -> bool:
        return self._clock.now() < self._end_s

    def power_off(self) -> None:
        """Lose power, or begin to start: the outputs fall to 0 V."""
        self._end_s = -math.inf
        for output in self._outputs.values():
            output.reset()

    def power_up(self) -> None:
        """Apply the stored level, after the start of the device."""
        for address in self._outputs:
            self.set_level(address, self.stored_v)

    def set_level(self, address: int, volts: float) -> None:
        self._outputs[address].hold(float(_converted([volts])[0]))

    def level_v(self, address: int) -> float:
        """Return the present level as the register tells it."""
        return float(_converted(self._outputs[address].volts(np.array([self._clock.now()])))[0])

    def write(self, register: int, value: int) -> None:
        """Write a setting of the stream-out. Raises RegisterError."""
        enabled, allocated = self._settings[registers.OUT_ENABLE], self._settings[registers.OUT_ALLOCATE]
        if register in (registers.OUT_LOOP, registers.OUT_SET_LOOP) and not enabled:
            raise RegisterError(registers.OUT_NOT_ENABLED)
        if register == registers.OUT_TARGET and value not in self._outputs:
            raise RegisterError(registers.OUT_BAD_TARGET)
        if register == registers.OUT_ALLOCATE and (value & (value - 1) or not 32 <= value <= MOST_BYTES):
            raise RegisterError(registers.BAD_BUFFER)
        if register == registers.OUT_LOOP and BYTES_PER_VALUE * value > allocated - BYTES_PER_VALUE:
            raise RegisterError(registers.OUT_LOOP_TOO_BIG)
        if register == registers.OUT_ENABLE:  # a reset of the channel
            self._values, self._position = [], 0
        self._settings[register] = value

    def fill(self, values: Sequence[float]) -> None:
        """Add values to the buffer. Raises RegisterError."""
        if not self._settings[registers.OUT_ENABLE]:
            raise RegisterError(registers.OUT_NOT_ENABLED)
        left = self._settings[registers.OUT_ALLOCATE] // BYTES_PER_VALUE - 1 - len(self._values)
        self._values += values[:left]
        if left < len(values):
            raise RegisterError(registers.OUT_FULL)

    def start(self, rate_hz: float, scans: int) -> None:
        """Play from the present position; at the end of the values the last ones are repeated. Raises RegisterError."""
        if not self._values or not self._settings[registers.OUT_SET_LOOP]:
            raise RegisterError(registers.OUT_NOT_ENABLED)
        volts, loop = _converted(self._values), max(self._settings[registers.OUT_LOOP], 1)
        count = scans or (round(UNLIMITED_S * rate_hz) if loop > 1 else volts.size)
        output = self._outputs[self._settings[registers.OUT_TARGET]]
        self._rate_hz = rate_hz = rate_hz * (1 + 1e-6 * self._clock_ppm)

        def begin(now_s: float) -> float:
            self._begin_s = now_s + 1 / rate_hz  # the first scan comes one interval after the start
            return self._begin_s

        if loop == volts.size and not self._position:
            output.emit(lambda now_s: _repeated(volts, rate_hz, count, begin(now_s)))
        else:
            at = self._position + np.arange(count)
            at = np.where(at < volts.size, at, volts.size - loop + (at - volts.size) % loop)
            output.play(to_counts(volts[at]), rate_hz, begin)
        self._end_s = self._begin_s + (count - 1) / rate_hz

    def stop(self) -> None:
        """Stop in mid-wave: the output keeps its level, and a further start continues there."""
        self._position += max(math.floor((self._clock.now() - self._begin_s) * self._rate_hz) + 1, 0)
        self._end_s = -math.inf
        self._outputs[self._settings[registers.OUT_TARGET]].freeze()


def _repeated(volts: Array, rate_hz: float, count: int, begin_s: float) -> PeriodicSegment:
    """Return a period that is repeated, its values as slopes; the last one stays."""
    offset_v, amplitude_v = (volts.max() + volts.min()) / 2, max((volts.max() - volts.min()) / 2, STEP_V)
    wave = ArbitraryWaveform((volts - offset_v) / amplitude_v, interpolated=True)
    last_v, cycles = float(volts[(count - 1) % volts.size]), (count - 1) / volts.size
    return PeriodicSegment(
        begin_s, rate_hz / volts.size, amplitude_v, offset_v, 0.0, last_v, cycles=cycles, waveform=wave
    )


def _converted(volts: Sequence[float] | Array) -> Array:
    """Return the volts of the converter's codes for these volts, same shape."""
    return np.rint(np.clip(volts, 0.0, HIGHEST_V) / STEP_V) * STEP_V
