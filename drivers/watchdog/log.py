"""The watchdog's log: a text file beside the runs, a line for everything it did; told once at the next start."""

import contextlib
import os
import time
from pathlib import Path

LOG_NAME = "watchdog.log"
REPORTED_MARK = "the lines above were told at the next start"


def append_line(folder: Path, message: str) -> None:
    """Append a line and see it onto the disk. A folder that cannot be written is no reason to stop anything."""
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / LOG_NAME).open("a", encoding="utf-8") as log:
            log.write(f"{_utc_timestamp()}  {message}\n")
            log.flush()
            os.fsync(log.fileno())


def take_unreported_lines(folder: Path) -> list[str]:
    """The lines that nobody has been told yet; they are marked as told."""
    try:
        lines = (folder / LOG_NAME).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    told = max((i for i, line in enumerate(lines) if line.endswith(REPORTED_MARK)), default=-1)
    new = [line for line in lines[told + 1 :] if line.strip()]
    if new:
        append_line(folder, REPORTED_MARK)
    return new


def _utc_timestamp() -> str:
    now = time.time()
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(now)) + f".{int(now % 1 * 1000):03d}Z"
