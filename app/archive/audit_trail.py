"""Audit trail of a folder of runs: begin, record and verify, with the hashes of its files."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from app.common import (
    LOG_NAME,
    MIN_HEAD_LENGTH,
    NO_PROGRESS,
    AuditEntry,
    AuditError,
    Progress,
    append_entry,
    audited_hash,
    current_conditions,
    read_entries,
)

AUDITED_SUFFIXES = (
    ".h5",
    ".calibrations.json",
    ".campaign.json",
    ".notes.json",
    ".specimen.toml",
    ".mountings.json",
    ".certificate.json",
)
"""Files that are recorded when an audit trail begins, and looked for when it is verified."""


@dataclass(frozen=True, slots=True)
class AuditResult:
    """Result of a verification: faults, and the hash of the last line."""

    entries: tuple[AuditEntry, ...]
    problems: tuple[str, ...]
    unrecorded: tuple[str, ...]
    """Files that the trail does not know: of other computers, or written while it was not kept."""

    @property
    def head(self) -> str:
        """Hash of the last line; empty without lines."""
        return self.entries[-1].hash if self.entries else ""


def begin_audit(folder: Path, progress: Progress = NO_PROGRESS) -> AuditEntry:
    """Begin the audit trail of a folder with the hashes of all files that are there.

    Raises:
        AuditError: there is one already, or it cannot be written.
    """
    if (folder / LOG_NAME).exists():
        raise AuditError(f"{folder} has an audit trail already; 'tactor-bench audit verify {folder}' verifies it")
    hashes = _present_files(folder, progress)
    return append_entry(
        folder, "start", folder.name or ".", current_conditions().operator, hashes, {"files": len(hashes)}
    )


def verify_audit(folder: Path, head: str = "", progress: Progress = NO_PROGRESS) -> AuditResult:
    """Verify the chain of lines, the presence of a head hash stored elsewhere, and all files that it names.

    Args:
        folder: of the audit trail.
        head: hash of a line, or its begin, as printed or copied; empty without one.
        progress: reports files.

    Raises:
        AuditError: there is no audit trail, it cannot be read, or the head hash is too short.
    """
    entries, problems = read_entries(folder)
    head = head.strip().casefold()
    if head:
        if len(head) < MIN_HEAD_LENGTH or set(head) - set("0123456789abcdef"):
            raise AuditError(f"'{head}' is no hash; give at least its first {MIN_HEAD_LENGTH} digits")
        if not any(entry.hash.startswith(head) for entry in entries):
            problems.append(f"no line has the hash {head[:MIN_HEAD_LENGTH]}...: lines up to it were changed or removed")
    recorded: dict[str, str] = {}
    for entry in entries:
        recorded |= entry.files
    present = _present_files(folder, progress, recorded)
    last = {name: entry for entry in entries for name in entry.files}
    for name, expected in sorted(recorded.items()):
        if problem := _compare(expected, present.get(name, "")):
            entry = last[name]
            problems.append(f"{name} {problem} since entry {entry.number} ({entry.time[:16]}, {entry.action})")
    unrecorded = tuple(name for name in sorted(present.keys() - recorded.keys()) if present[name])
    return AuditResult(tuple(entries), tuple(problems), unrecorded)


def _compare(expected: str, actual: str) -> str:
    """Return how a file differs from its record; empty if it does not."""
    if expected == actual:
        return ""
    if not actual:
        return "is missing"
    if not expected:
        return "is there again, although it was removed"
    return "has another kind of hash, of an earlier version," if expected.startswith("run:") else "was changed"


def _present_files(folder: Path, progress: Progress, named: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the hashes of audited files below a folder, hidden folders aside, and of those that are named."""
    names = {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.name.endswith(AUDITED_SUFFIXES)
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    } | set(named or ())
    hashes = {}
    for done, name in enumerate(sorted(names), 1):
        progress.raise_if_cancelled()
        hashes[name] = audited_hash(folder / name)
        progress.update(done / len(names), f"hashing {done} of {len(names)}")
    return hashes
