"""Interlock: a heartbeat on a digital line of the card, without which an external monostable takes the high voltage away.

The thread that reads the card toggles the line with every block, while high voltage may be on: so the heartbeat ends with the
program, the computer, the card, the reading, and with a run thread that the watchdog would call dead. The monostable is triggered
by edges, so that a line which keeps its level, high or low, lets it drop (docs/decisions/0137-interlock.md).
"""

import math
import time
from collections.abc import Callable
from typing import Protocol

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
    """The lines of an interlock on a card."""

    def write(self, high: bool) -> None:
        """Set the heartbeat's line. Raises InstrumentError."""

    def is_closed(self) -> bool | None:
        """Return whether the relay's second contact is closed; None if it is not wired. Raises InstrumentError."""

    def close(self) -> None:
        """Release the lines; the heartbeat's line keeps its level."""


class Interlock:
    """The heartbeat of one bench; without lines there is no interlock, and nothing is done.

    `begin`, `end` and `raise_for_status` are called by the run thread, `beat` by the thread that reads the card.

    Args:
        lines: lines of the card; None without an interlock.
        monostable_s: time of the monostable, real seconds.
    """

    measured_s: float = math.nan
    """Time from the last heartbeat until high voltage was off, measured by commissioning; NaN if it was not."""

    def __init__(self, lines: DigitalLines | None = None, monostable_s: float = math.inf) -> None:
        self._lines, self.monostable_s = lines, monostable_s
        self._is_watched = self._is_permitted = self._is_high = False
        self._closed: bool | None = None
        self._was_closed = False
        self._beats, self._edge_s, self._dropped = 0, math.inf, ""

    @property
    def is_wired(self) -> bool:
        """Whether this bench has an interlock."""
        return self._lines is not None

    @property
    def statement(self) -> str:
        """Clause about the high voltage without this program; empty without an interlock."""
        if not self.is_wired:
            return ""
        known = "not measured" if math.isnan(self.measured_s) else f"measured {self.measured_s:.2f} s at commissioning"
        return f"the interlock switches high voltage off {self.monostable_s:g} s after the last heartbeat ({known})"

    @property
    def edge_age_s(self) -> float:
        """Real seconds since the edge of the heartbeat that triggered the monostable last."""
        return time.monotonic() - self._edge_s

    @property
    def after_unsafe(self) -> str:
        """Sentence about the high voltage after a run that ended unsafe; empty without an interlock."""
        if not self.is_wired:
            return ""
        return f". The interlock's heartbeat was stopped: high voltage is off {self.monostable_s:g} s later, if the interlock works"

    def begin(self, read_block: Callable[[], object]) -> None:
        """Begin the heartbeat, at measured rest and after the operator has switched high voltage on at the amplifier.

        Raises:
            BenchError: the relay is closed without a heartbeat, or does not close with it; the lines do not answer.
        """
        if not self.is_wired:
            return
        self._dropped, self._was_closed, self._beats, self._is_watched = "", False, 0, True
        self._wait(
            read_block,
            lambda: not self._closed,
            "the interlock's relay is closed without a heartbeat, so that it would not switch high voltage off. Its contact is "
            "stuck, the monostable does not drop, or the line of its state is at another level",
        )
        self._beats, self._edge_s, self._is_permitted = 0, time.monotonic(), True
        self._wait(
            read_block,
            lambda: self._closed is not False,
            "the interlock's relay does not close with the heartbeat. Check the heartbeat's wire and the supply of the interlock",
        )
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
            if self._is_permitted and (silent_s := self.edge_age_s) > self.monostable_s:
                self._dropped = (
                    f"there was no heartbeat for {silent_s:.2f} s, because this program could not read the card in time"
                )
                return
            if self._is_permitted and age_s <= FRESH_S and overdue_s <= 0:
                self._is_high = not self._is_high
                if self._is_high:
                    self._edge_s = time.monotonic()
                self._lines.write(self._is_high)
            self._closed = self._lines.is_closed()
            self._beats += 1
        except InstrumentError as error:
            self._dropped = f"the heartbeat cannot be sent: {error}"
        if self._was_closed and self._closed is False:
            self._dropped = (
                self._dropped or "its relay opened in spite of the heartbeat: check its supply and its wires"
            )

    def raise_for_status(self) -> None:
        """Raise BenchError if the interlock has switched high voltage off since `begin`: it is off until the next start."""
        if self._is_permitted and self._dropped:
            raise BenchError(
                f"the interlock has switched high voltage off: {self._dropped}. The drive was not on the specimen from then on, "
                "and the heartbeat is not sent any more"
            )

    def close(self) -> None:
        """End the heartbeat and release the lines."""
        self.end()
        if self._lines is not None:
            self._lines.close()

    def _wait(self, read_block: Callable[[], object], is_done: Callable[[], bool], trouble: str) -> None:
        """Read blocks until a beat since then finds `is_done`; end the heartbeat and raise BenchError with `trouble` if none does."""
        deadline_s = time.monotonic() + self.monostable_s + STATE_TIMEOUT_S
        try:
            while not (self._beats > 1 and is_done()):
                read_block()
                if self._dropped or time.monotonic() > deadline_s:
                    raise BenchError(f"not armed: {self._dropped or trouble}")
        except BaseException:
            self.end()
            raise
