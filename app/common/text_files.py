"""TOML files written elsewhere: of bounded length, nesting and numbers."""

import re
import tomllib
from typing import Any

from protocols.base import MAX_NESTING, check_values

MAX_TOML_BYTES = 1_000_000
"""Longest TOML file."""
TOML_KEY = re.compile(r"^[^,=\n]*(?:=|\])", re.MULTILINE)
"""Beginning of a line with a dotted key; the time to parse one grows with the square of its parts."""


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
