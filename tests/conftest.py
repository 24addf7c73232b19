"""What every test may count on: no screen, no user's settings, and nobody leaves a thread behind."""

import os
import threading
import time
from collections.abc import Iterator

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")  # without it a GUI test aborts the interpreter


@pytest.fixture(autouse=True)
def no_thread_left_behind() -> Iterator[None]:
    """A test that leaves one of our threads running fails: it would also keep a generator playing."""
    before = set(threading.enumerate())
    yield
    deadline = time.monotonic() + 5.0
    while time.monotonic() < deadline:
        left = [t for t in threading.enumerate() if t not in before and not t.daemon]
        if not left:
            return
        left[0].join(0.05)
    raise AssertionError(f"the test left threads running: {[t.name for t in left]}")
