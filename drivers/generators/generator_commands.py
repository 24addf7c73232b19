"""Generator commands: what a driver sends and queries in the words of one family of function generators."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence

from drivers.generators.arbitrary_waveform import Points
from drivers.generators.expected_setting import ExpectedSetting


class GeneratorCommands(ABC):
    """Commands and settings of one family; `BurstGenerator` uses them."""

    @abstractmethod
    def idle_level_v(self) -> float: ...

    @abstractmethod
    def _expected_settings(self, rest_v: float, low_v: float, high_v: float) -> Iterable[ExpectedSetting]:
        """Return all that `_configure` sets, as it reads back when armed and at rest, except the output switch."""

    @abstractmethod
    def _query_setting(self, name: str) -> str:
        """Query a setting of `_expected_settings`."""

    def _query_optional_setting(self, name: str) -> str | None:
        """Query a setting that this model may not have; return None if the model does not know it."""
        return self._query_setting(name)

    def _reset_foreign_settings(self) -> None:  # noqa: B027 - few settings of a plug-in's instrument persist
        """Reset what other users may have left and the drive does not set: polarity, gating, a second channel."""

    @abstractmethod
    def _is_output_on(self) -> bool: ...

    @abstractmethod
    def _clear_error_queue(self) -> None:
        """Empty the error queue of what other programs left there."""

    @abstractmethod
    def _configure(self, rest_v: float, low_v: float, high_v: float) -> None:
        """Set all but the output switch; a running burst ends once its amplitude is small."""

    @abstractmethod
    def _enable_output(self) -> None: ...

    @abstractmethod
    def _offset_command(self, volts: float) -> str:
        """Return the command that sets the offset, without a query."""

    @abstractmethod
    def _set_offset(self, volts: float) -> None: ...

    @abstractmethod
    def _query_amplitude(self) -> float: ...

    @abstractmethod
    def _amplitude_command(self, vpp: float) -> str:
        """Return the command that sets the amplitude, without a query."""

    @abstractmethod
    def _set_amplitude(self, vpp: float) -> None: ...

    @abstractmethod
    def _set_rate(self, rate_hz: float, point_count: int) -> None:
        """Set the rate of whole periods of a waveform of `point_count` points, and read it back."""

    @abstractmethod
    def _set_cycles(self, cycles: int) -> None: ...

    @abstractmethod
    def _query_burst_duration_s(self) -> float:
        """Return the duration of a burst with the present settings; 0 if no burst is armed."""

    @abstractmethod
    def _trigger(self) -> None: ...

    @abstractmethod
    def _abort_commands(self) -> Sequence[str]:
        """Return what ends a running burst immediately, when its amplitude has been reduced."""

    @abstractmethod
    def _send(self, command: str) -> None:
        """Send one command and confirm it as far as the instrument allows."""

    @abstractmethod
    def _download_waveform(self, points: Points) -> None:
        """Download the waveform without changing the idle output."""

    @abstractmethod
    def _max_points(self) -> int: ...

    def _first_mismatch(self, rest_v: float, low_v: float, high_v: float) -> str:
        """Describe the first setting that is not as expected when armed and at rest; empty if all are."""
        for setting, answer in self._mismatches(self._expected_settings(rest_v, low_v, high_v)):
            return f"{setting.name} is {answer[:40]}, not {setting.expected}"
        return ""

    def _has_our_setup(self, rest_v: float, low_v: float, high_v: float) -> bool:
        """Whether it is armed by this driver, whatever it plays or holds. In another state volts may mean other volts."""
        how = (s for s in self._expected_settings(rest_v, low_v, high_v) if s.keywords or math.isinf(s.high))
        return next(self._mismatches(how), None) is None

    def _mismatches(self, settings: Iterable[ExpectedSetting]) -> Iterator[tuple[ExpectedSetting, str]]:
        """Query the settings in turn; yield each that is not as expected, with the answer."""
        for setting in settings:
            answer = (
                self._query_optional_setting(setting.name) if setting.optional else self._query_setting(setting.name)
            )
            if answer is not None and not setting.matches(answer):
                yield setting, answer
