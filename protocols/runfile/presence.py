"""Presence check of the run file being written: deleted, cut, moved or detached by another program."""

import contextlib
import os
import stat
from pathlib import Path

from protocols.runfile.errors import FileLostError


class FilePresence:
    """Compares the path of an open file with the file itself.

    Args:
        path: where the file was created.
        descriptor: of the open file; duplicated, so that a deleted file can still be read.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._descriptor = os.dup(descriptor) if os.name == "posix" else None
        found = path.stat()
        self._identity, self._size = (found.st_dev, found.st_ino), found.st_size
        self.problem = ""
        """What happened to the file; empty while it is where it was created."""
        self.moved_to: Path | None = None
        self.is_cut = False
        """Whether samples are lost, because the file was truncated."""

    def check(self) -> None:
        """Compare path and file.

        Raises:
            FileLostError: the path leads to no file, to another one, or to fewer bytes than were written.
        """
        if self.problem:
            raise FileLostError(f"the run file {self._path} {self.problem}")
        found: os.stat_result | None = None
        with contextlib.suppress(OSError):
            found = self._path.stat()
        if found is None or (found.st_dev, found.st_ino) != self._identity:
            self.problem = self._what_happened(replaced=found is not None)
        elif found.st_size < self._size:
            self.is_cut = True
            self.problem = f"was cut from {self._size} to {found.st_size} bytes while it was being written; the samples in it are lost"
        else:
            self._size = found.st_size
            return
        raise FileLostError(f"the run file {self._path} {self.problem}")

    def note_size(self) -> None:
        """Take the present size as the least size of the file from now on."""
        with contextlib.suppress(OSError):
            found = os.fstat(self._descriptor) if self._descriptor is not None else self._path.stat()
            self._size = max(self._size, found.st_size)

    def restore(self, path: Path) -> None:
        """Copy the deleted or detached file to `path`, which does not exist.

        Raises:
            OSError: it cannot be copied.
        """
        if self._descriptor is None:
            raise OSError("the system gives no access to a deleted file")
        path.parent.mkdir(parents=True, exist_ok=True)
        offset = 0
        with path.open("xb") as copy:
            while piece := os.pread(self._descriptor, 1 << 20, offset):
                copy.write(piece)
                offset += len(piece)
            copy.flush()
            os.fsync(copy.fileno())

    def close(self) -> None:
        """Close the duplicate descriptor; a deleted file is gone afterwards."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def _what_happened(self, replaced: bool) -> str:
        if self._descriptor is not None:
            found = os.fstat(self._descriptor)
            if not stat.S_ISREG(found.st_mode) or found.st_nlink == 0:
                return f"was {'replaced by another file' if replaced else 'deleted'} while it was being written"
            with contextlib.suppress(OSError):
                candidate = Path(f"/proc/self/fd/{self._descriptor}").readlink()
                if os.path.samestat(candidate.stat(), found):
                    self.moved_to = candidate
                    return f"was moved to {candidate} while it was being written"
        return "can no longer be reached: it, its folder or its disk was moved or removed while it was being written"


def writer_is_alive(path: Path, pid: int) -> bool:
    """Whether the process that created a run file on this computer still writes it; its number may be another's by now."""
    return process_is_alive(pid) and (os.name == "nt" or pid == os.getpid() or _has_open(path, pid))


def process_is_alive(pid: int) -> bool:
    """Whether there is a process of this number."""
    if os.name == "nt":  # no harmless signal there: a stale number then counts as a running program
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def _has_open(path: Path, pid: int) -> bool:
    """Whether a process has a file open; also true where the system cannot tell."""
    try:
        file = path.stat()
        handles = list(Path(f"/proc/{pid}/fd").iterdir())
    except OSError:
        return True
    for handle in handles:
        try:
            if os.path.samestat(handle.stat(), file):
                return True
        except OSError:
            continue
    return False
