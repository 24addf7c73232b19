"""Values in SCPI messages: numbers with units, booleans, choices, and the errors a bad one makes (SCPI-99, IEEE 488.2)."""

import math
import re
from collections.abc import Sequence

Arguments = Sequence[str]
"""What follows a header, split at its commas."""

MESSAGES = {
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
    """A command was refused; the engine puts `code` into the error queue."""

    def __init__(self, code: int, detail: str = "") -> None:
        super().__init__(f"{MESSAGES[code]}; {detail}" if detail else MESSAGES[code])
        self.code = code


def number(text: str, unit: str, low: float = -math.inf, high: float = math.inf, default: float | None = None) -> float:
    """A number with an optional unit (`5 KHZ`, `20MVPP`) or one of MIN MAX DEF INF.

    `M` is milli except before HZ and OHM, where it is mega.

    Raises:
        ScpiError: not a number, a foreign unit, or a keyword that this setting does not know.
    """
    word = text.strip().upper()
    keywords = {"MIN": low, "MAX": high, "DEF": default, "INF": math.inf}
    for long, short in (("MINIMUM", "MIN"), ("MAXIMUM", "MAX"), ("DEFAULT", "DEF"), ("INFINITY", "INF")):
        if word in (long, short):
            value = keywords[short]
            if value is None:
                raise ScpiError(-224)
            return value
    found = _NUMBER.match(word)
    if not found:
        raise ScpiError(-104)
    scale = 1.0
    if suffix := found.group(2):
        prefixes = _PREFIXES | ({"M": 1e6} if unit in ("HZ", "OHM") else {})
        prefix = suffix[: -len(unit)] if unit and suffix.endswith(unit) else None
        if prefix is None or prefix not in prefixes:
            raise ScpiError(-131)
        scale = prefixes[prefix]
    return float(found.group(1)) * scale


def boolean(text: str) -> bool:
    """ON, OFF or a number. Raises ScpiError for anything else."""
    word = text.strip().upper()
    if word in ("ON", "OFF"):
        return word == "ON"
    return number(word, "") != 0


def choice(text: str, *names: str) -> str:
    """The short form of the name that `text` is, names given in mixed case. Raises ScpiError if it is none."""
    for name in names:
        short = "".join(c for c in name if not c.islower())
        if text.strip().upper() in (short, name.upper()):
            return short
    raise ScpiError(-224)


def real(value: float) -> str:
    """A float as Trueform boxes write it; infinity is 9.9E+37."""
    return "+9.90000000000000E+37" if math.isinf(value) else f"{value:+.14E}"


def one(arguments: Arguments) -> str:
    """The only argument of a command. Raises ScpiError if there is none or more than one."""
    if not arguments:
        raise ScpiError(-109)
    if len(arguments) > 1:
        raise ScpiError(-108)
    return arguments[0]
