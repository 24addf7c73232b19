"""What validation refuses in what a person wrote, as that person can mend it: where it stands, and what would do."""

import re
from collections.abc import Callable
from typing import Any

from pydantic import ValidationError

from app.common.inputs import shortened

BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def faults(error: ValidationError, text: str = "", unit: Callable[[str], str] = lambda _: "") -> list[str]:
    """One line a fault: where it stands, what is there, and what would do; in the unit that a key has."""
    lines = []
    for fault in error.errors():
        path = [str(part) for part in fault["loc"]]
        line = _line_of(path, text)
        at = f"line {line}: " if line else ""
        lines.append(f"  {at}{'.'.join(path) + ': ' if path else ''}{_words(fault, unit)}")
    return lines


def _words(fault: Any, unit: Callable[[str], str]) -> str:
    kind, context, value = fault["type"], fault.get("ctx", {}), fault["input"]
    given = f"{value:.12g}" if isinstance(value, float) else shortened(repr(value))
    if kind == "extra_forbidden":
        return "unknown key; remove it or correct its spelling"
    if kind in BOUNDS:
        key, words = BOUNDS[kind]
        of = f" {known}" if fault["loc"] and (known := unit(str(fault["loc"][0]))) else ""
        return f"must be {words} {context[key]:g}{of}, not {given}{of}"
    message = fault["msg"].removeprefix("Value error, ").replace("Input should be", "must be").replace("valid ", "")
    message = message[:1].lower() + message[1:]
    return str(message) if kind in ("value_error", "missing") else f"{message}, not {given}"


def _line_of(path: list[str], text: str) -> int:
    """The line of a key in a TOML text, 0 where it is not found."""
    tables, key = path[:-1], path[-1] if path else ""
    table: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        if header := re.match(r"\s*\[([^\[\]]+)\]", line):
            table = [part.strip().strip("\"'") for part in header[1].split(".")]
            if table == path:
                return number
        elif table == tables and re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=", line):
            return number
    return 0
