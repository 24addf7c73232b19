"""Text from files: control characters made visible, JSON and TOML of bounded length, depth and numbers; values as JSON types."""

import json
import math
import os
import re
import tomllib
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from drivers import open_regular

MAX_NESTING = 40
"""Largest depth of lists and objects in a JSON or TOML text; the program's own texts have six levels."""
MAX_JSON_BYTES = 20_000_000
"""Longest JSON file; a campaign, notes or calibrations have some kilobytes."""
MAX_TOML_BYTES = 1_000_000
"""Most characters of a TOML file; a longer file is something else."""
TOML_KEY = re.compile(r"^[^,=\n]*(?:=|\])", re.MULTILINE)
"""Beginning of a line with a dotted key; the time to parse one grows with the square of its parts."""
MAX_INTEGER_BITS = 64
"""Longest integer of a JSON or TOML text."""

CONTROL_CHARACTERS = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Characters that move a terminal's cursor, change its state or its reading direction, and surrogate halves."""


def visible_text(text: str, multiline: bool = False) -> str:
    r"""Return a text with control characters as escapes such as `\x1b`; `multiline` keeps line feeds and tabs.

    A text from a file must not control a terminal.
    """
    if text.isprintable():
        return text
    text = CONTROL_CHARACTERS.sub(_escape, text)
    return text if multiline else text.replace("\n", r"\n").replace("\t", r"\t")


def parse_json_object(text: str) -> dict[str, Any]:
    """Return the object of a JSON text.

    Raises:
        ValueError: it is not JSON, not an object, nested too deeply, or has integers beyond 64 bits.
    """
    try:
        value = json.loads(text, parse_int=_parse_integer)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(value, dict):
        raise ValueError("it is not a JSON object")
    if text.count("[") + text.count("{") > MAX_NESTING:
        _check_values(value)
    return value


def read_json_file(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file.

    Raises:
        OSError: the file cannot be read, or is not a regular one.
        ValueError: it is too long, not UTF-8 text, or not an object of plain values.
    """
    with open_regular(path) as file:
        # Allocating a buffer of the largest size would dominate the time.
        data = file.read(min(os.fstat(file.fileno()).st_size, MAX_JSON_BYTES) + 1)
    if len(data) > MAX_JSON_BYTES:
        raise ValueError(f"it is longer than {MAX_JSON_BYTES / 1e6:g} MB")
    try:
        return parse_json_object(data.decode())
    except UnicodeDecodeError:
        raise ValueError("it is not UTF-8 text") from None


def read_toml_text(
    path: Path, name: str, kind: str, error_of: Callable[[str], Exception], missing: str | None = None
) -> str:
    """Return the text of a TOML file.

    Args:
        path: of the file.
        name: of the file in messages.
        kind: kind of file, in messages.
        error_of: function that makes the exception of a message, raised for an unreadable or too long file.
        missing: text in place of a file that does not exist; None: its absence is an error.
    """
    try:
        with open_regular(path, "r", encoding="utf-8") as file:
            text: str = file.read(MAX_TOML_BYTES + 1)
    except (OSError, ValueError) as error:
        if missing is not None and isinstance(error, FileNotFoundError):
            return missing
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise error_of(f"{name} cannot be read: {reason}") from error
    if len(text) > MAX_TOML_BYTES:
        raise error_of(f"{path} is longer than {MAX_TOML_BYTES / 1e6:g} MB and no {kind}")
    return text


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Raises:
        ValueError: it is not TOML, is nested too deeply, or has integers beyond 64 bits.
    """
    if any(key[0].count(".") > MAX_NESTING for key in TOML_KEY.finditer(text)):
        raise ValueError("it is nested too deeply")
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    _check_values(tables)
    return tables


def visible_values(value: Any) -> Any:
    """Return lists and dicts with control characters as escapes in every text; line feeds and tabs are kept."""
    if isinstance(value, str):
        return visible_text(value, multiline=True)
    if isinstance(value, dict):
        return {visible_text(name): visible_values(inner) for name, inner in value.items()}
    return [*map(visible_values, value)] if isinstance(value, list) else value


def _check_values(value: Any, depth: int = 0) -> None:
    """Raise ValueError for values nested too deeply, and for integers beyond 64 bits."""
    if depth > MAX_NESTING:
        raise ValueError("it is nested too deeply")
    if isinstance(value, int) and value.bit_length() >= MAX_INTEGER_BITS:
        raise ValueError(f"a number has {len(str(value))} digits")
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_values(inner, depth + 1)


def _parse_integer(digits: str) -> int:
    if len(digits) > 20 or (value := int(digits)).bit_length() >= MAX_INTEGER_BITS:
        raise ValueError(f"a number has {len(digits)} digits")
    return value


def _escape(match: re.Match[str]) -> str:
    code = ord(match[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


def to_jsonable(value: Any) -> Any:
    """Return the value as dicts, lists, numbers and texts; NaN and infinity become None."""
    match value:
        case None | bool() | str() | int() if not isinstance(value, Enum):
            return value
        case float():
            return float(value) if math.isfinite(value) else None
        case dict():
            return {str(name): to_jsonable(item) for name, item in value.items()}
        case list() | tuple():
            return [to_jsonable(item) for item in value]
        case Enum():
            return to_jsonable(value.value)
    # A number of numpy, which is not imported here, because the command line starts without it.
    if hasattr(value, "tolist"):
        return to_jsonable(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_jsonable(getattr(value, field.name)) for field in fields(value)}
    return str(value)
