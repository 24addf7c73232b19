"""A process of our own that lives as long as its standard input does."""

import contextlib
import subprocess

EXIT_TIMEOUT_S = 5.0
"""How long it may take to end by itself."""


def terminate(child: "subprocess.Popen[str]") -> None:
    """Close its standard input, which tells it to end; one that does not is killed. Returns when it is gone."""
    if child.stdin is not None:
        with contextlib.suppress(OSError):
            child.stdin.close()
    try:
        child.wait(EXIT_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
