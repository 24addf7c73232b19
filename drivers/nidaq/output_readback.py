"""Readback of an analogue output: measured inside the card, or by the run's own acquisition of the drive's cable."""

import contextlib
import math
from collections.abc import Callable

import numpy as np

from drivers.clock import Clock
from drivers.errors import InstrumentError
from drivers.nidaq.analog_input import READBACK, NiConnection, acquisition_rate_hz, newest_drive_volts
from drivers.nidaq.errors import translate_errors
from drivers.nidaq.output_task import OutputTask
from drivers.nidaq.rendering import Array

RELEASE_TOLERANCE_V = 0.05
"""Largest deviation of the output, measured by the run's acquisition, from the level at the release of its task."""

FOLLOWED_SHARE = 0.1
"""Largest deviation (rms) of the cable's volts from a playing drive, in parts of its amplitude; at least RELEASE_TOLERANCE_V."""

CABLE_TIMEOUT_S = 2.0
"""Longest wait for the present block, if earlier ones must be read first; and for a block without a change."""

COMPARED_SCANS, LAGS_AT_A_TIME = 64, 10_000
COUNT_MARGIN_S = 0.02
"""Largest error of the time of the first scan, and thus of the input, against the card's count of samples; wall time."""


class OutputReadback:
    """Measures one output of a card.

    Args:
        connection: the card.
        channel: the output inside the card, e.g. `Dev1/_ao0_vs_aognd`.
        description: name of the output, for messages.
        clock: bench time.
    """

    def __init__(self, connection: NiConnection, channel: str, description: str, clock: Clock) -> None:
        self._connection, self._channel, self._description, self._clock = connection, channel, description, clock

    def inside_v(self) -> float | None:
        """Return the output measured inside the card; None if its converter is busy or has no such channel."""
        task = None
        try:
            task = self._connection.new_task(READBACK)
            with translate_errors(self._description):
                task.ai_channels.add_ai_voltage_chan(self._channel, min_val=-10.0, max_val=10.0)
                return float(task.read())
        except InstrumentError:
            return None
        finally:
            if task is not None:
                with contextlib.suppress(InstrumentError):
                    self._connection.close_task(task, READBACK)

    def cable_volts(self, timeout_s: float | None = None) -> Array | None:
        """Return the drive now measured by the run's acquisition; None without one, or if it is late (two seconds of wall time)."""
        late_s = CABLE_TIMEOUT_S * float(getattr(self._clock, "speed", 1.0))
        return newest_drive_volts(self._connection.key, late_s if timeout_s is None else timeout_s)

    def volts(self, timeout_s: float | None = None) -> Array | None:
        """Return the output measured now: inside the card, or by the run's acquisition, or None."""
        inside = [self.inside_v()]
        if inside[0] is None:
            return self.cable_volts(timeout_s)
        for _ in range(2):  # one reading of a wave may equal the level by chance
            self._clock.sleep(0.007)
            inside.append(self.inside_v())
        return np.array([seen for seen in inside if seen is not None])

    def steady_v(self, low_v: float, high_v: float) -> float:
        """Return the level of a steady output.

        Raises:
            InstrumentError: the output is not measurable, not steady, or beyond the limits by more than the tolerance.
        """
        deadline_s = self._clock.now() + CABLE_TIMEOUT_S * float(getattr(self._clock, "speed", 1.0))
        while True:
            seen = self.volts()
            if seen is not None and np.ptp(seen) <= RELEASE_TOLERANCE_V:
                level_v = float(seen.mean())
                if low_v - RELEASE_TOLERANCE_V <= level_v <= high_v + RELEASE_TOLERANCE_V:
                    return level_v
            if self._clock.now() > deadline_s:
                measured = "is not measured" if seen is None else f"measures {seen.min():.3f} to {seen.max():.3f} V"
                raise InstrumentError(
                    f"{self._description} was stopped in mid-drive and {measured}, where one level between {low_v:g} and "
                    f"{high_v:g} V is expected (limit {RELEASE_TOLERANCE_V:g} V); switch high voltage off at the amplifier, and "
                    "check the cable from the output to the card's drive channel"
                )
            self._clock.sleep(0.01)

    def follows(self, task: OutputTask, render: Callable[[int, int], Array], amplitude_v: float) -> bool:
        """Whether the output is measured: inside the card, or by a cable that shows the present output of the task.

        An open input shows any voltage, so that a level of the cable is valid only after it has shown the drive.
        """
        if self.inside_v() is not None:
            return True
        margin = math.ceil(COUNT_MARGIN_S * float(getattr(self._clock, "speed", 1.0)) * task.rate_hz)
        first = max(task.generated() - margin, 0)
        seen, rate_hz = self.cable_volts(), acquisition_rate_hz(self._connection.key)
        if seen is None:
            return False
        expected = render(first, task.generated() + margin - first)
        compared = np.linspace(0, seen.size - 1, min(seen.size, COMPARED_SCANS)).astype(int)
        places = np.rint(compared * task.rate_hz / rate_hz).astype(int)
        limit_v = max(RELEASE_TOLERANCE_V, FOLLOWED_SHARE * amplitude_v)
        # The time of the block is uncertain: it is compared at every sample at which it may begin.
        for begin in range(0, expected.size - int(places[-1]), LAGS_AT_A_TIME):
            lags = np.arange(begin, min(begin + LAGS_AT_A_TIME, expected.size - int(places[-1])))
            away = expected[lags[:, None] + places] - seen[compared]
            if float(np.sqrt(np.mean(away**2, axis=1)).min()) <= limit_v:
                return True
        return False
