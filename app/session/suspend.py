"""Suspend inhibitor: keeps the computer from going to sleep while a real bench is connected.

wakepy (MIT, 1.0.0) was considered first: on Linux it inhibits desktop sessions only, and not logind, which also decides about the
lid and works without a desktop; on Windows and macOS it needs one call and one command.
"""

import contextlib
import ctypes
import os
import subprocess
import sys
import threading
from collections.abc import Iterator

from drivers import Deadline

ES_CONTINUOUS, ES_SYSTEM_REQUIRED = 0x8000_0000, 0x0000_0001
LINUX_COMMAND = (
    "systemd-inhibit", "--what=sleep:idle:handle-lid-switch", "--mode=block",
    "--who=Tactor Bench", "--why=high voltage may be on", "cat",
)  # fmt: skip
"""`cat` ends, and with it the inhibition, when this program's end of the pipe is closed, also by its death."""


@contextlib.contextmanager
def suspend_inhibited() -> Iterator[str]:
    """Keep the computer awake inside; yield a warning if that is not possible, else an empty text."""
    with contextlib.ExitStack() as stack:
        why = ""
        try:
            if sys.platform == "win32":
                _inhibit_on_windows(stack)
            elif sys.platform == "darwin":
                _start(("caffeinate", "-i", "-s", "-w", str(os.getpid())), stack)
            else:
                _inhibit_by_logind(stack)
        except (OSError, subprocess.SubprocessError) as error:
            why = (
                f"This computer may suspend during a run: {error}. A suspended computer stops watching, and a card without USB "
                "power outputs 0 V; switch automatic suspend off in its power settings"
            )
        yield why


def _inhibit_on_windows(stack: contextlib.ExitStack) -> None:
    """Keep Windows awake; the request belongs to the calling thread and ends with it."""
    set_state = ctypes.windll.kernel32.SetThreadExecutionState  # type: ignore[attr-defined,unused-ignore]
    if not set_state(ctypes.c_uint(ES_CONTINUOUS | ES_SYSTEM_REQUIRED)):
        raise OSError("Windows refuses SetThreadExecutionState")
    stack.callback(set_state, ctypes.c_uint(ES_CONTINUOUS))


def _inhibit_by_logind(stack: contextlib.ExitStack) -> None:
    """Hold logind's inhibitor lock; returns when `cat` runs, which is when the lock is held."""
    child = _start(LINUX_COMMAND, stack)
    silent = threading.Timer(Deadline.SUSPEND_INHIBITOR.seconds, child.kill)  # ends the read below
    silent.start()
    stack.callback(silent.cancel)
    assert child.stdin is not None
    assert child.stdout is not None
    with contextlib.suppress(BrokenPipeError):
        child.stdin.write(b"\n")
        child.stdin.flush()
    if child.stdout.read(1) != b"\n":
        child.wait(
            Deadline.SUSPEND_INHIBITOR.seconds
        )  # It has ended or was killed; unawaited it stays a zombie as long as the bench is open.
        raise OSError("systemd-inhibit could not ask logind")
    silent.cancel()


def _start(command: tuple[str, ...], stack: contextlib.ExitStack) -> "subprocess.Popen[bytes]":
    child = subprocess.Popen(  # noqa: S603 - a fixed command
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
    )
    stack.callback(_end, child)
    return child


def _end(child: "subprocess.Popen[bytes]") -> None:
    child.terminate()
    try:
        child.communicate(timeout=Deadline.SUSPEND_INHIBITOR.seconds)
    except OSError:
        return
    except subprocess.TimeoutExpired:
        child.kill()
