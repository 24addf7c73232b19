"""SCPI engine: headers in short and long form, compound messages, units, binary blocks, error queue.

An instrument declares its commands as patterns (`[SOURce[1]:]VOLTage[:LEVel]`); the engine finds the command for a
header, keeps the path from one command of a message to the next (IEEE 488.2, SCPI-99 Vol. 1 ch. 6), and joins replies.

The bytes of a binary block may look like an end of line, a comma or a quote. A block is `#`, a digit, that many digits of
length, and as many bytes (IEEE 488.2, 7.7.6). To some instruments the bytes go bare after `WAVEDATA,`: their socket reads
lines, and the first byte 0x0A ends the message (benchctrl at 0c6e51e). Messages are bytes, or the same as
Latin-1 text.
"""

import math
import re
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

Arguments = Sequence[str]
"""Text after a header, split at its commas."""

ERROR_MESSAGES = {
    0: "No error",
    -104: "Data type error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    -131: "Invalid suffix",
    -161: "Invalid block data",
    -211: "Trigger ignored",
    -221: "Settings conflict",
    -222: "Data out of range",
    -224: "Illegal parameter value",
    -225: "Out of memory",
    -350: "Error queue overflow",
    -410: "Query INTERRUPTED",
    786: "Specified arb waveform already exists",
}

_PREFIXES = {"": 1.0, "U": 1e-6, "M": 1e-3, "K": 1e3, "MA": 1e6}
_NUMBER = re.compile(r"^([+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?)\s*([A-Z]*)$", re.IGNORECASE)


class ScpiError(Exception):
    """A command was rejected; the engine puts `code` into the error queue."""

    def __init__(self, code: int, detail: str = "") -> None:
        super().__init__(f"{ERROR_MESSAGES[code]}; {detail}" if detail else ERROR_MESSAGES[code])
        self.code = code


def parse_number(
    text: str, unit: str, low: float = -math.inf, high: float = math.inf, default: float | None = None
) -> float:
    """A number with an optional unit (`5 KHZ`, `20MVPP`) or one of MIN MAX DEF INF.

    `M` is milli except before HZ and OHM, where it is mega.

    Raises:
        ScpiError: not a number, a foreign unit, or an unknown keyword of this setting.
    """
    word = text.strip().upper()
    keywords = {"MIN": low, "MAX": high, "DEF": default, "INF": math.inf}
    for long, short in (("MINIMUM", "MIN"), ("MAXIMUM", "MAX"), ("DEFAULT", "DEF"), ("INFINITY", "INF")):
        if word in (long, short):
            value = keywords[short]
            if value is None:
                raise ScpiError(-224)
            return value
    match = _NUMBER.match(word)
    if not match:
        raise ScpiError(-104)
    scale = 1.0
    if suffix := match.group(2):
        prefixes = _PREFIXES | ({"M": 1e6} if unit in ("HZ", "OHM") else {})
        prefix = suffix[: -len(unit)] if unit and suffix.endswith(unit) else None
        if prefix is None or prefix not in prefixes:
            raise ScpiError(-131)
        scale = prefixes[prefix]
    return float(match.group(1)) * scale


def parse_boolean(text: str) -> bool:
    """Return the value of ON, OFF or a number. Raises ScpiError for any other text."""
    word = text.strip().upper()
    if word in ("ON", "OFF"):
        return word == "ON"
    return parse_number(word, "") != 0


def short_form(name: str) -> str:
    """Return the short form of a keyword in mixed case: `SINusoid` is SIN."""
    return "".join(c for c in name if not c.islower())


def match_keyword(text: str, *names: str) -> str:
    """Return the short form of the name `text` among names in mixed case. Raises ScpiError for an unknown name."""
    for name in names:
        if text.strip().upper() in (short_form(name), name.upper()):
            return short_form(name)
    raise ScpiError(-224)


def format_real(value: float) -> str:
    """Return a float with a sign and 14 decimals; infinity is 9.9E+37."""
    return "+9.90000000000000E+37" if math.isinf(value) else f"{value:+.14E}"


def single_argument(arguments: Arguments) -> str:
    """Return the only argument of a command. Raises ScpiError for any other number of arguments."""
    if len(arguments) != 1:
        raise ScpiError(-108 if arguments else -109)
    return arguments[0]


def check_argument_count(arguments: Arguments, count: int) -> None:
    """Raise ScpiError unless there are `count` arguments."""
    if len(arguments) != count:
        raise ScpiError(-109)


