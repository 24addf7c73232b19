"""Instrument interfaces: `Source` plays a drive, `Digitizer` streams blocks, `Meter` reads a value.

Real and simulated instruments implement the same interfaces and pass the same contract tests.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from drivers.drive_shapes import Drive, Hold, LevelPulse
from drivers.thermometers import read_coefficients, temperature_c


class Closeable(ABC):
    """Closes itself at the end of its `with` block, also after an exception."""

    @abstractmethod
    def close(self) -> None:
        """Release all resources."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@dataclass(frozen=True, slots=True)
class Identity:
    """Maker, model, serial number and firmware reported by the instrument."""

    maker: str
    model: str
    serial: str = ""
    firmware: str = ""

    def __str__(self) -> str:
        return " ".join(part for part in (self.maker, self.model, self.serial and f"#{self.serial}") if part)


@dataclass(frozen=True, slots=True)
class Scale:
    """Conversion of raw integers to volts: a polynomial (c0 + c1 n + ...), valid strictly between two rails.

    `skew_s` is the delay of a channel's conversion after its scan: a multiplexed card converts the channels in turn.
    """

    coefficients: tuple[float, ...]
    low_count: int = -32768
    high_count: int = 32767
    skew_s: float = 0.0

    def to_volts(self, raw: NDArray[np.int16]) -> NDArray[np.float64]:
        """Return volts at the card's terminals, same shape as `raw`."""
        counts = raw.astype(np.float64)
        *lower, highest = self.coefficients
        if not lower:
            return np.full_like(counts, highest)
        volts = counts * highest
        volts += lower[-1]
        for coefficient in lower[-2::-1]:
            volts *= counts
            volts += coefficient
        return volts

    def is_clipped(self, raw: NDArray[np.int16]) -> NDArray[np.bool_]:
        """Return a mask of the counts at a rail, whose true voltage is unknown; same shape as `raw`."""
        return (raw <= self.low_count) | (raw >= self.high_count)


