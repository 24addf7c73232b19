"""Child processes in Python that import nothing from the working directory and end with their standard input."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

from drivers.deadlines import Deadline
from drivers.watchdog.origin import PACKAGE_FOLDER


def python_command(*arguments: str) -> list[str]:
    """Return the command that runs this Python with `arguments`; `-P` keeps the working directory out of its imports."""
    return [sys.executable, "-P", *arguments]


def python_environment() -> dict[str, str]:
    """Return the environment of such a process: this program's packages come first, relative paths are left out."""
    inherited = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(PACKAGE_FOLDER), *(p for p in inherited if Path(p).is_absolute())]),
        "PYTHONSAFEPATH": "1",  # for its child processes
        "OPENBLAS_NUM_THREADS": "1",  # the matrices are small; a second thread would be slower
    }


def terminate(child: "subprocess.Popen[str]") -> None:
    """Close its standard input, which ends it, and wait; kill it at the timeout."""
    if child.stdin is not None:
        with contextlib.suppress(OSError):
            child.stdin.close()
    try:
        child.wait(Deadline.CHILD_EXIT.seconds)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
