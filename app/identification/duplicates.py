"""Duplicate points of several runs: identical samples or identical values, which a fit must count once."""

import hashlib
from collections import Counter
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from model import Array, Mask
from protocols.base import Quality
from protocols.runfile import ENTRY_COLUMN, Run

MIN_SAMPLES = 16
"""Shorter recordings, and those without any change, may be equal by chance."""
MIN_DIGITS = 6
"""A value needs more significant digits to count as read from samples, not typed into a table."""
MIN_LONG_VALUES = 3


class DuplicateFinder:
    """Digests of the points of earlier runs and of the points that a continuation of a run measured again."""

    def __init__(self) -> None:
        self._seen: dict[bytes, Path] = {}
        self._repeated: dict[bytes, str] = {}

    def add_continuation(self, run: Run) -> None:
        """Count the points that a run carried over and measured again as duplicates in the run that it continues."""
        columns = run.points()
        for flags, row in zip(columns["quality"], _values(columns), strict=True):
            if Quality.SUPERSEDED in Quality(int(flags)) and _measured_digits(row):
                self._repeated[hashlib.sha256(row.tobytes()).digest()] = run.path.name

    def duplicates(self, run: Run) -> tuple[Mask, str]:
        """Return the points of a run that an earlier run has or a later one measured again, and a message (may be empty)."""
        columns = run.points()
        digests = _point_digests(run, columns)
        duplicates = [next((each for each in own if each in self._seen), None) for own in digests]
        origin = Counter(self._seen[each].name for each in duplicates if each is not None)
        for own in digests:
            for each in own:
                self._seen.setdefault(each, run.path)
        mask = np.array([each is not None for each in duplicates], bool)
        repeated = [
            {self._repeated[each] for each in own if each in self._repeated} - {run.path.name} if first is None else ()
            for own, first in zip(digests, duplicates, strict=True)
        ]
        parts = []
        if origin:
            names = " and ".join(sorted(origin))
            parts.append(f"holds the same data as {names} at {mask.sum()} of {mask.size} points: they are counted once")
        if any(repeated):
            names = " and ".join(sorted(set().union(*repeated)))
            count = sum(map(bool, repeated))
            parts.append(f"has {count} of {mask.size} points that {names} measured again: they are left out")
        message = f"{run.path.name} {', and '.join(parts)}" if parts else ""
        return mask | np.array(list(map(bool, repeated)), bool), message


def _values(columns: dict[str, Any]) -> Array:
    """Return all values of the points but their entry and quality, (points, values)."""
    count = len(columns[ENTRY_COLUMN])
    names = sorted(name for name in columns if name not in (ENTRY_COLUMN, "quality"))
    parts = [np.asarray(columns[name], float).reshape(count, -1) for name in names] if count else []
    return np.concatenate([np.empty((count, 0)), *parts], axis=1)


def _point_digests(run: Run, columns: dict[str, Any]) -> list[list[bytes]]:
    """Return for each point the digests of its samples and of its values; the whole table's for values of few digits."""
    samples = {} if run.setup.imported else _sample_digests(run)
    whole = _table_digest(run.setup.protocol, columns) if run.setup.imported else b""
    out = []
    for entry, row in zip(columns[ENTRY_COLUMN].astype(int).tolist(), _values(columns), strict=True):
        own = [samples[entry]] if entry in samples else []
        if _measured_digits(row):
            own.append(hashlib.sha256(row.tobytes()).digest())
        elif whole:
            own.append(whole)
        out.append(own)
    return out


def _sample_digests(run: Run) -> dict[int, bytes]:
    """Return the digest of the raw samples of each entry, of its last recordings in this file."""
    parts: dict[int, bytes] = {}
    for entry, raw in run.trace.raw_recordings():
        if raw[-1].size >= MIN_SAMPLES and np.ptp(raw[-1]) > 0:
            parts[entry] = hashlib.sha256(b"".join(channel.tobytes() for channel in raw)).digest()
    return parts


def _table_digest(protocol: str, columns: dict[str, Any]) -> bytes:
    """Return the digest of a table's measured values, without stated uncertainties."""
    names = sorted(n for n in columns if n not in (ENTRY_COLUMN, "quality") and not n.endswith("_errors"))
    digest = hashlib.sha256(protocol.encode())
    for name in names:
        digest.update(name.encode() + np.asarray(columns[name], float).tobytes())
    return digest.digest()


def _measured_digits(row: Any) -> bool:
    """Whether enough values of a point have more digits than a person would write."""
    values = row[np.isfinite(row)]
    long = (value for value in values.tolist() if float(f"{value:.{MIN_DIGITS}g}") != value)
    return sum(1 for _ in islice(long, MIN_LONG_VALUES)) == MIN_LONG_VALUES
