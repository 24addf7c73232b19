"""Message port of a simulated SCPI instrument, with the faults of its link."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from sim_hardware.plant import FaultState
from sim_hardware.wires.scpi_engine import ScpiResponse

HOST = "127.0.0.1"
"""Host of all simulated instruments."""

LATE_RESPONSE_S = 4.0
"""Delay of a late reply: longer than any driver's wait."""


class MessageEngine(Protocol):
    """Runs the messages of one instrument: `ScpiEngine`, or that of an instrument of another package."""

    process_command: Callable[[], None]

    @property
    def single_session(self) -> bool:
        """Whether the instrument serves one connection at a time."""

    @property
    def hung(self) -> bool:
        """Whether its remote control is dead until its power returns."""

    @property
    def silent(self) -> bool:
        """Whether it does not answer at present."""

    def execute(self, message: str) -> ScpiResponse | None:
        """Run one message without its terminator; return its reply, or None."""


@dataclass(frozen=True, slots=True)
class WireResponse:
    """Reply on the wire.

    Attributes:
        text: reply without its end of line.
        delay_s: bench seconds until the instrument replies.
        late_s: additional delay of the connection in its own seconds.
        terminated: whether the end of line follows.
    """

    text: str
    delay_s: float = 0.0
    late_s: float = 0.0
    terminated: bool = True

    @property
    def data(self) -> bytes:
        """The bytes on the wire."""
        return self.text.encode("latin-1", errors="replace") + (b"\n" if self.terminated else b"")

    def wait_s(self, command_s: float, speed: float) -> float:
        """Return the real seconds until it is sent, with `command_s` of bench time per message."""
        return (self.delay_s + command_s) / speed + self.late_s


class MessagePort:
    """Runs the messages of one instrument and applies link faults to its replies.

    Args:
        engine: engine of the instrument.
        faults: faults of the bench.
        make_other: function that makes the instrument that answers with the fault scpi-other-model.
    """

    def __init__(
        self, engine: MessageEngine, faults: FaultState, make_other: Callable[[], MessageEngine] | None = None
    ) -> None:
        self._engine = engine
        self._faults = faults
        self._make_other = make_other
        self._other: MessageEngine | None = None
        self._previous_text = ""
        self._lock = threading.Lock()

    def set_processing(self, process_command: Callable[[], None]) -> None:
        """Call `process_command` between the setting commands of a message."""
        self._engine.process_command = process_command

    @property
    def single_session(self) -> bool:
        """Whether the instrument serves one connection at a time."""
        return self._engine.single_session

    @property
    def connected(self) -> bool:
        """Whether the instrument is reachable."""
        return not (self._faults.is_active("scpi-dropped") or self._faults.is_active("generator-power-off"))

    def _answering_engine(self) -> MessageEngine:
        if self._make_other is None or not self._faults.is_active("scpi-other-model"):
            return self._engine
        if self._other is None:
            self._other = self._make_other()
        return self._other

    def handle(self, message: str) -> WireResponse | None:
        """Run one message; return None without a reply."""
        if self._faults.is_active("scpi-silent") or not self.connected:
            return None
        if self._engine.hung:
            return None
        with self._lock:
            engine = self._answering_engine()
            silent = engine.silent
            answer = engine.execute(message)
            if answer is None or silent:
                return None
            text, ended, late = answer.text, True, 0.0
            previous, self._previous_text = self._previous_text, text
        if self._faults.is_active("scpi-previous"):
            text = previous
        if self._faults.is_active("scpi-late"):
            late = LATE_RESPONSE_S
        if self._faults.is_active("scpi-garbled"):
            # Eighth bits set and letters shifted: neither ASCII nor a number.
            text = "".join(chr((ord(c) + 17 * i) % 95 + 160) for i, c in enumerate(text))
        if self._faults.is_active("scpi-half"):
            text, ended = text[: len(text) // 2], False
        return WireResponse(text, answer.delay_s, late, ended)
