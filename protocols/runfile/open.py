"""Opening a run file for reading in any state: finished, growing, crashed or damaged."""

import ctypes
import inspect
import io
import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from protocols.base import RunStatus, visible_text
from protocols.runfile.errors import (
    READ_FAILURES,
    NewerFormatError,
    NotARunError,
    RunReadError,
    UnfinishedStorageError,
)
from protocols.runfile.fields import attribute_integer, attribute_text, read_text
from protocols.runfile.foreign_file_check import StructureError, check_structure, find_endless_heap, stated_size
from protocols.runfile.presence import FLAGS_PLACE, WRITE_FLAGS, WRITING_VERSION
from protocols.runfile.schema import FORMAT, FORMAT_VERSION, is_hdf5
from protocols.runfile.transaction import has_journal

if TYPE_CHECKING:
    import h5py

T = TypeVar("T")

SETTLED_NS = 2_000_000_000
"""Age of the last change from which on a further change has another time on every file system."""
MAX_CHECKED_FILES = 100_000

CHECKED_FILES: dict[tuple[int, int], tuple[int, int, int]] = {}
"""Size and times of change of the files that were found in order, by device and number of the file."""

READ_ATTEMPTS = 24
"""Number of read attempts for a piece of a growing file; together they take some ten milliseconds."""


@contextmanager
def translate_read_errors(path: Path) -> Iterator[None]:
    """Raise RunReadError for all errors of reading a damaged file."""
    try:
        yield
    except StructureError as error:
        raise RunReadError(f"{path} is not read: {error}, which no run file has; take another copy of it") from error
    except READ_FAILURES as error:
        raise RunReadError(f"{path} is damaged inside ({_first_line(error)}); take another copy of it") from error


def reads_run(kind: type[T]) -> type[T]:
    """Make every public property and method of a class with a `path` raise RunReadError for a damaged file."""
    for name, member in list(vars(kind).items()):
        if name.startswith("_") or name == "close":
            continue
        if isinstance(member, property) and member.fget is not None:
            setattr(kind, name, property(_translated(member.fget), doc=member.__doc__))
        elif isinstance(member, cached_property):
            member.func = _translated(member.func)
        elif inspect.isfunction(member):
            setattr(kind, name, _translated(member))
    return kind


