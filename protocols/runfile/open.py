"""Opening a run file for reading in any state: finished, growing, crashed or damaged."""

import ctypes
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from protocols.base import RunStatus
from protocols.runfile.schema import is_hdf5

if TYPE_CHECKING:
    import h5py

READ_ATTEMPTS = 24
"""For a piece of a growing file; together they take some ten milliseconds."""


class RunReadError(Exception):
    """A file cannot be read as a run; the message contains the path and the reason."""


class NotARunError(RunReadError):
    """An HDF5 file of another kind."""


class NewerFormatError(RunReadError):
    """A run from a newer version of this program."""


@contextmanager
def translate_read_errors(path: Path) -> Iterator[None]:
    """Raise RunReadError for anything that reading a damaged file raises."""
    try:
        yield
    except (
        OSError,
        ArithmeticError,
        AttributeError,
        LookupError,
        MemoryError,
        RuntimeError,
        TypeError,
        ValueError,
    ) as error:
        raise RunReadError(f"{path} is damaged inside ({_first_line(error)}); take another copy of it") from error


def open_run(path: Path) -> "h5py.File":
    """Open the file read-only, whether finished, being written, or left behind by a crash.

    Raises:
        RunReadError: it is missing, not an HDF5 file, cut off, or damaged.
    """
    _check_readable(path)
    import h5py  # slow to import, and the window is painted first

    # A finished run opens directly, and a cut-off file is reported. A run that is being written, or was left by a
    # crash, opens for a SWMR reader only. No locks: a reader must never keep the writer from closing its file in order.
    try:
        return h5py.File(path, "r", libver="latest", locking=False)
    except (OSError, ValueError) as error:
        failure: Exception = error
    if "locking flag" in str(failure):  # a caller of this process has it open with locks; HDF5 wants the same once more
        with suppress(OSError, ValueError):
            return h5py.File(path, "r", libver="latest")
    cut_off = re.search(r"truncated file: eof = (\d+).*stored_eof = (\d+)", str(failure))
    file = None
    try:
        file = h5py.File(
            h5py.h5f.open(os.fsencode(path), h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ, _bounded_retry_access())
        )
        # A full disk leaves a short file too, but never one whose status is that of a regular end.
        if not cut_off or file["entry/status"][()].decode() in (RunStatus.RUNNING, RunStatus.FAILED):
            return file
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        failure = failure if cut_off else error
    if file is not None:
        file.close()  # else HDF5 returns the same damaged file at the next opening
    if cut_off:
        present, expected = cut_off.groups()
        raise RunReadError(
            f"{path} is cut off, as a half-copied file is: {present} of {expected} bytes are there; copy it again"
        )
    raise RunReadError(f"{path} is damaged and cannot be opened ({_first_line(failure)}); take another copy of it")


def _check_readable(path: Path) -> None:
    """Reject what can be checked without HDF5."""
    if not os.path.exists(path):  # noqa: PTH110 - Path.exists raises where a name is too long
        raise RunReadError(f"there is no file {path}")
    if not path.is_file():
        raise RunReadError(f"{path} is {'a folder' if path.is_dir() else 'no file'}; give a run file")
    try:
        path.open("rb").close()
    except OSError as error:
        raise RunReadError(f"{path} cannot be read: {error.strerror or error}") from error
    if not is_hdf5(path):
        raise RunReadError(f"{path} is {'no HDF5 file' if path.stat().st_size else 'empty'}; give a run file")


def _bounded_retry_access() -> "h5py.h5p.PropFAID":
    """Return access properties that retry inconsistent metadata of a growing file a few times only.

    HDF5's default of a hundred attempts, each twice as long as the previous, never ends on a cut-off file.
    """
    import h5py

    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_libver_bounds(h5py.h5f.LIBVER_LATEST, h5py.h5f.LIBVER_LATEST)
    access.set_file_locking(False, True)
    access.set_fclose_degree(h5py.h5f.CLOSE_STRONG)
    for library in (h5py.h5.__file__, "hdf5"):  # the symbols of a dependency are found through it; by name on Windows
        try:
            limit = ctypes.CDLL(library).H5Pset_metadata_read_attempts
        except (OSError, AttributeError):
            continue
        limit.argtypes, limit.restype = (ctypes.c_int64, ctypes.c_uint), ctypes.c_int
        limit(access.id, READ_ATTEMPTS)
        break
    return access


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
