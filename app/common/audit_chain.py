"""Audit trail of a folder: an append-only file of JSON lines, each with the hash of the line before it.

A change of a line, or of a hash in it, changes the hashes of all lines after it. Who keeps one hash elsewhere, such as on a printed report,
can detect any later change of the lines up to it (hash chain: Haber and Stornetta, Journal of Cryptology 3 (1991) 99).
"""

import getpass
import hashlib
import json
import logging
import os
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivers import Deadline, open_regular
from protocols.base import file_hash, parse_json_object

LOG_NAME = "audit.jsonl"
LOCK_NAME = ".audit.lock"
FIRST = "0" * 64
"""In place of the hash of a line before the first."""
MIN_HEAD_LENGTH = 12
"""Smallest number of digits of a head hash."""
MAX_LEVELS = 8
"""Folders above a file in which its audit trail is looked for."""

log = logging.getLogger(__name__)


class AuditError(Exception):
    """The audit trail cannot be read or written; the message gives file and reason."""


@dataclass(frozen=True, slots=True)
class AuditEntry:
    """One line.

    Attributes:
        number: from 1 on.
        by: operator, login and computer.
        action: kind of action, e.g. `run`, `accept`, `delete`.
        subject: specimen, file or item.
        files: SHA-256 of each file afterwards, by its path from the folder; empty for a deleted file.
        details: further values.
        previous: hash of the line before.
        hash: of this line.
    """

    number: int
    time: str
    by: str
    action: str
    subject: str
    files: Mapping[str, str]
    details: Mapping[str, Any]
    previous: str
    hash: str


def audited_folder(path: Path) -> Path | None:
    """Return the folder whose audit trail covers a file, its own or a parent, or None."""
    absolute = path.absolute()
    return next((folder for folder in list(absolute.parents)[:MAX_LEVELS] if (folder / LOG_NAME).is_file()), None)


def record_audit(action: str, *paths: Path, subject: str = "", **details: Any) -> None:
    """Append an entry on changed files to the audit trail that covers them, if any. Errors are logged, not raised.

    Args:
        action: kind of action.
        paths: written or removed files.
        subject: specimen or item; default is the name of the first file.
        details: plain values.
    """
    try:
        if not paths or (folder := audited_folder(paths[0])) is None:
            return
        from app.common.people import current_conditions  # slow to load, and most folders have no audit trail

        hashes = {path.absolute().relative_to(folder).as_posix(): audited_hash(path) for path in paths}
        append_entry(folder, action, subject or paths[0].name, current_conditions().operator, hashes, details)
    except (AuditError, OSError, ValueError) as error:
        log.warning("%s of %s is missing in the audit trail: %s", action, paths[0], error)


def audited_hash(path: Path) -> str:
    """Return the SHA-256 of a file, or why it cannot be read."""
    try:
        return file_hash(path)
    except OSError as error:
        return f"unreadable: {error.strerror or error}"


def append_entry(
    folder: Path, action: str, subject: str, by: str, files: Mapping[str, str], details: Mapping[str, Any]
) -> AuditEntry:
    """Append a line; other programs wait meanwhile.

    Raises:
        AuditError: the file cannot be read or written, or its last line is damaged.
    """
    from filelock import FileLock, Timeout

    path = folder / LOG_NAME
    try:
        with FileLock(folder / LOCK_NAME, Deadline.NOTES_LOCK.seconds):
            last, torn, unended = _last_line(path)
            number, previous = (0, FIRST) if last is None else (last.number, last.hash)
            if torn:  # a line cut by a power failure stays in the file, and its hash in the chain
                details = {**details, "torn_line": hashlib.sha256(torn).hexdigest()}
            record: dict[str, Any] = {
                "number": number + 1,
                "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
                "by": _who(by),
                "action": action,
                "subject": subject,
                "files": dict(files),
                "details": dict(details),
                "previous": previous,
            }
            entry = AuditEntry(**record, hash=_hash(record))
            line = json.dumps({**record, "hash": entry.hash}, ensure_ascii=False, allow_nan=False, default=str)
            with open_regular(path, "ab") as file:
                file.write((b"\n" if unended else b"") + line.encode("utf-8", "backslashreplace") + b"\n")
                file.flush()
                os.fsync(file.fileno())
    except Timeout:
        raise AuditError(
            f"{path} is locked by another program for more than {Deadline.NOTES_LOCK.seconds:g} s"
        ) from None
    except OSError as error:
        raise AuditError(f"{path} cannot be written: {error.strerror or error}") from None
    return entry


