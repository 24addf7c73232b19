"""File names of runs, specimens and sidecars; specimens are escaped so that different names never share a file, on any file system."""

import hashlib
from datetime import datetime
from pathlib import Path

MAX_NAME_BYTES = 100
"""Longest part of a specimen in a file name, which has at most 255 bytes; the full name is in the file."""
NOTES_SUFFIX = ".notes.json"
"""Suffix of a run's sidecar."""
SHEET_SUFFIX = ".specimen.toml"
"""Suffix of a specimen sheet."""
MOUNTINGS_SUFFIX = ".mountings.json"
"""Suffix of the mountings of a specimen."""
_HASH_DIGITS = 16
_RESERVED = frozenset({"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in "123456789¹²³")})
"""Names of devices on Windows, with any extension."""


def safe_name(specimen: str) -> str:
    """Return the specimen's name as a part of a file name.

    Letters, digits, `-` and `.` remain; every other character, a dot at either end and the first letter of a device name
    of Windows become `%` and the hexadecimal bytes of UTF-8, which `urllib.parse.unquote` reverses. A name that is too
    long ends in a hash.
    """
    last = len(specimen) - 1
    parts = [
        char if char.isalnum() or char == "-" or (char == "." and 0 < i < last) else _escape(char)
        for i, char in enumerate(specimen)
    ]
    if specimen.partition(".")[0].rstrip().lower() in _RESERVED:
        parts[0] = _escape(specimen[0])
    name = "".join(parts)
    if len(name.encode()) <= MAX_NAME_BYTES:
        return name or "%"
    digest = hashlib.sha256(specimen.encode("utf-8", "surrogatepass")).hexdigest()[:_HASH_DIGITS]
    return f"{truncate_utf8(name, MAX_NAME_BYTES - _HASH_DIGITS - 2).decode()}%~{digest}"


def run_path(folder: Path, specimen: str, protocol: str, started_at: datetime) -> Path:
    """Return a path with time, specimen and protocol, which sorts by time: `20261121T091502Z_T7_sine-dwell.h5`."""
    return folder / f"{started_at:%Y%m%dT%H%M%SZ}_{safe_name(specimen)}_{protocol}.h5"


def sheet_path(folder: Path, specimen: str) -> Path:
    """Return the path of a specimen's sheet, beside its runs."""
    return folder / f"{safe_name(specimen)}{SHEET_SUFFIX}"


def mountings_path(folder: Path, specimen: str) -> Path:
    """Return the path of a specimen's mountings, beside its runs."""
    return folder / f"{safe_name(specimen)}{MOUNTINGS_SUFFIX}"


def notes_path(run: Path) -> Path:
    """Return the path of a run's sidecar."""
    return run.with_suffix(NOTES_SUFFIX)


def folded_name(specimen: str) -> str:
    """Return the name of earlier versions: other characters became `-`, so that names could coincide."""
    kept = "".join(char if char.isalnum() or char in "-." else "-" for char in specimen)
    return truncate_utf8(kept, MAX_NAME_BYTES).decode() or "unnamed"


def other_specimen_message(path: Path, suffix: str, owner: str, specimen: str) -> str:
    """Return the reason why a file cannot be used for a specimen: it belongs to another one, `owner`."""
    right = safe_name(owner) + suffix
    remedy = (
        "this file system does not distinguish upper and lower case; give the specimen another name, or use another folder"
        if right.lower() == (safe_name(specimen) + suffix).lower()
        else f"an earlier version of the program gave both the same file; rename it to {right}"
    )
    return f"{path} belongs to specimen {owner}, not to {specimen}: {remedy}"


def truncate_utf8(text: str, length: int) -> bytes:
    """Return the text in at most `length` bytes, without a split character."""
    return text.encode("utf-8", "ignore")[:length].decode(errors="ignore").encode()


def _escape(char: str) -> str:
    return "".join(f"%{byte:02X}" for byte in char.encode("utf-8", "surrogatepass"))
