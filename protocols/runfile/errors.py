"""Writing a file that must not be lost: what HDF5 raises, as one sentence."""

import os
import re
from dataclasses import dataclass
from pathlib import Path


class StorageError(Exception):
    """The run file cannot be written. The sentence says where and why; what was written before stays readable."""


@dataclass(frozen=True, slots=True)
class WriteErrorTranslation:
    """Turns what HDF5 raises into one sentence."""

    path: Path

    def __enter__(self) -> None: ...

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, (OSError, RuntimeError, ValueError, KeyError)):
            raise StorageError(
                f"the run file {self.path} cannot be written: {os_error_text(error)}; everything before this moment is in it"
            ) from error


def os_error_text(error: BaseException) -> str:
    """The system's words for it where it has a number, else its own."""
    number = getattr(error, "errno", None)
    if number:
        return os.strerror(number)
    text = str(error)
    hidden = re.search(r"errno = (\d+)", text)  # HDF5 has the number in its own words
    return os.strerror(int(hidden[1])) if hidden else text
