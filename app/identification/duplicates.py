"""Duplicate points of several runs: identical samples or identical values, which a fit must count once."""

import hashlib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from model import Mask
from protocols.runfile import CHANNELS, ENTRY_COLUMN, Run

MIN_SAMPLES = 16
"""Shorter recordings, and those without any change, may be equal by chance."""
MIN_DIGITS = 6
"""A value needs more significant digits to count as read from samples, not typed into a table."""
MIN_LONG_VALUES = 3


class DuplicateFinder:
    """Digests of the points of the runs seen so far."""

    def __init__(self) -> None:
        self._seen: dict[bytes, Path] = {}

    def duplicates(self, run: Run) -> tuple[Mask, str]:
        """Return which points of a run the runs before it have, too, and a message (empty without any)."""
        columns = run.points()
        digests = _point_digests(run, columns)
        duplicates = [next((each for each in own if each in self._seen), None) for own in digests]
        origin = Counter(self._seen[each].name for each in duplicates if each is not None)
        for own in digests:
            for each in own:
                self._seen.setdefault(each, run.path)
        mask = np.array([each is not None for each in duplicates], bool)
        if not origin:
            return mask, ""
        names = " and ".join(sorted(origin))
        return mask, (
            f"{run.path.name} holds the same data as {names} at {mask.sum()} of {mask.size} points: they are counted once"
        )


def _point_digests(run: Run, columns: dict[str, Any]) -> list[list[bytes]]:
    """Return for each point the digests of its samples and of its values; the whole table's for values of few digits."""
    names = sorted(name for name in columns if name not in (ENTRY_COLUMN, "quality"))
    count = len(columns[ENTRY_COLUMN])
    rows = [[np.atleast_1d(np.asarray(columns[name][i], float)) for name in names] for i in range(count)]
    flat = [np.concatenate(row) if row else np.empty(0) for row in rows]
    samples = {} if run.record.imported else _sample_digests(run)
    whole = _table_digest(run.record.protocol, columns) if run.record.imported else b""
    out = []
    for entry, row in zip(columns[ENTRY_COLUMN].astype(int).tolist(), flat, strict=True):
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
    for start, stop, entry in run.trace.recording_rows():
        raw = [run.trace.read_raw(channel, start, stop) for channel in CHANNELS]
        if stop - start >= MIN_SAMPLES and np.ptp(raw[-1]) > 0:
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
    long = [value for value in values.tolist() if float(f"{value:.{MIN_DIGITS}g}") != value]
    return len(long) >= MIN_LONG_VALUES
