"""Prompt mailbox: a prompt is answered once, by its id; answers to other prompts are ignored."""

from app.live.session_link import PromptMailbox
from protocols.base import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE


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
