"""Threads beside the window: prompts are answered once, by their id, and reference cycles are collected in the GUI thread.

A worker that collects a cycle disconnects its signals under a lock of Qt, and the window hangs.
"""

import gc
import threading

import pytest
from PySide6.QtCore import QCoreApplication

from app.gui.shell import collect_garbage_here
from app.live.session_link import PromptMailbox, SessionAdapter
from app.session import BlockMonitored
from protocols.base import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE, BlockStored
from tests.helpers.main_window import ListeningSession, until
from tests.helpers.session_events import sine_block


def test_an_answer_reaches_the_one_who_asked_and_is_gone() -> None:
    box = PromptMailbox()
    box.show(1, DISABLE_HIGH_VOLTAGE)
    assert box.pending_id == 1
    assert box.answer(1) is None
    assert box.reply(1)
    assert box.answer(1) == "done"
    assert box.pending_id is None
    assert box.answer(1) is None


def test_a_stale_answer_answers_nothing() -> None:
    box = PromptMailbox()
    box.show(1, DISABLE_HIGH_VOLTAGE)
    box.show(2, ENABLE_HIGH_VOLTAGE)
    assert not box.reply(1)
    assert box.answer(2) is None


def test_a_run_that_ended_takes_its_answer_with_it() -> None:
    box = PromptMailbox()
    box.show(1, DISABLE_HIGH_VOLTAGE)
    assert box.reply(1)
    box.show(1, DISABLE_HIGH_VOLTAGE)  # the next run begins its ids anew
    assert box.answer(1) is None
    box.clear()
    assert box.pending_id is None
    assert not box.reply(1)


def test_nobody_waits_for_an_answer_that_was_never_asked() -> None:
    assert not PromptMailbox().reply(1)


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


def test_every_block_of_the_card_wakes_a_window_at_rest_and_none_of_a_run() -> None:
    session = ListeningSession()
    link = SessionAdapter(lambda: pytest.fail("nobody connects here"), lambda *_: session)
    woken: list[int] = []
    link.on_event = lambda: woken.append(len(woken))
    for _ in range(3):
        link.observe(BlockMonitored(sine_block(0, 10, 5000.0)))
    link.observe(BlockStored(sine_block(0, 10, 5000.0), 0))
    assert woken == [0, 1, 2]
