"""Dialect of a family of function generators: its commands and settings for `BurstGenerator`."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

from drivers.clock import Clock
from drivers.generators.capabilities import Capabilities
from drivers.generators.settings import ExpectedSetting
from drivers.generators.waveform import Points
from drivers.transport import ScpiSession


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
