"""A small SCPI engine: headers in short and long form, compound messages, units, and an error queue.

An instrument declares its commands as patterns (`[SOURce[1]:]VOLTage[:LEVel]`); the engine finds the command for a
header, keeps the path from one command of a message to the next (IEEE 488.2, SCPI-99 Vol. 1 ch. 6), and joins answers.
"""

import re
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from sim_hardware.scpi_blocks import lift_blocks, put_back
from sim_hardware.scpi_values import MESSAGES, Arguments, ScpiError

QUEUE = 20
"""Errors a box keeps; the last place then says that more were lost."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a box sends back: the text, and how many seconds of bench time it takes to do so."""

    text: str
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Command:
    """A header pattern with what it does when set and what it answers when asked; either may be missing."""

    pattern: str
    set: Callable[[Arguments], None] | None = None
    query: Callable[[Arguments], str] | None = None


class Instrument(Protocol):
    """What the engine needs of an instrument's model."""

    identity: str

    @property
    def commands(self) -> Sequence[Command]: ...

    def reset(self) -> None:
        """`*RST`."""

    def trigger(self) -> None:
        """`*TRG`."""

    def busy_s(self) -> float:
        """Seconds until everything started has finished (`*OPC?`)."""


def header_regex(pattern: str) -> re.Pattern[str]:
    """The pattern as a regular expression over headers without leading colon.

    `VOLTage` is VOLT or VOLTAGE, `[x]` may be left out, a number in brackets is an optional suffix.
    """
    out = []
    for part in re.findall(r"\[\d+\]|[A-Za-z]+|[\[\]:]|\*[A-Z]+", pattern):
        if part == "[":
            out.append("(?:")
        elif part == "]":
            out.append(")?")
        elif part.startswith("["):
            out.append(f"{part[1:-1]}?")
        elif part == ":":
            out.append(":")
        else:
            short = "".join(c for c in part if not c.islower())
            rest = part[len(short) :].upper()
            out.append(re.escape(short) + (f"(?:{rest})?" if rest else ""))
    return re.compile("^" + "".join(out) + "$", re.IGNORECASE)


def split(message: str, separator: str) -> list[str]:
    """Pieces of a message, separators inside quotes left alone."""
    pieces = re.split(separator + r"""(?=(?:[^"']*["'][^"']*["'])*[^"']*$)""", message)
    return [piece.strip() for piece in pieces]


class Engine:
    """Runs messages on one instrument model and keeps its error queue and event register."""

    def __init__(self, instrument: Instrument) -> None:
        self._instrument = instrument
        self._errors: deque[tuple[int, str]] = deque()
        self._events = 128  # power on
        self._delay = 0.0
        common = [
            Command("*CLS", set=self._clear),
            Command("*IDN", query=lambda _: instrument.identity),
            Command("*RST", set=lambda _: instrument.reset()),
            Command("*TRG", set=lambda _: instrument.trigger()),
            Command("*OPC", set=self._complete, query=self._completed),
            Command("*WAI", set=lambda _: None),
            Command("*ESR", query=self._event_register),
            Command("*ESE", set=lambda _: None, query=lambda _: "0"),
            Command("*STB", query=lambda _: str(4 * bool(self._errors))),
            Command("*TST", query=lambda _: "+0"),
            Command("SYSTem:ERRor[:NEXT]", query=self._next_error),
            Command("SYSTem:VERSion", query=lambda _: "1999.0"),
        ]
        self._table = [(header_regex(c.pattern), c) for c in [*common, *instrument.commands]]
        self._known: dict[str, Command | None] = {}

    def execute(self, message: str) -> Answer | None:
        """Run one message (without its terminator); the joined answers of its queries, or None."""
        self._delay = 0.0
        answers, path = [], ""
        message, blocks = lift_blocks(message)
        for part in split(message.strip(), ";"):
            if not part:
                continue
            head, _, tail = part.partition(" ")
            query = head.endswith("?")
            name = head.rstrip("?")
            if name.startswith("*"):
                header = name
            else:
                header = name[1:] if name.startswith(":") else path + name
                path = header[: header.rfind(":") + 1]
            arguments = [put_back(a, blocks) for a in split(tail, ",") if a]
            try:
                answer = self._run(header, query, arguments)
            except ScpiError as error:
                self.report(error)
                continue
            if answer is not None:
                answers.append(answer)
        return Answer(";".join(answers), self._delay) if answers else None

    def report(self, error: ScpiError) -> None:
        """Put an error into the queue."""
        bit = 32 if -200 < error.code <= -100 else 16 if -300 < error.code <= -200 else 4
        self._events |= bit
        if len(self._errors) < QUEUE:
            self._errors.append((error.code, str(error)))
        else:
            self._errors[-1] = (-350, MESSAGES[-350])

    def _run(self, header: str, query: bool, arguments: Arguments) -> str | None:
        key = header.upper()
        if key not in self._known:
            self._known[key] = next((c for regex, c in self._table if regex.match(key)), None)
        command = self._known[key]
        if command is None:
            raise ScpiError(-113)
        if query:
            if command.query is None:
                raise ScpiError(-113)
            return command.query(arguments)
        if command.set is None:
            raise ScpiError(-113)
        command.set(arguments)
        return None

    def _clear(self, _: Arguments) -> None:
        self._errors.clear()
        self._events = 0

    def _complete(self, _: Arguments) -> None:
        self._events |= 1

    def _completed(self, _: Arguments) -> str:
        self._delay = max(self._delay, self._instrument.busy_s())
        return "1"

    def _event_register(self, _: Arguments) -> str:
        events, self._events = self._events, 0
        return f"+{events}"

    def _next_error(self, _: Arguments) -> str:
        code, text = self._errors.popleft() if self._errors else (0, MESSAGES[0])
        return f'{code:+d},"{text}"'
