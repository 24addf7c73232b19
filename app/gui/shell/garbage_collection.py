"""Garbage collection in the GUI thread alone."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

from PySide6.QtCore import QTimer

INTERVAL_MS = 500


@contextmanager
def collect_garbage_here() -> Iterator[None]:
    """Collect reference cycles in this thread alone, which runs Qt's event loop.

    A cycle with a signal connection that a worker thread collects is disconnected there: that thread then holds a lock of Qt and
    waits for Python's, which the GUI thread holds while it waits for the lock of Qt: a deadlock.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    timer = QTimer(interval=INTERVAL_MS)
    timer.timeout.connect(_collect)
    timer.start()
    try:
        yield
    finally:
        timer.stop()
        if was_enabled:
            gc.enable()


def _collect() -> None:
    """Collect garbage with Python's own thresholds."""
    due = [
        at
        for at, (count, limit) in enumerate(zip(gc.get_count(), gc.get_threshold(), strict=True))
        if count > limit > 0
    ]
    if due:
        gc.collect(due[-1])
