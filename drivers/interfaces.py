"""What an instrument can do: the three doors through which the house touches the world.

`Source` plays a drive, `Digitizer` streams blocks of raw integers, `Meter` answers one reading. Real and simulated
instruments stand behind the same doors and pass the same contract tests.
"""

from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from drivers.deprecated import renamed
from drivers.drive import Drive


@dataclass(frozen=True, slots=True)
class Identity:
    """Who an instrument says it is."""

    maker: str
    model: str
    serial: str = ""
    firmware: str = ""

    def __str__(self) -> str:
        return " ".join(part for part in (self.maker, self.model, self.serial and f"#{self.serial}") if part)


@renamed(volts="to_volts", clipped="is_clipped")
@dataclass(frozen=True, slots=True)
class Scale:
    """How raw integers become volts: a polynomial (c0 + c1 n + ...), valid strictly between two rails; and when.

    `skew_s` is how much later than its scan a channel is converted: a multiplexed card has one converter, which takes the
    channels one after the other.
    """

    coefficients: tuple[float, ...]
    low_count: int = -32768
    high_count: int = 32767
    skew_s: float = 0.0

    def to_volts(self, raw: NDArray[np.int16]) -> NDArray[np.float64]:
        """Volts at the card's terminals, same shape as `raw`."""
        counts = raw.astype(np.float64)
        volts = np.full_like(counts, self.coefficients[-1])
        for coefficient in self.coefficients[-2::-1]:
            volts *= counts
            volts += coefficient
        return volts

    def is_clipped(self, raw: NDArray[np.int16]) -> NDArray[np.bool_]:
        """Where the converter stood at a rail: the true voltage is unknown there."""
        return (raw <= self.low_count) | (raw >= self.high_count)


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive scans as they came: `raw` is channels x scans, `start` the index of the first scan in its stream."""

    start: int
    raw: NDArray[np.int16]

    @property
    def stop(self) -> int:
        return self.start + int(self.raw.shape[1])


class Stream(Protocol):
    """A running acquisition. Closing it stops the card; blocks are gapless until an error is raised."""

    rate_hz: float
    scales: tuple[Scale, ...]
    start_time_s: float
    """Bench time (the clock's) at which scan 0 was taken, to within the start-up latency of the card."""

    def read(self) -> Block:
        """The next block, waiting for it.

        Raises:
            AcquisitionError: scans were lost (overrun) or the card is gone.
        """

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class Digitizer(Protocol):
    """Samples several channels together: channel 0 is the drive at the amplifier's input, 1 the displacement."""

    identity: Identity

    def stream(self, rate_hz: float, block_scans: int) -> Stream:
        """Begin a continuous acquisition.

        Raises:
            AcquisitionError: the card is absent, or cannot do this rate.
        """

    def close(self) -> None: ...


class Source(Protocol):
    """Plays drives. It has no `off` and no `zero`: on this bench both are -500 V on the specimen."""

    identity: Identity

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        """Whether the instrument itself says that it is as `prepare` left it: output on, idle at `rest_v`, every setting.

        What a hand at its front panel changed since must be noticed: then it is not at rest, and is prepared anew.
        """

    def initialize_at_rest(self, rest_v: float, low_v: float, high_v: float) -> None:
        """Bring the output up at rest. High voltage must be disabled: the level is undefined until this returns.

        What an earlier program left playing or held comes down first, as gently as the instrument can.

        Raises:
            InstrumentError: a setting was refused or does not read back.
        """

    def start_drive(self, drive: Drive) -> None:
        """Begin a drive from the level where the source idles, and return at once."""

    def stop(self) -> None:
        """Bring whatever plays down to its offset, gently, and return when the output idles.

        Neither an error that others left in the instrument nor an answer that cannot be read keeps it from going down.

        Raises:
            InstrumentError: something went wrong on the way; told when all of the way has been sent.
        """

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        """Move the idle level along a straight line, and return when it is there. To rest, it goes on as `stop` does."""

    def idle_level_v(self) -> float:
        """The level at which the instrument itself says it idles."""

    def reconnect(self) -> None:
        """Open the wire anew after it failed; touches no output setting."""

    def close(self) -> None:
        """Let go of the wire. The output stays as it is."""


@runtime_checkable
class DriveChecker(Protocol):
    """A source that cannot play every drive, and can say so before anything moves."""

    def reason_unsupported(self, drive: Drive) -> str:
        """Why this drive cannot be played, in a sentence with the remedy; empty where it can."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One answer of a meter: a value in `unit`, or not valid (out of range)."""

    value: float
    unit: str
    valid: bool
    time_s: float


class Meter(Protocol):
    """Answers one reading at a time (a laser sensor's serial port, a scale)."""

    identity: Identity

    def read(self) -> Reading: ...

    def close(self) -> None: ...
