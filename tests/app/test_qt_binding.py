"""PySide6 6.12.0 on Python 3.11 loses a reference of None with every void call, which crashes the interpreter."""

import sys

from PySide6.QtCore import QObject, Signal

TIMES = 1000


class _Bell(QObject):
    rung = Signal()


def test_void_calls_take_no_reference_of_none() -> None:
    thing = QObject()
    before = sys.getrefcount(None)
    for _ in range(TIMES):
        thing.setObjectName("x")
    assert abs(sys.getrefcount(None) - before) < TIMES // 10


def test_signal_emissions_take_no_reference_of_none() -> None:
    bell = _Bell()
    heard = [0]

    def ring() -> None:
        heard[0] += 1

    bell.rung.connect(ring)
    before = sys.getrefcount(None)
    for _ in range(TIMES):
        bell.rung.emit()
    assert heard[0] == TIMES
    assert abs(sys.getrefcount(None) - before) < TIMES // 10
