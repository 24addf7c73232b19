"""TOML files written elsewhere: of bounded length, nesting and numbers."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from protocols.base import MAX_NESTING, check_values, open_regular

MAX_TOML_BYTES = 1_000_000
"""Most characters of a TOML file; a longer file is something else."""
TOML_KEY = re.compile(r"^[^,=\n]*(?:=|\])", re.MULTILINE)
"""Beginning of a line with a dotted key; the time to parse one grows with the square of its parts."""


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
    check_values(tables)
    return tables
