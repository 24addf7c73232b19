"""Operator prompts, and operator actions on the specimen: at measured rest with high voltage off, both checked afterwards."""

import contextlib
import itertools
from collections.abc import Sequence

from drivers import ArmedBench
from protocols.base import (
    DISABLE_HIGH_VOLTAGE,
    ENABLE_HIGH_VOLTAGE,
    Detector,
    Operator,
    Prompt,
    PromptAnswered,
    PromptShown,
    SpecimenMounted,
)
from protocols.runner.acquisition import RunAcquisition
from protocols.runner.publisher import RunRecorder

_PROMPT_IDS = itertools.count(1)
"""Unique in the process, so that a late answer to a prompt of an earlier run is never mistaken for an answer of this run."""


class OperatorPrompts:
    """Shows prompts to the operator, without a time limit."""

    def __init__(self, operator: Operator, recorder: RunRecorder, acquisition: RunAcquisition, who: str = "") -> None:
        self._operator, self._recorder, self._acquisition, self._who = operator, recorder, acquisition, who

    @property
    def unreachable_reason(self) -> str:
        """Reason why prompts cannot be answered; empty if they can, or if the operator interface has no such property."""
        return str(getattr(self._operator, "unreachable_reason", ""))

    def ask(self, prompt: Prompt) -> str:
        """Show a prompt, wait for the answer, and return it."""
        return self.wait_for_answer(prompt) or ""

    def mount(self, prompt: Prompt) -> None:
        """Show a prompt, wait for the answer, and record the mounting of a part of the set-up."""
        mounting = SpecimenMounted.by_prompt(prompt, self.ask(prompt), self._who)
        if mounting is not None:
            self._recorder.publish(mounting)

    def wait_for_answer(self, prompt: Prompt, detector: Detector | None = None) -> str | None:
        """Show a prompt and wait for the answer; return None after the detection of the action by `detector`."""
        ask_id = next(_PROMPT_IDS)
        self._recorder.publish(PromptShown(ask_id, prompt))
        self._operator.show(ask_id, prompt)
        while (answer := self._operator.answer(ask_id)) is None:
            self._acquisition.check_interrupts()
            # The card's buffer must be read while the program waits for the operator; these samples are not stored.
            block = self._acquisition.wait_for_block()
            if detector is not None and block is not None and detector.feed(*self._acquisition.to_si(block.raw)):
                self._recorder.publish(PromptAnswered(ask_id, "seen by the laser"))
                return None
        self._recorder.publish(PromptAnswered(ask_id, answer))
        self._acquisition.drain_stale_blocks()
        return answer


class OperatorActions:
    """Prompts the operator to set up entries and to switch high voltage (HighVoltageSwitch).

    Args:
        high_voltage: whether the run uses high voltage.
    """

    def __init__(self, prompts: OperatorPrompts, high_voltage: bool) -> None:
        self._prompts, self._high_voltage = prompts, high_voltage
        self._current_setup: Prompt | None = None
        """The current set-up of the specimen."""

    def disable(self) -> None:
        """Prompt the operator to switch high voltage off."""
        self._prompts.ask(DISABLE_HIGH_VOLTAGE)

    def enable(self) -> None:
        """Prompt the operator to switch high voltage on."""
        self._prompts.ask(ENABLE_HIGH_VOLTAGE)

    def prepare(self, armed: ArmedBench, prompts: Sequence[Prompt]) -> None:
        """Show the preparation prompts, before the first entry."""
        with self._specimen_access(armed, any(prompt.hands_on for prompt in prompts)):
            for prompt in prompts:
                self._prompts.mount(prompt)

    def set_up(self, armed: ArmedBench, setup: Prompt | None) -> None:
        """Prompt for the set-up of an entry if it differs from the current one."""
        if setup is None or setup == self._current_setup:
            return
        is_same_part = self._current_setup is not None and self._current_setup.action == setup.action
        self._current_setup = None
        with self._specimen_access(armed, setup.hands_on):
            if is_same_part:  # e.g. the same membrane, stretched further
                self._prompts.ask(setup)
            else:
                self._prompts.mount(setup)
        self._current_setup = setup

    def _specimen_access(self, armed: ArmedBench, needed: bool) -> contextlib.AbstractContextManager[None]:
        return armed.specimen_access(self) if needed and self._high_voltage else contextlib.nullcontext()
