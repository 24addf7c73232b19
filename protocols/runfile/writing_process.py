"""Process that writes a run file: whether it still runs."""

import os
from pathlib import Path


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