_BLOCK_HEADER = re.compile(r"(?<=[ ,])#([1-9])")
_BARE_BLOCK_HEADER = re.compile(r"WAVEDATA,")
_PLACEHOLDER = "\x00"
"""Mark in place of a block in a message; no driver sends it."""


def split_received(received: bytes) -> tuple[list[str], bytes]:
    """Return the complete messages among the received bytes, and the incomplete rest."""
    text, messages, start, look = received.decode("latin-1"), [], 0, 0
    while (end := text.find("\n", look)) >= 0:
        span = _next_block(text, look, end)
        if span is not None and span[1] > end:
            look = span[1]
            if look > len(text):
                break
            continue
        messages.append(text[start:end])
        start = look = end + 1
    return messages, received[start:]


def extract_blocks(message: str) -> tuple[str, list[str]]:
    """Return the message with a mark in place of each block, and the blocks' bytes as Latin-1 text.

    A block shorter than its length at the end of its message is empty: it is invalid (SCPI-99, error -161).
    """
    blocks, look = [], 0
    while (span := _next_block(message, look, len(message))) is not None:
        begin, end, data = span
        blocks.append(message[data:end] if end <= len(message) else "")
        message = message[:begin] + _PLACEHOLDER + message[end:]
        look = begin + 1
    return message, blocks


def restore_block(argument: str, blocks: list[str]) -> str:
    """Return the block of a mark among the arguments; blocks are used in order."""
    return blocks.pop(0) if argument == _PLACEHOLDER else argument


def _next_block(text: str, start: int, end: int) -> tuple[int, int, int] | None:
    """Return begin, end and first data byte of the first block that begins in `text[look:end]`."""
    parts = []
    if block := _BLOCK_HEADER.search(text, start, end):
        digits = int(block[1])
        length = text[block.end() : block.end() + digits]
        size = int(length) if length.isdigit() and len(length) == digits else 1 << 30
        data = block.end() + digits
        parts.append((block.start(), data + size, data))
    if bare := _BARE_BLOCK_HEADER.search(text, start, end):
        parts.append((bare.end(), end, bare.end()))
    return min(parts, default=None)


ERROR_QUEUE_LENGTH = 20
"""Capacity of the error queue; its last entry reports an overflow."""


@dataclass(frozen=True, slots=True)
class ScpiResponse:
    """A reply: its text, and the bench seconds until it is sent."""

    text: str
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class ScpiCommand:
    """A header pattern with its setter and its query; either may be missing."""

    pattern: str
    set: Callable[[Arguments], None] | None = None
    query: Callable[[Arguments], str] | None = None


class ScpiInstrument(Protocol):
    """Interface of an instrument model to the engine."""

    identity: str

    @property
    def commands(self) -> Sequence[ScpiCommand]: ...

    def reset(self) -> None:
        """`*RST`."""

    def trigger(self) -> None:
        """`*TRG`."""

    def busy_s(self) -> float:
        """Return the seconds until the end of all started operations (`*OPC?`)."""


def header_regex(pattern: str) -> re.Pattern[str]:
    """Return the pattern as a regular expression over headers without leading colon.

    `VOLTage` is VOLT or VOLTAGE, `[x]` may be left out, a number is a suffix, one in brackets an optional suffix.
    """
    out = []
    for part in re.findall(r"\[\d+\]|[A-Za-z_]+|\d+|[\[\]:]|\*[A-Z]+", pattern):
        if part == "[":
            out.append("(?:")
        elif part == "]":
            out.append(")?")
        elif part.startswith("["):
            out.append(f"{part[1:-1]}?")
        elif part == ":" or part.isdigit():
            out.append(part)
        else:
            short = short_form(part)
            rest = part[len(short) :].upper()
            out.append(re.escape(short) + (f"(?:{rest})?" if rest else ""))
    return re.compile("^" + "".join(out) + "$", re.IGNORECASE)


def split_message(message: str, separator: str) -> list[str]:
    """Return the pieces of a message; separators inside quotes do not split."""
    pieces = re.split(separator + r"""(?=(?:[^"']*["'][^"']*["'])*[^"']*$)""", message)
    return [piece.strip() for piece in pieces]


