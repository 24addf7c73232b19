"""Errors of run files: errors of HDF5 while reading or writing a run or study file, as one message."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

READ_FAILURES = (
    OSError,
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    RuntimeError,
    TypeError,
    ValueError,
)
"""Errors of reading a damaged or hostile file."""


class RunReadError(Exception):
    """A file cannot be read as a run; the message contains the path and the reason."""


class NotARunError(RunReadError):
    """An HDF5 file of another kind."""


class NewerFormatError(RunReadError):
    """A run from a newer version of this program."""


class UnfinishedStorageError(RunReadError):
    """The program was killed while it stored results; a journal has them."""

    def __init__(self, path: Path) -> None:
        super().__init__(
            f"{path}: results are being stored in it, or its program was killed meanwhile; 'tactor-bench verify --repair' completes it"
        )


WRITE_FAILURES = (OSError, RuntimeError, ValueError, KeyError)
"""Errors of HDF5 while it writes; it raises KeyError for a dataset that it cannot read."""


class StorageError(Exception):
    """The file cannot be written. The message contains the path and the reason; earlier data stay readable."""


class FileLostError(StorageError):
    """The run file was deleted, cut, moved or detached by another program."""


@contextmanager
def translate_write_errors(
    kind: str, path: Path, advice: str = "everything before this moment is in it"
) -> Iterator[None]:
    """Raise StorageError for errors of HDF5 while it writes the run or study file."""
    try:
        yield
    except WRITE_FAILURES as error:
        raise StorageError(f"the {kind} file {path} cannot be written: {os_error_text(error)}; {advice}") from error


def os_error_text(error: BaseException) -> str:
    """Return the system's message for an error number, or the error's own text."""
    number = getattr(error, "errno", None)
    if number:
        return os.strerror(number)
    text = str(error)
    hidden = re.search(r"errno = (\d+)", text)  # HDF5 writes the number into its message
    return os.strerror(int(hidden[1])) if hidden else text


class NotesError(Exception):
    """A file beside the runs, of notes or mountings, cannot be read or written; the message gives file, reason and remedy."""
