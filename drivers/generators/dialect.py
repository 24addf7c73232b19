"""Dialect of a family of function generators: its commands for `BurstGenerator`, and the settings that an armed one reports.

Each driver lists its whole configured state as a table of expected settings. `initialize_at_rest` and `is_at_rest` read the same
table, so that changes at the front panel or by another program between two runs are detected.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Protocol

from drivers.clock import Clock
from drivers.errors import InstrumentError
from drivers.generators.capabilities import Capabilities
from drivers.generators.waveform import Points
from drivers.transport import ScpiSession

LEVEL_TOLERANCE_V = 1e-3


@dataclass(frozen=True, slots=True)
class ExpectedSetting:
    """One of `keywords`, or a number from `low` to `high`.

    Args:
        name: its header in the driver's queries, e.g. `BURS:PHAS`.
        keywords: valid replies in capitals; empty for a number.
        low: smallest number.
        high: largest number.
        optional: whether models may lack this setting; a missing one counts as expected.
    """

    name: str
    keywords: tuple[str, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    optional: bool = False

    def matches(self, answer: str) -> bool:
        """Whether a reply is as expected; an invalid number does not match."""
        if self.keywords:
            return answer.strip().upper() in self.keywords
        try:
            return self.low <= float(answer) <= self.high
        except ValueError:
            return False

    @property
    def expected(self) -> str:
        """The expected reply, for messages."""
        if self.keywords:
            return self.keywords[0]
        if math.isinf(self.low) or math.isinf(self.high):
            return f"at most {self.high:g}" if math.isinf(self.low) else f"at least {self.low:g}"
        middle, around = (self.low + self.high) / 2, (self.high - self.low) / 2
        return f"{middle:g}" if around <= 0.01 else f"{self.low:g} to {self.high:g}"


def expect_keyword(name: str, *keywords: str, optional: bool = False) -> ExpectedSetting:
    """Expect one of these keywords."""
    return ExpectedSetting(name, keywords, optional=optional)


@dataclass(frozen=True, slots=True)
class NeutralSetting:
    """A persistent setting of other users that changes the output: polarity, gating, combining.

    Args:
        header: in commands and queries, e.g. `OUTP:POL`.
        value: value without effect on the output, as in a command.
        replies: replies for this value, in capitals; without them the value is a number.
        optional: whether models may lack it.
    """

    header: str
    value: str
    replies: tuple[str, ...] = ()
    optional: bool = False

    @property
    def expected(self) -> ExpectedSetting:
        """The neutral value as an expected setting."""
        if self.replies:
            return expect_keyword(self.header, *self.replies, optional=self.optional)
        return replace(expect_value(self.header, float(self.value), 1e-6), optional=self.optional)


def expect_value(name: str, value: float, tolerance: float = LEVEL_TOLERANCE_V) -> ExpectedSetting:
    """Expect this number; by default a level in volts."""
    return ExpectedSetting(name, low=value - tolerance, high=value + tolerance)


def expect_range(name: str, low: float, high: float) -> ExpectedSetting:
    """Expect a number in this range."""
    return ExpectedSetting(name, low=low, high=high)


def mismatches(
    settings: Iterable[ExpectedSetting], query: Callable[[str], str], query_optional: Callable[[str], str | None]
) -> Iterator[tuple[ExpectedSetting, str]]:
    """Query the settings in turn; yield each unexpected one with its reply."""
    for setting in settings:
        answer = query_optional(setting.name) if setting.optional else query(setting.name)
        if answer is not None and not setting.matches(answer):
            yield setting, answer


def check_readback(instrument: str, readback: float, setpoint: float, tolerance: float, quantity: str) -> None:
    """Raise InstrumentError if a setting reads back differently."""
    if not abs(readback - setpoint) <= tolerance:
        raise InstrumentError(
            f"{instrument}: {quantity} was set to {setpoint:.6g} and reads back {readback:.6g} (limit {tolerance:.2g}); "
            "nothing more was sent. See its actual setting on the instrument's front panel"
        )


@dataclass(frozen=True, slots=True)
class Levels:
    """Levels of an armed generator in volts: at rest, and the lowest and the highest of any drive."""

    rest_v: float
    low_v: float
    high_v: float

    @property
    def span_v(self) -> float:
        """Amplitude of the largest drive, peak to peak."""
        return self.high_v - self.low_v


class ConfirmedCommand(NamedTuple):
    """A command, and a function that sends it and confirms it as well as the instrument allows."""

    text: str
    send: Callable[[], None]


class Dialect(Protocol):
    """Commands and settings of one family, over the session with one instrument.

    Args:
        scpi: the session.
        clock: bench time, for instruments that need pauses.
        model: name of the model, as reported by the instrument.
    """

    capabilities: ClassVar[Capabilities]

    def __init__(self, scpi: ScpiSession, clock: Clock, model: str) -> None: ...

    @property
    def max_points(self) -> int:
        """Largest number of points of a waveform."""
        ...

    def expected_settings(self, levels: Levels) -> Iterable[ExpectedSetting]:
        """Return all settings of `set_up` and `arm`, with their replies when armed and at rest, except the output switch."""
        ...

    def query_setting(self, name: str) -> str:
        """Query a setting of `expected_settings`."""
        ...

    def query_optional_setting(self, name: str) -> str | None:
        """Query a setting that this model may lack; return None if the model does not know it."""
        ...

    def reset_foreign_settings(self) -> None:
        """Reset persistent settings of other users that the drive does not set: polarity, gating, a second channel."""

    def set_up(self, levels: Levels) -> None:
        """Set load, idle level and formats, before the first waveform; a running burst ends after its amplitude is small."""

    def arm(self, levels: Levels) -> None:
        """Set burst, trigger, range and limits, after the first waveform, without changing the output switch."""

    def is_output_on(self) -> bool:
        """Query the output switch."""
        ...

    def enable_output(self) -> None:
        """Switch the output on."""

    def clear_errors(self) -> None:
        """Empty the error queue, which may hold errors of other programs."""

    def forget_waveforms(self) -> None:
        """Forget the waveforms in the instrument: another program may have replaced them."""

    def byte_order(self, new: str = "") -> str:
        """Set the byte order of waveforms if `new` is given, and return the present one; empty if the model has only one."""
        ...

    def idle_level_v(self) -> float:
        """Query the offset."""
        ...

    def offset_command(self, volts: float) -> ConfirmedCommand:
        """Return the command that sets the offset."""
        ...

    def amplitude_vpp(self) -> float:
        """Query the amplitude."""
        ...

    def amplitude_command(self, vpp: float) -> ConfirmedCommand:
        """Return the command that sets the amplitude."""
        ...

    def download_waveform(self, points: Points) -> None:
        """Download and select a waveform without changing the idle output."""

    def set_rate(self, rate_hz: float, point_count: int) -> None:
        """Set the rate of whole periods of a waveform of `point_count` points, and read it back."""

    def set_cycles(self, cycles: int) -> None:
        """Set the number of periods in a burst."""

    def burst_duration_s(self) -> float:
        """Query the duration of a burst with the present settings; 0 if no burst is armed."""
        ...

    def trigger(self) -> None:
        """Start the burst."""

    def abort_commands(self) -> Sequence[ConfirmedCommand]:
        """Return the commands that end a running burst immediately, after its amplitude was reduced."""
        ...
