"""Safe ramp-down: continues despite rejected steps and unreadable replies."""

import math
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from drivers.errors import InstrumentError, LinkError
from drivers.transport.scpi import Link

T = TypeVar("T")

FIRST_STEPS, PIPELINED_STEPS = 4, 64
"""Number of steps up to the first confirmation on a slow connection, and between later ones."""

RAMP_PATIENCE_S, REPLIES_PER_STEP = 5.0, 4
"""Largest delay of a ramp away from rest, in real time, in addition to the replies of a step."""

WIRE_LIMITED = 1.5
"""Number of reply times within which a confirmed batch of steps was delayed by the connection, not by the instrument."""


class RampDown:
    """Sends the steps of one ramp and collects the errors, to be raised when the ramp is complete.

    The instrument confirms each step as long as its replies can be read. After the first unreadable reply the remaining steps are
    sent without queries: an instrument executes received commands even if its reply is lost.

    On a slow connection the steps are pipelined: after the first few, which show whether connection or instrument is slow, only
    every `PIPELINED_STEPS`th one is confirmed, and the caller reads the result back at the end. The instrument executes the steps
    one after the other, so that none is larger than commanded.

    Args:
        link: the link to the instrument.
        best_effort: whether to continue after an error; a ramp that does not lead to rest raises the first error instead.
        slow_reply_s: function, called before each step that would wait for its reply, that returns the time of a reply if the
            connection is slow and the ramp may be pipelined, else 0.
        now: bench time.
        join: function that joins commands to one message; None: separate messages.
        on_failure: callback at each error after which the ramp continues, before its next step.
    """

    def __init__(
        self,
        link: Link,
        *,
        best_effort: bool = True,
        slow_reply_s: Callable[[], float] = lambda: 0.0,
        now: Callable[[], float] = time.monotonic,
        join: Callable[[Sequence[str]], str] | None = None,
        on_failure: Callable[[BaseException], None] = lambda _: None,
    ) -> None:
        self._link, self._best_effort, self._on_failure = link, best_effort, on_failure
        self._errors: list[InstrumentError] = []
        self.blind = False
        self._read_slow_reply_s, self._now = slow_reply_s, now
        self._slow_reply_s, self._batch = 0.0, 1
        # On a socket a message costs nothing, and the caller's pace is kept; elsewhere each message is acknowledged.
        self._join = None if link.name.upper().endswith("::SOCKET") else join
        self._unconfirmed = 0
        self._pending: list[str] = []
        self._latest_s = math.inf

    def limit_duration(self, duration_s: float, steps: int, reply_s: float, speed: float) -> None:
        """Limit the duration of a ramp that does not lead to rest: steps fail if they take much longer than commanded.

        The card is not read during the ramp. `reply_s` is the time of a reply at its begin.
        """
        if not self._best_effort:
            self._latest_s = (
                self._now() + duration_s + RAMP_PATIENCE_S * max(speed, 1.0) + REPLIES_PER_STEP * steps * reply_s
            )

    def query(self, action: Callable[[], T]) -> T | None:
        """Return the result of the action; None if it failed, or if replies cannot be read any more."""
        if self.blind:
            return None
        try:
            return action()
        except InstrumentError as error:
            self._record_error(error)
            return None

    def step(self, command: str, send_confirmed: Callable[[], object]) -> None:
        """Send one step: `send_confirmed` sends and confirms it; `command` is sent if replies cannot be read any more.

        Raises:
            LinkError: the connection is lost, nothing can be sent; or a pipelined ramp was not confirmed.
            InstrumentError: a ramp away from rest takes too long.
        """
        if self._now() > self._latest_s:
            raise InstrumentError(
                f"{self._link.name}: a ramp to a level takes more than {RAMP_PATIENCE_S:g} s longer than commanded and is not continued, because "
                "the replies became slow; check the connection, close other programs and run again"
            )
        if self._best_effort and not self.blind and not self._slow_reply_s:
            self._slow_reply_s = self._read_slow_reply_s()
            self._batch = FIRST_STEPS if self._slow_reply_s else 1
        if not self.blind and self._unconfirmed < self._batch - 1:
            self._unconfirmed += 1
            self._pending.append(command)
            if self._join is None:
                self.flush()
            return
        if not self.blind:
            try:
                self.flush()
                begin_s, steps = self._now(), self._unconfirmed + 1
                send_confirmed()
                self._unconfirmed = 0
                if self._slow_reply_s and steps > 1:  # one step takes one reply time on every slow connection
                    wire_limited = self._now() - begin_s <= WIRE_LIMITED * self._slow_reply_s
                    self._batch = PIPELINED_STEPS if wire_limited else 1
            except InstrumentError as error:
                if isinstance(error, LinkError) and self.is_pipelined:
                    raise  # the number of executed steps is unknown: the ramp begins again at the present level
                self._record_error(error)
        if self.blind:
            self._link.write(command)

    @property
    def is_pipelined(self) -> bool:
        return self._slow_reply_s > 0

    def flush(self) -> None:
        """Send the pending steps as one message.

        Raises:
            LinkError: the connection is lost.
        """
        pending, self._pending = self._pending, []
        if pending and self._join is not None:
            self._link.write(self._join(pending))
        else:
            for command in pending:
                self._link.write(command)

    def raise_first_error(self) -> None:
        """Raise the first error of the ramp, if any.

        Raises:
            InstrumentError: a step failed; LinkError if replies could not be read.
        """
        if not self._errors:
            return
        first = self._errors[0]
        how = (
            "its answers could not be read, and the way to rest was sent blind"
            if self.blind
            else "it was sent all the same"
        )
        more = f"; {len(self._errors) - 1} more such errors" if len(self._errors) > 1 else ""
        raise type(first)(f"{first} ({how}{more})") from first

    def _record_error(self, error: InstrumentError) -> None:
        if not self._best_effort:
            raise error
        self._errors.append(error)
        self.blind = self.blind or isinstance(error, LinkError)
        self._on_failure(error)
