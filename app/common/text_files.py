"""Text files written elsewhere: UTF-8 of bounded length, JSON and TOML of bounded nesting and numbers."""

import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from protocols.base import MAX_NESTING, check_values, parse_json_object

MAX_JSON_BYTES = 20_000_000
"""Longest JSON file; a campaign, notes or calibrations have some kilobytes."""
MAX_TOML_BYTES = 1_000_000
"""Longest TOML file."""
TOML_KEY = re.compile(r"^[^,=\n]*(?:=|\])", re.MULTILINE)
"""Beginning of a line with a dotted key; the time to parse one grows with the square of its parts."""


def read_json_file(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not a regular file, too long, not UTF-8 text, or not an object of plain values.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise ValueError("it is not a regular file")
    with path.open("rb") as file:
        data = file.read(MAX_JSON_BYTES + 1)
    if len(data) > MAX_JSON_BYTES:
        raise ValueError(f"it is longer than {MAX_JSON_BYTES / 1e6:g} MB")
    try:
        return parse_json_object(data.decode())
    except UnicodeDecodeError:
        raise ValueError("it is not UTF-8 text") from None


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
