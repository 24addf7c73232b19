"""Opening of regular files only: reading a pipe or a device in the place of a file might not end."""

import errno
import os
import stat
from pathlib import Path
from typing import Any


def open_regular(path: Path, mode: str = "rb", **text: Any) -> Any:
    """Open a file that a user named, or that anybody may have put in its folder, as `open` does.

    Raises:
        OSError: it cannot be opened, or is not a regular file.
    """
    return open(path, mode, opener=_open_regular, **text)


def _open_regular(path: str, flags: int) -> int:
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0), 0o666)
    kind = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(kind):
        os.close(descriptor)
        if stat.S_ISDIR(kind):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), path)
        raise OSError(errno.EINVAL, "it is a pipe or a device, not a file", path)
    return descriptor
