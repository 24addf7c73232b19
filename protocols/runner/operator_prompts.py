"""Operator prompts: shows a prompt and waits for the answer while the card is read."""

import itertools

from protocols.base import Detector, Operator, Prompt, PromptAnswered, PromptShown
from protocols.runner.acquisition import RunAcquisition
from protocols.runner.publisher import RunRecorder

_PROMPT_IDS = itertools.count(1)
"""Unique in the process, so that a late answer to an earlier run's prompt is never mistaken for one of this run."""


class OperatorPrompts:
    """Shows prompts to the operator, without a time limit."""

    def __init__(self, operator: Operator, recorder: RunRecorder, acquisition: RunAcquisition) -> None:
        self._operator, self._recorder, self._acquisition = operator, recorder, acquisition

    @property
    def unreachable_reason(self) -> str:
        """Reason why prompts cannot be answered; empty if they can, or if the operator does not report it."""
        return str(getattr(self._operator, "unreachable_reason", ""))

    def ask(self, prompt: Prompt) -> str:
        """Show a prompt, wait for the answer, and return it."""
        return self.wait_for_answer(prompt) or ""

    def wait_for_answer(self, prompt: Prompt, detector: Detector | None = None) -> str | None:
        """Show a prompt and wait for the answer; return None once `detector` has detected the action."""
        ask_id = next(_PROMPT_IDS)
        self._recorder.publish(PromptShown(ask_id, prompt))
        self._operator.show(ask_id, prompt)
        while (answer := self._operator.answer(ask_id)) is None:
            self._acquisition.check_interrupts()
            # The card's buffer must be read while the operator takes their time; these samples are not stored.
            block = self._acquisition.wait_for_block()
            if detector is not None and block is not None and detector.feed(*self._acquisition.to_si(block.raw)):
                self._recorder.publish(PromptAnswered(ask_id, "seen by the laser"))
                return None
        self._recorder.publish(PromptAnswered(ask_id, answer))
        self._acquisition.drain_stale_blocks()
        return answer
