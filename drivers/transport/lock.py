"""Instrument locks: one controlling program per instrument, across all users and programs of a computer.

A lock is a file in a folder of the computer, locked by the operating system: it is free after any end of its program. Each
instrument has two locks, one by address and one by serial number, because it may have several addresses. The watchdog holds a
second file of each, so that an instrument stays locked until program and watchdog have ended.
"""

import contextlib
import errno
import getpass
import hashlib
import json
import os
import re
import stat
import sys
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

import psutil
from filelock import FileLock, Timeout

from drivers.deadlines import Deadline
from drivers.errors import MANUAL_SHUTDOWN_INSTRUCTIONS, InstrumentError, UnsafeError
from drivers.interfaces import Closeable, Identity
from drivers.regular_files import open_regular

RELEASED = "{}"
"""Record of an instrument released by its last program."""

LOOPBACK = re.compile(r"(?<![\w.-])(localhost|127(\.\d+){3}|\[::1\])(?![\w.-])", re.IGNORECASE)


def lock_folder() -> Path:
    """Return the folder of the locks, the same for all users of this computer."""
    if os.name == "nt":
        return Path(os.environ.get("PUBLIC", r"C:\Users\Public")) / "Documents" / "tactor-bench locks"
    run = Path("/run/lock")
    for_all = run.is_dir() and stat.S_IMODE(run.stat().st_mode) & 0o1777 == 0o1777
    return (run if for_all else Path("/tmp")) / "tactor-bench"  # noqa: S108 - opened without following links


def address_key(address: str) -> str:
    """Return the key of an address: a VISA resource, a serial port, or `server/device` of a card."""
    return re.sub(r"^(TCPIP|USB|ASRL|GPIB)0?::", r"\1::", LOOPBACK.sub("localhost", address).upper())


def identity_key(identity: Identity, address: str) -> str:
    """Return the key of an identity; empty if it has no serial number.

    It is also empty at a loopback address, of a simulated instrument, whose serial number is not unique.
    """
    if not identity.serial or LOOPBACK.search(address):
        return ""
    return f"{identity.maker} {identity.model} {identity.serial}".upper()


class InstrumentLocks(Closeable):
    """The locks of one program on the instruments of one bench, held until closed.

    Args:
        bench: the name of the bench, for the message that another program shows.
        simulated: whether it is a simulated bench of this program, with its own ports; then nothing is locked.
    """

    def __init__(self, bench: str, simulated: bool = False) -> None:
        self._bench, self._simulated = bench, simulated
        self._locks: dict[str, FileLock] = {}
        self.left_by = ""
        """The program that ended without releasing an instrument; empty if all were released."""
        self._left_records: dict[str, str] = {}
        """Records of this program, by lock."""

    def lock_address(self, instrument: str, address: str) -> None:
        """Lock an instrument by its address, before it is opened.

        Raises:
            InstrumentError: another program controls it; the message names that program.
            UnsafeError: the other program is stopped, or has ended without its watchdog: the specimen may be live.
        """
        self._lock(address_key(address), f"{instrument} at {address}")

    def lock_identity(self, instrument: str, identity: Identity, address: str) -> None:
        """Lock an instrument by its reported serial number.

        Raises:
            InstrumentError: another program controls it at another address; the message names that program.
        """
        if key := identity_key(identity, address):
            self._lock(key, f"{instrument} {identity}")

    @property
    def files(self) -> tuple[str, ...]:
        """Paths of the lock files, for the watchdog."""
        return tuple(self._locks)

    def forget_earlier_program(self) -> None:
        """Take over the instruments: all of them reply, and the next run measures the state left by an earlier program."""
        self.left_by = ""
        self._left_records.clear()

    def close(self) -> None:
        """Release all locks; an earlier program stays on record until a program has taken over the instruments."""
        for path, lock in self._locks.items():
            if path in self._left_records:
                _write_record(Path(path), self._left_records[path])
            else:
                _remove_files(Path(path))
            lock.release()
        self._locks.clear()

    def _lock(self, key: str, instrument: str) -> None:
        path = _lock_file(key)
        if self._simulated or str(path) in self._locks:
            return
        with _translate_errors(path):
            lock = _make_lock(path)
            try:
                lock.acquire(timeout=0)
            except Timeout:
                if _is_holder_stopped(path):
                    raise UnsafeError(
                        f"{MANUAL_SHUTDOWN_INSTRUCTIONS}. {instrument} is in use by a program that is stopped and may have left a drive on "
                        f"the specimen: {_holder(path)}. Then continue or end that program"
                    ) from None
                raise InstrumentError(f"{instrument} is in use: {_holder(path)}; end that program first") from None
            try:
                with _make_lock(_watchdog_file(path)).acquire(timeout=Deadline.INSTRUMENT_LOCK.seconds):
                    pass
            except Timeout:
                lock.release()
                raise UnsafeError(
                    f"{MANUAL_SHUTDOWN_INSTRUCTIONS}. {instrument} is in use: the watchdog of an ended program has not brought it to "
                    f"rest within {Deadline.INSTRUMENT_LOCK.seconds:g} s ({_holder(path)}). Then read watchdog.log beside its runs, and try again "
                    "when it is done"
                ) from None
            self._locks[str(path)] = lock
            with contextlib.suppress(OSError):
                record = _read_record(path)
                if record != RELEASED:
                    self._left_records[str(path)] = record
                    self.left_by = self.left_by or _holder(path)
            _write_holder(path, self._bench)


