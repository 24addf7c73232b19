"""Interlock: a heartbeat on a digital line of the card, without which an external monostable takes the high voltage away.

The thread that reads the card toggles the line with every block, while high voltage may be on: so the heartbeat ends with the
program, the computer, the card, the reading, and with a run thread that the watchdog would call dead. The monostable is triggered
by edges, so that a line which keeps its level, high or low, lets it drop (docs/decisions/0137-interlock.md).
"""

import math
import time
from collections.abc import Callable
from types import TracebackType
from typing import Protocol, Self

from drivers.errors import BenchError, InstrumentError

FRESH_S = 0.5
"""Largest age of a block with which the line is toggled, real seconds."""

STATE_TIMEOUT_S = 1.0
"""Longest wait for the relay's contact, beyond the monostable's time."""

INTERLOCK_RECOMMENDED = (
    "Recommended: an interlock, which takes the high voltage away when program, watchdog and computer are dead "
    "([interlock] in the bench file; docs/how-to/build-an-interlock.md)"
)


class DigitalLines(Protocol):
    """The lines of an interlock on a card; each method raises InstrumentError, except `close`."""

    def write(self, high: bool) -> None:
        """Set the heartbeat's line."""

    def is_closed(self) -> bool | None:
        """Return whether the relay's second contact is closed; None if it is not wired."""

    def close(self) -> None:
        """Release the lines; the heartbeat's line keeps its level."""


class Interlock:
    """The heartbeat of one bench, which ends with the `with` block; without lines there is none, and nothing is done.

    `beat` is called by the thread that reads the card, all others by the run thread.

    Args:
        lines: lines of the card; None without an interlock.
        monostable_s: time of the monostable, real seconds.
    """

    def __init__(self, lines: DigitalLines | None = None, monostable_s: float = math.inf) -> None:
        self._lines, self.monostable_s = lines, monostable_s
        self.measured_s = 0.0
        """Time from the last heartbeat until high voltage is off, measured by commissioning; 0 without."""
        self._is_watched = self._is_permitted = self._is_high = self._was_closed = False
        self._closed: bool | None = None
        self._beats, self._edge_s, self._dropped = 0, math.inf, ""

    @property
    def statement(self) -> str:
        """Further clause about the high voltage without a heartbeat; empty without an interlock."""
        if self._lines is None:
            return ""
        measured = f"measured {self.measured_s:.2f} s at commissioning" if self.measured_s else "not measured"
        return (
            f"; the interlock switches high voltage off {self.monostable_s:g} s after its last heartbeat ({measured})"
        )

    @property
    def edge_age_s(self) -> float:
        """Real seconds since the edge of the heartbeat that triggered the monostable last."""
        return time.monotonic() - self._edge_s

    def begin(self, read_block: Callable[[], object]) -> None:
        """Begin the heartbeat, at measured rest and after the operator has switched high voltage on at the amplifier.

        Raises:
            BenchError: the relay is closed without a heartbeat, or does not close with it; the lines do not answer.
        """
        if self._lines is None:
            return
        self._dropped, self._was_closed, self._is_watched = "", False, True
        stuck = "is closed without a heartbeat: its contact is stuck, the monostable does not drop, or the state's line is wrong"
        self._wait(read_block, lambda: not self._closed, stuck)
        self._edge_s, self._is_permitted = time.monotonic(), True
        dead = "does not close with the heartbeat: check the heartbeat's wire and the supply of the interlock"
        self._wait(read_block, lambda: self._closed is not False, dead)
        self._was_closed = self._closed is True

    def end(self) -> None:
        """End the heartbeat: at rest, or where rest cannot be reached. High voltage is off after the monostable's time."""
        self._is_permitted = self._is_watched = False

    def beat(self, age_s: float, overdue_s: float) -> None:
        """Toggle the line, if high voltage is permitted. Errors are reported by `raise_for_status`.

        Args:
            age_s: age of the block that was just read, real seconds.
            overdue_s: by how much longer than allowed the run thread has been silent, real seconds.
        """
        if self._lines is None or not self._is_watched or self._dropped:
            return
        try:
            if self._is_permitted and self.edge_age_s > self.monostable_s:
                self._dropped = f"this program did not read the card for {self.edge_age_s:.2f} s"
                return
            if self._is_permitted and age_s <= FRESH_S and overdue_s <= 0:
                self._is_high = not self._is_high
                self._edge_s = time.monotonic() if self._is_high else self._edge_s
                self._lines.write(self._is_high)
            self._closed = self._lines.is_closed()
            self._beats += 1
        except InstrumentError as error:
            self._dropped = f"the heartbeat cannot be sent: {error}"
        if self._was_closed and self._closed is False:
            self._dropped = (
                self._dropped or "its relay opened in spite of the heartbeat; check its supply and its wires"
            )

    def raise_for_status(self) -> None:
        """Raise BenchError if the interlock has switched high voltage off since `begin`: it is off until the next start."""
        if self._is_permitted and self._dropped:
            raise BenchError(
                f"the interlock has switched high voltage off: {self._dropped}. The drive was not on the specimen from then on"
            )

    def close(self) -> None:
        """End the heartbeat and release the lines."""
        self.end()
        if self._lines is not None:
            self._lines.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    def _wait(self, read_block: Callable[[], object], is_done: Callable[[], bool], trouble: str) -> None:
        """Read blocks until `is_done` after a beat from now on; end the heartbeat and raise BenchError if it is not."""
        self._beats, deadline_s = 0, time.monotonic() + self.monostable_s + STATE_TIMEOUT_S
        try:
            while not (self._beats > 1 and is_done()):
                read_block()
                if self._dropped or time.monotonic() > deadline_s:
                    raise BenchError("not armed: " + (self._dropped or f"the interlock's relay {trouble}"))
        except BaseException:
            self.end()
            raise
