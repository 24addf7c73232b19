"""Child process that runs as long as its standard input is open."""

import contextlib
import subprocess

EXIT_TIMEOUT_S = 5.0
"""Longest wait for it to end by itself."""


def terminate(child: "subprocess.Popen[str]") -> None:
    """Close its standard input, which makes it end, and wait; kill it at the timeout."""
    if child.stdin is not None:
        with contextlib.suppress(OSError):
            child.stdin.close()
    try:
        child.wait(EXIT_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