class ScpiEngine:
    """Runs messages on one instrument model and keeps its error queue and event register."""

    def __init__(self, instrument: ScpiInstrument) -> None:
        self._instrument = instrument
        self.process_command: Callable[[], None] = lambda: None
        """Callback between two setting commands of one message: an instrument executes them one after the other."""
        self._errors: deque[tuple[int, str]] = deque()
        self._event_status = 128  # power on
        self._delay_s = 0.0
        common = [
            ScpiCommand("*CLS", set=self._clear),
            ScpiCommand("*IDN", query=lambda _: instrument.identity),
            ScpiCommand("*RST", set=lambda _: instrument.reset()),
            ScpiCommand("*TRG", set=lambda _: instrument.trigger()),
            ScpiCommand("*OPC", set=self._set_operation_complete, query=self._query_operation_complete),
            ScpiCommand("*WAI", set=lambda _: None),
            ScpiCommand("*ESR", query=self._read_event_status),
            ScpiCommand("*ESE", set=lambda _: None, query=lambda _: "0"),
            ScpiCommand("*STB", query=lambda _: str(4 * bool(self._errors))),
            ScpiCommand("*TST", query=lambda _: "+0"),
            ScpiCommand("SYSTem:ERRor[:NEXT]", query=self._next_error),
            ScpiCommand("SYSTem:VERSion", query=lambda _: "1999.0"),
        ]
        self._table = [(header_regex(c.pattern), c) for c in [*common, *instrument.commands]]
        self._command_cache: dict[str, ScpiCommand | None] = {}

    def execute(self, message: str) -> ScpiResponse | None:
        """Run one message (without its terminator); return the joined replies of its queries, or None."""
        self._delay_s = 0.0
        answers, path, has_set = [], "", False
        message, blocks = extract_blocks(message)
        if blocks and getattr(self._instrument, "BLOCK_ENDS_MESSAGE", False):
            message = message.partition(_PLACEHOLDER)[0] + _PLACEHOLDER
        for part in split_message(message.strip(), ";"):
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
            arguments = [restore_block(a, blocks) for a in split_message(tail, ",") if a]
            if has_set and not query:
                self.process_command()
            has_set |= not query
            try:
                answer = self._run(header, query, arguments)
            except ScpiError as error:
                self.queue_error(error)
                if error.code == -113 and getattr(self._instrument, "UNKNOWN_HEADER_ENDS_MESSAGE", False):
                    break
                continue
            if answer is not None:
                answers.append(answer)
        return ScpiResponse(";".join(answers), self._delay_s) if answers else None

    @property
    def hung(self) -> bool:
        """Whether the instrument's remote control is dead until its power returns."""
        return bool(getattr(self._instrument, "hung", False))

    @property
    def silent(self) -> bool:
        """Whether the instrument does not answer at present."""
        return bool(getattr(self._instrument, "silent", False))

    @property
    def single_session(self) -> bool:
        """Whether the instrument serves one connection at a time."""
        return bool(getattr(self._instrument, "SINGLE_SESSION", False))

    def queue_error(self, error: ScpiError) -> None:
        """Put an error into the queue."""
        bit = 32 if -200 < error.code <= -100 else 16 if -300 < error.code <= -200 else 4
        self._event_status |= bit
        if len(self._errors) < ERROR_QUEUE_LENGTH:
            self._errors.append((error.code, str(error)))
        else:
            self._errors[-1] = (-350, ERROR_MESSAGES[-350])

    def _run(self, header: str, query: bool, arguments: Arguments) -> str | None:
        key = header.upper()
        if key not in self._command_cache:
            self._command_cache[key] = next((c for regex, c in self._table if regex.match(key)), None)
        command = self._command_cache[key]
        action = None if command is None else command.query if query else command.set
        if action is None:
            raise ScpiError(-113)
        return action(arguments)

    def _clear(self, _: Arguments) -> None:
        self._errors.clear()
        self._event_status = 0

    def _set_operation_complete(self, _: Arguments) -> None:
        self._event_status |= 1

    def _query_operation_complete(self, _: Arguments) -> str:
        self._delay_s = max(self._delay_s, self._instrument.busy_s())
        return "1"

    def _read_event_status(self, _: Arguments) -> str:
        events, self._event_status = self._event_status, 0
        return f"+{events}"

    def _next_error(self, _: Arguments) -> str:
        code, text = self._errors.popleft() if self._errors else (0, ERROR_MESSAGES[0])
        return f'{code:+d},"{text}"'