@dataclass(frozen=True, slots=True)
class InputChannel:
    """A further input of the card, in addition to drive and displacement: value = gain * volts + offset.

    Attributes:
        name: name of its data in run files.
        terminal: terminal of the card, e.g. `ai2`.
        unit: unit of its values.
        gain: units per volt at the terminal.
        offset: value at 0 V.
        kind: `voltage-monitor`, `current-monitor`, `charge`, `temperature`, `humidity` or `other`; monitors have an abort level, `charge` at the end of the card's range.
        gain_relative_uncertainty: standard uncertainty of the gain, relative; 0: not stated.
        delay_s: delay from the specimen to the volts at the terminal.
        delay_uncertainty_s: standard uncertainty of the delay; 0: not stated.
        bleed_s: charge: sense capacitance times its bleed resistance; 0: no resistor.
        curve, coefficients: temperature: characteristic from the value to degrees Celsius, see `thermometers.temperature_c`.
    """

    name: str
    terminal: str
    unit: str = "V"
    gain: float = 1.0
    offset: float = 0.0
    kind: str = "other"
    gain_relative_uncertainty: float = 0.0
    delay_s: float = 0.0
    delay_uncertainty_s: float = 0.0
    bleed_s: float = 0.0
    curve: str = "line"
    coefficients: str = ""

    def reading(self, mean: float) -> tuple[float, float]:
        """Return what a mean of the values says, degrees Celsius of a thermometer, and its standard error by the gain's."""
        known = read_coefficients(self.curve, self.coefficients)
        error = abs(mean - self.offset) * self.gain_relative_uncertainty
        seen = temperature_c(self.curve, known, np.array([mean, mean + error])).tolist()
        return seen[0], abs(seen[1] - seen[0])

    def values(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values in `unit`, same shape as `volts`."""
        return self.gain * volts + self.offset


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive acquired scans: `raw` is channels x scans, `start` the index of the first scan in its stream."""

    start: int
    raw: NDArray[np.int16]

    @property
    def stop(self) -> int:
        """Index of the scan after the last one."""
        return self.start + int(self.raw.shape[1])


class Stream(Protocol):
    """A running acquisition. Closing it stops the card; blocks are gapless until an error is raised."""

    rate_hz: float
    scales: tuple[Scale, ...]
    start_time_s: float
    """Bench time of scan 0 by the clock, to within the start-up latency of the card."""

    def read(self) -> Block:
        """Wait for the next block and return it.

        Raises:
            ScansLostError: scans were lost (overrun).
            AcquisitionError: the card is gone.
        """

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


@runtime_checkable
class RestartableStream(Protocol):
    """A stream that can continue after lost scans."""

    def restart(self) -> None:
        """Restart the acquisition; the scan numbers continue with the present time.

        Raises:
            AcquisitionError: the card is gone.
        """


@runtime_checkable
class SkippingStream(Protocol):
    """A stream on the virtual clock, whose time can pass without being read."""

    def skip(self, seconds: float) -> float:
        """Advance the clock by whole blocks, `seconds` at most, without their samples; return the skipped seconds."""


class Digitizer(Protocol):
    """Samples several channels together: channel 0 is the drive at the amplifier's input, 1 the displacement; others follow."""

    identity: Identity

    def stream(self, rate_hz: float, block_scans: int) -> Stream:
        """Start a continuous acquisition.

        Raises:
            AcquisitionError: the card is absent, or cannot do this rate.
        """

    def close(self) -> None:
        """Release the card."""


@runtime_checkable
class ScanLister(Protocol):
    """A digitizer that converts its channels in any order and repeatedly in a scan, which shows its skew and settling."""

    def scan(self, order: Sequence[int], rate_hz: float, block_scans: int) -> Stream:
        """Start a continuous acquisition of the channels with these numbers, in this order.

        Raises:
            ScanOrderError: the card has a converter for each channel.
            AcquisitionError: the card is absent, or cannot do this rate.
        """


class Source(Protocol):
    """Plays drives. There is no `off` and no `zero`: on this bench both are -500 V on the specimen."""

    identity: Identity

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        """Whether the instrument is in the state of `initialize_at_rest`: output on, idle at `rest_v`, every setting.

        Changes made at the front panel must be detected: the source is then not at rest and is initialized again.
        """

    def initialize_at_rest(self, rest_v: float, low_v: float, high_v: float) -> None:
        """Bring the output up at rest. High voltage must be disabled: the level is undefined until this returns.

        A drive or level of an earlier program is ramped down first, as gently as possible.

        Raises:
            InstrumentError: a setting was rejected or does not read back.
        """

    def start_drive(self, drive: Drive) -> None:
        """Start a drive from the idle level, and return immediately."""

    def stop(self) -> None:
        """Bring a playing drive gently down to its offset, and return when the output idles.

        Continues despite errors of other programs in the instrument's queue and despite unreadable replies.

        Raises:
            InstrumentError: a step failed; raised after all steps have been sent.
        """

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        """Ramp the idle level linearly and return when it is reached. A ramp to rest continues despite errors, like `stop`."""

    def idle_level_v(self) -> float:
        """Return the idle level reported by the instrument."""

    def reconnect(self) -> None:
        """Reconnect after a link failure; changes no output setting."""

    def close(self) -> None:
        """Close the link without changing the output."""


@runtime_checkable
class DriveChecker(Protocol):
    """A source that can check in advance whether it can play a drive."""

    def reason_unsupported(self, drive: Drive) -> str:
        """Return the reason why this drive cannot be played, with the remedy; empty if it can."""


OTHER_BYTE_ORDER = {"big-endian": "little-endian", "little-endian": "big-endian"}


@runtime_checkable
class ByteOrderSwapper(Protocol):
    """A source whose documents may disagree on the byte order of its waveforms."""

    def byte_order(self, new: str = "") -> str:
        """Set the byte order of waveforms if `new` is given, and return the present one; empty if the model has only one."""


@runtime_checkable
class RestTimer(Protocol):
    """A source that predicts the duration of its way to rest from its measured reply time."""

    def predict_rest_s(self, distance_v: float, ramp_v_per_s: float) -> float:
        """Return the duration of `stop` and a ramp of `distance_v` to rest in seconds; a burst's own end is not counted."""


@runtime_checkable
class HoldRenewer(Protocol):
    """A source that returns from a level to rest by itself unless the level is renewed."""

    lease_s: float
    """Duration of a level without renewal, seconds of bench time."""

    def renew_hold(self) -> None:
        """Hold the present level for another `lease_s`; called with every block, and often without effect.

        Raises:
            InstrumentError: the call came too late, and the source returns to rest; or the instrument does not answer.
        """


@runtime_checkable
class FiniteHolder(Protocol):
    """A source that plays a held level as a finite waveform, which returns to rest by itself and cannot be renewed."""

    def level_pulse(self, level: Hold, rest_v: float, ramp_v_per_s: float) -> LevelPulse:
        """Return the waveform of a held level: its duration and a margin, reached and left at this slope."""
        ...

    def reason_level_unsupported(self, pulse: LevelPulse) -> str:
        """Return the reason why this waveform cannot be played, with the remedy; empty if it can."""
        ...

    def start_level(self, pulse: LevelPulse) -> float:
        """Start the waveform from rest and return immediately; return the earliest bench time at which it may have begun.

        Raises:
            InstrumentError: the source rejected it or does not answer.
        """
        ...

    def end_level(self, duration_s: float) -> None:
        """Bring a held level to rest in about this time, otherwise like `Source.stop`."""


@runtime_checkable
class UnattendedEnd(Protocol):
    """A source that states the behaviour of its output when program and watchdog die at the same moment."""

    @property
    def unattended_end(self) -> str:
        """Behaviour of a drive and a held level in this case, as a clause for an operator."""
        ...

    def unattended_rest_s(self, drive: Drive, rest_v: float) -> float:
        """Return the longest time from their death to rest in seconds; infinite if the drive does not end.

        A `Hold` counts as played by `start_drive`, at the idle level.
        """
        ...


@runtime_checkable
class LiveChecker(Protocol):
    """A source that reports a drive or a level of an earlier program; other sources are assumed to have one."""

    def is_left_live(self, rest_v: float, low_v: float, high_v: float) -> bool:
        """Whether the output is on, set up by this driver, and not at rest. Changes nothing."""


@runtime_checkable
class FailureReporter(Protocol):
    """A source that reports an error on the way to rest when it occurs, and then sends the remaining commands."""

    on_failure: Callable[[BaseException], None]
    """Called with each such error."""


@runtime_checkable
class OutputReporter(Protocol):
    """A source that reports whether its output is on: protections or users may switch it off."""

    def is_output_on(self) -> bool:
        """Whether the instrument reports that its output is on. Changes nothing."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of a meter: a value in `unit`, or not valid (out of range)."""

    value: float
    unit: str
    valid: bool
    time_s: float


class Meter(Protocol):
    """Returns one reading at a time (a laser sensor's serial port, a balance)."""

    identity: Identity

    def read(self) -> Reading:
        """Return the present reading.

        Raises:
            InstrumentError: no reply, or a reply without a reading.
        """
        ...

    def close(self) -> None:
        """Close the connection."""