def read_entries(folder: Path) -> tuple[list[AuditEntry], list[str]]:
    """Return the lines of an audit trail, and the faults of the chain as sentences.

    Raises:
        AuditError: there is none, or it cannot be read.
    """
    path = folder / LOG_NAME
    try:
        with open_regular(path) as file:
            lines = file.read().split(b"\n")
    except FileNotFoundError:
        raise AuditError(f"{folder} has no audit trail; 'tactor-bench audit start {folder}' begins one") from None
    except OSError as error:
        raise AuditError(f"{path} cannot be read: {error.strerror or error}") from None
    return _check_chain(lines)


def _check_chain(lines: Sequence[bytes]) -> tuple[list[AuditEntry], list[str]]:
    entries, problems, torn = list[AuditEntry](), list[str](), b""
    for at, line in enumerate(lines, 1):
        if not line:
            continue
        entry = _parse(line)
        if entry is None:
            problems += [f"line {at} is damaged"] if torn else []
            torn = line
            continue
        last = entries[-1] if entries else None
        if torn and entry.details.get("torn_line") != hashlib.sha256(torn).hexdigest():
            problems.append(f"the line before entry {entry.number} is damaged")
        if entry.hash != _hash(_without_hash(line)):
            problems.append(f"entry {entry.number} ({entry.time}, {entry.action} of {entry.subject}) was changed")
        elif entry.previous != (last.hash if last else FIRST) or entry.number != (last.number if last else 0) + 1:
            problems.append(
                f"entry {entry.number} ({entry.time}) does not follow the one before it: lines are missing or were put in"
            )
        torn = b""
        entries.append(entry)
    if torn:
        problems.append("the last line is not complete: the program was killed, or the file was cut")
    return entries, problems


def _who(by: str) -> str:
    try:
        login = getpass.getuser()
    except (OSError, KeyError, ImportError):
        login = "unknown login"
    place = f"{login} at {socket.gethostname()}"
    return f"{by} ({place})" if by and by != login else place


def _hash(record: Mapping[str, Any]) -> str:
    text = json.dumps(record, sort_keys=True, ensure_ascii=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _without_hash(line: bytes) -> dict[str, Any]:
    record = parse_json_object(line.decode("utf-8", "surrogateescape"))
    record.pop("hash", None)
    return record


def _parse(line: bytes) -> AuditEntry | None:
    """Return the entry in a line; None for anything else."""
    try:
        record = parse_json_object(line.decode())
        entry = AuditEntry(**record)
        texts = (entry.time, entry.by, entry.action, entry.subject, entry.previous, entry.hash)
        if not (
            all(isinstance(text, str) for text in texts)
            and isinstance(entry.number, int)
            and isinstance(entry.files, dict)
            and isinstance(entry.details, dict)
            and all(isinstance(value, str) for value in entry.files.values())
        ):
            return None
    except (ValueError, TypeError):
        return None
    return entry


def _last_line(path: Path) -> tuple[AuditEntry | None, bytes, bool]:
    """Return the last entry, the bytes behind it that are no entry, and whether the file lacks an end of line.

    Raises:
        AuditError: the last complete line is damaged.
    """
    try:
        with open_regular(path) as file:
            lines = file.read().split(b"\n")
    except FileNotFoundError:
        return None, b"", False
    torn = lines.pop()
    if torn and (entry := _parse(torn)) is not None:  # only its end of line is missing
        return entry, b"", True
    last = next((line for line in reversed(lines) if line), b"")
    if last and (entry := _parse(last)) is None:
        raise AuditError(f"the last line of {path} is damaged; 'tactor-bench audit verify' says more")
    return _parse(last) if last else None, torn, bool(torn)
