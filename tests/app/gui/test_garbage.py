"""Reference cycles are collected in the GUI thread: in a worker they disconnect signals under a lock of Qt, and the window hangs."""

import gc
import threading

from PySide6.QtCore import QCoreApplication

from app.gui.widgets import collect_garbage_here
from tests.helpers.main_window import until


class Noted:
    """Notes the thread in which it is collected; it refers to itself."""

    threads: list[threading.Thread]

    def __init__(self, threads: list[threading.Thread]) -> None:
        self.threads, self.me = threads, self

    def __del__(self) -> None:
        self.threads.append(threading.current_thread())


def allocate() -> None:
    kept = [[number] for number in range(20 * gc.get_threshold()[0])]
    assert kept


def test_cycles_are_collected_in_the_gui_thread(qt: QCoreApplication) -> None:
    collected: list[threading.Thread] = []
    with collect_garbage_here():
        for _ in range(2 * gc.get_threshold()[0]):
            Noted(collected)
        worker = threading.Thread(target=allocate)
        worker.start()
        worker.join()
        assert collected == []
        until(lambda: collected, "for the collection")
    assert set(collected) == {threading.main_thread()}
    assert gc.isenabled()