def _translated(method: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(method)
    def read(self: Any, *arguments: Any, **named: Any) -> Any:
        with translate_read_errors(self.path):
            return method(self, *arguments, **named)

    @wraps(method)
    def iterate(self: Any, *arguments: Any, **named: Any) -> Iterator[Any]:
        with translate_read_errors(self.path):
            yield from method(self, *arguments, **named)

    return iterate if inspect.isgeneratorfunction(method) else read


def open_run(path: Path) -> "h5py.File":
    """Open the file read-only: finished, growing, or crashed.

    All reading begins here: links, storage and sizes of the whole file are checked first.

    Raises:
        RunReadError: it is missing, no HDF5 file, cut off, damaged, or unlike any file of this program.
    """
    try:
        return _open(path)
    except (NotARunError, NewerFormatError):
        raise
    except RunReadError as error:
        if has_journal(path):
            raise UnfinishedStorageError(path) from error
        raise


def _stamp(path: Path) -> tuple[tuple[int, int], tuple[int, int, int]] | None:
    """Return what tells a file from every other state of it; None for a file that changed a moment ago, or is not there."""
    try:
        stat = path.stat()
    except (OSError, ValueError):
        return None
    changed_ns = max(stat.st_mtime_ns, stat.st_ctime_ns)
    if not stat.st_ino or not time.time_ns() - changed_ns > SETTLED_NS:
        return None
    return (stat.st_dev, stat.st_ino), (stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)


def _open(path: Path) -> "h5py.File":
    stamp = _stamp(path)
    if stamp is not None and CHECKED_FILES.get(stamp[0]) == stamp[1]:
        with suppress(OSError, ValueError):
            return _open_alone(path)
    file = _open_unknown(path)
    if stamp is not None and stamp == _stamp(path):
        if len(CHECKED_FILES) >= MAX_CHECKED_FILES:
            CHECKED_FILES.clear()
        CHECKED_FILES[stamp[0]] = stamp[1]
    return file


def _open_unknown(path: Path) -> "h5py.File":
    _check_readable(path)
    import h5py  # slow to import; the window is painted first

    # A finished run opens directly, and a cut-off file is reported. A growing or crashed run opens for a SWMR reader only. No
    # locks: a reader must never keep the writer from closing its file in order.
    try:
        return _checked(path, _open_alone(path))
    except (OSError, ValueError) as error:
        failure: Exception = error
    cut_off = re.search(r"truncated file: eof = (\d+).*stored_eof = (\d+)", str(failure))
    try:
        file = h5py.File(
            h5py.h5f.open(os.fsencode(path), h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ, _bounded_retry_access())
        )
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        if "locking flag" in str(error):  # this process writes it, with locks; HDF5 requires equal settings for all
            with suppress(OSError, ValueError):
                return _checked(path, h5py.File(path, "r", libver="latest"))
        failure = failure if cut_off else error
    else:
        try:
            with translate_read_errors(path):
                # A full disk also leaves a short file, but never with the status of a regular end.
                if not cut_off or _has_irregular_end(path, file):
                    return _checked(path, file)
        except RunReadError as error:
            if not cut_off or isinstance(error.__cause__, StructureError):
                raise
        file.close()  # otherwise HDF5 returns the same damaged file at the next opening
    if cut_off:
        present, expected = cut_off.groups()
        raise _cut_off_error(path, present, expected)
    raise RunReadError(f"{path} is damaged and cannot be opened ({_first_line(failure)}); take another copy of it")


class _ReadFile(io.FileIO):
    """A file that closes with its last reference, which HDF5 holds."""

    def __del__(self) -> None:
        self.close()


def _open_alone(path: Path) -> "h5py.File":
    """Open a file that shares nothing with other openings of its path in this process.

    Of a path that it opens itself, HDF5 shares everything between its openings: the type of a text then refers to the file that was
    opened first, even after it was closed, and crashes (h5py issue 2920); and a file that has changed is read as it was before.
    """
    import h5py  # slow to import; the window is painted first

    file = _ReadFile(path)
    try:
        head = file.read(FLAGS_PLACE + 1)
        if head[8:9] == bytes([WRITING_VERSION]) and head[-1] & WRITE_FLAGS:  # which HDF5 ignores in a file of Python
            raise OSError("it is marked as open for writing")
        return h5py.File(file, "r", libver="latest")
    except BaseException:
        file.close()  # the error refers to it
        raise


def _cut_off_error(path: Path, present: object, expected: object) -> RunReadError:
    return RunReadError(
        f"{path} is cut off, as a half-copied file is: {present} of {expected} bytes are there; copy it again"
    )


def _has_irregular_end(path: Path, file: "h5py.File") -> bool:
    _check_file(path, file)
    return read_text(file["entry"], "status") in (RunStatus.RUNNING, RunStatus.FAILED)


def _check_file(path: Path, file: "h5py.File") -> None:
    """Raise RunReadError for a file that is no run, or lacks the structure of a run."""
    kind, version = "", 0
    with translate_read_errors(path):
        if "format" in file.attrs:
            with suppress(ValueError):  # a file of another program
                kind = attribute_text(file, "format")
        if kind == FORMAT:
            version = attribute_integer(file, "format_version") if "format_version" in file.attrs else 0
    if kind != FORMAT:
        raise NotARunError(f"{path} is an HDF5 file, but not a run of this program")
    if version > FORMAT_VERSION:
        raise NewerFormatError(
            f"{path} has run format {version}; this program reads up to {FORMAT_VERSION}: install a newer version"
        )
    with translate_read_errors(path):
        check_structure(file, path)


def _checked(path: Path, file: "h5py.File") -> "h5py.File":
    """Return the file if it is a readable run; close it otherwise."""
    try:
        _check_file(path, file)
    except RunReadError:
        file.close()
        raise
    return file


def _check_readable(path: Path) -> None:
    """Reject a file by checks without HDF5."""
    if not os.path.exists(path):  # noqa: PTH110 - Path.exists raises for a name that is too long
        raise RunReadError(f"there is no file {path}")
    if not path.is_file():
        raise RunReadError(f"{path} is {'a folder' if path.is_dir() else 'no file'}; give a run file")
    try:
        path.open("rb").close()
    except OSError as error:
        raise RunReadError(f"{path} cannot be read: {error.strerror or error}") from error
    if not is_hdf5(path):
        raise RunReadError(f"{path} is {'no HDF5 file' if path.stat().st_size else 'empty'}; give a run file")
    with translate_read_errors(path):
        if (at := find_endless_heap(path)) is not None:
            present, expected = path.stat().st_size, stated_size(path)
            if present < expected:
                raise _cut_off_error(path, present, expected)
            raise StructureError(f"the list of its texts at byte {at} has no end")


def _bounded_retry_access() -> "h5py.h5p.PropFAID":
    """Return access properties that retry inconsistent metadata of a growing file a few times only.

    HDF5's default of a hundred attempts, each twice as long as the previous, never ends on a cut-off file.
    """
    import h5py

    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_libver_bounds(h5py.h5f.LIBVER_LATEST, h5py.h5f.LIBVER_LATEST)
    access.set_file_locking(False, True)
    access.set_fclose_degree(h5py.h5f.CLOSE_STRONG)
    for library in (h5py.h5.__file__, "hdf5"):  # symbols of a dependency resolve through it; by name on Windows
        try:
            limit = ctypes.CDLL(library).H5Pset_metadata_read_attempts
        except (OSError, AttributeError):
            continue
        limit.argtypes, limit.restype = (ctypes.c_int64, ctypes.c_uint), ctypes.c_int
        limit(access.id, READ_ATTEMPTS)
        break
    return access


def _first_line(error: BaseException) -> str:
    return visible_text((str(error) or type(error).__name__).splitlines()[0])
