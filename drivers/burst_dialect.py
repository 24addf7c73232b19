"""What differs between one burst generator and another: the words of its dialect, and what the box can do.

`drivers.burst_generator` knows what to say when; a subclass of both fills this in.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import ClassVar

from drivers.clock import Clock
from drivers.errors import InstrumentError, LinkError
from drivers.ports import Identity
from drivers.scpi import Link, Scpi
from drivers.setting import Setting
from drivers.waveform import Points


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
