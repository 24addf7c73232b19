"""Watchdog log: a text file in the folder of the runs; unreported lines are shown at the next start."""

import contextlib
import os
import time
from pathlib import Path

from drivers.regular_files import open_regular

LOG_NAME = "watchdog.log"
REPORTED_MARK = "the lines above were shown at the next start"
FORMER_MARK = "the lines above were told at the next start"
"""Mark of logs of earlier versions."""


def append_line(folder: Path, message: str) -> None:
    """Append a line and flush it to disk. An unwritable folder is ignored: the watchdog must continue."""
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        with open_regular(folder / LOG_NAME, "a", encoding="utf-8") as log:
            log.write(f"{_utc_timestamp()}  {message}\n")
            log.flush()
            os.fsync(log.fileno())


def take_unreported_lines(folder: Path) -> list[str]:
    """Return the lines that have not been reported yet, and mark them as reported."""
    try:
        with open_regular(folder / LOG_NAME, "r", encoding="utf-8", errors="replace") as log:
            lines = log.read().splitlines()
    except OSError:
        return []
    reported = max((i for i, line in enumerate(lines) if line.endswith((REPORTED_MARK, FORMER_MARK))), default=-1)
    new = [line for line in lines[reported + 1 :] if line.strip()]
    if new:
        append_line(folder, REPORTED_MARK)
    return new


def _utc_timestamp() -> str:
    now = time.time()
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(now)) + f".{int(now % 1 * 1000):03d}Z"