def lock_as_watchdog(files: Sequence[str]) -> list[FileLock]:
    """Acquire the watchdog's locks, which are held until the watchdog ends.

    Raises:
        InstrumentError: another watchdog has one.
    """
    locks = []
    for name in files:
        path = _watchdog_file(Path(name))
        with _translate_errors(path):
            try:
                lock = _make_lock(path)
                lock.acquire(timeout=Deadline.INSTRUMENT_LOCK.seconds)
            except Timeout:
                raise InstrumentError(f"another watchdog holds {path}; end it first") from None
            locks.append(lock)
    return locks


def _lock_file(key: str) -> Path:
    name = re.sub(r"[^A-Z0-9.-]+", "_", key.upper())[:80]
    return lock_folder() / f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:8]}.lock"


def _watchdog_file(path: Path) -> Path:
    return path.with_suffix(".watchdog")


def _make_lock(path: Path) -> FileLock:
    """Return the lock of a file that every user may open, never an existence check, which outlives a crash."""
    if not path.parent.is_dir():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.parent.chmod(0o1777)
    return FileLock(path, mode=0o666, thread_local=False, preserve_lock_file=True, poll_interval=0.02)


def _remove_files(path: Path) -> None:
    """Remove the files of a lock that is held: `filelock` does not take one that was removed meanwhile for its own."""
    _write_record(path, RELEASED)  # where they cannot be removed
    with contextlib.suppress(OSError, Timeout), _make_lock(_watchdog_file(path)).acquire(timeout=0):
        for each in (path.with_suffix(".json"), _watchdog_file(path), path):
            each.unlink()


def _write_holder(path: Path, bench: str) -> None:
    holder = {
        "pid": os.getpid(),
        "user": "an unknown user",
        "program": Path(sys.argv[0]).name or "python",
        "bench": bench,
        "since": datetime.now().astimezone().isoformat(" ", "minutes"),
    }
    with contextlib.suppress(OSError, KeyError, ImportError):
        holder["user"] = getpass.getuser()
    _write_record(path, json.dumps(holder))


def _write_record(path: Path, record: str) -> None:
    """Write the holder of a lock into the file beside it."""
    file = path.with_suffix(".json")
    # Without O_CREAT for an existing file: Linux rejects that in a shared folder for a file of another user, who may also have put a
    # pipe there, which nobody reads.
    flags = os.O_WRONLY | os.O_TRUNC | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    flags |= 0 if file.exists() else os.O_CREAT
    with contextlib.suppress(OSError), os.fdopen(os.open(file, flags, 0o666), "w", encoding="utf-8") as out:
        out.write(record)
        with contextlib.suppress(PermissionError):
            file.chmod(0o666)


def _read_record(path: Path) -> str:
    """Return the record of a lock. Raises OSError if it cannot be read."""
    with open_regular(path.with_suffix(".json"), "r", encoding="utf-8") as file:
        return str(file.read())


def _holder(path: Path) -> str:
    """Return the holder of the lock according to its record."""
    try:
        holder = json.loads(_read_record(path))
        return (
            f"{_printable(holder['program'])} (process {int(holder['pid'])}, user {_printable(holder['user'])}) has controlled "
            f"it with the bench '{_printable(holder['bench'])}' since {_printable(holder['since'])}"
        )
    except (OSError, ValueError, KeyError, TypeError):
        return f"another program controls it (lock {path})"


def _is_holder_stopped(path: Path) -> bool:
    """Return whether the program that holds the lock is stopped, as far as this user may see."""
    try:
        pid = int(json.loads(_read_record(path))["pid"])
        return psutil.Process(pid).status() in (psutil.STATUS_STOPPED, psutil.STATUS_TRACING_STOP)
    except (OSError, ValueError, KeyError, TypeError, psutil.Error):
        return False


def _printable(text: object) -> str:
    return "".join(c for c in str(text)[:80] if c.isprintable())


@contextlib.contextmanager
def _translate_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        remedy = "make its folder writable for all users of this computer"
        if error.errno == errno.ELOOP:
            remedy = "it is a symbolic link, which is not followed; remove it"
        raise InstrumentError(f"the lock {path} cannot be taken: {error.strerror or error}; {remedy}") from error
