"""A person's hands on the specimen: only where rest was measured and high voltage is off, and both again before going on."""

import contextlib
from collections.abc import Sequence

from drivers.bench.bench import ArmedBench
from protocols.base import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE, Prompt
from protocols.runner.executor import StepExecutor


class OperatorActions:
    """Has a person set up what entries need, and switch high voltage: a HighVoltageSwitch whose hands are prompts.

    Args:
        high_voltage: whether the specimen gets any in this run.
    """

    def __init__(self, executor: StepExecutor, high_voltage: bool) -> None:
        self._executor, self._high_voltage = executor, high_voltage
        self._current_setup: Prompt | None = None
        """What was set up last, and stands."""

    def disable(self) -> None:
        """Have the operator switch high voltage off."""
        self._executor.ask_operator(DISABLE_HIGH_VOLTAGE)

    def enable(self) -> None:
        """Have the operator switch high voltage on."""
        self._executor.ask_operator(ENABLE_HIGH_VOLTAGE)

    def prepare(self, armed: ArmedBench, prompts: Sequence[Prompt]) -> None:
        """Have a person do one thing after the other, before the first entry."""
        with self._specimen_access(armed, any(prompt.hands_on for prompt in prompts)):
            for prompt in prompts:
                self._executor.ask_operator(prompt)

    def set_up(self, armed: ArmedBench, setup: Prompt | None) -> None:
        """Have a person set up what an entry needs, where that is not what stands there."""
        if setup is None or setup == self._current_setup:
            return
        self._current_setup = None
        with self._specimen_access(armed, setup.hands_on):
            self._executor.ask_operator(setup)
        self._current_setup = setup

    def _specimen_access(self, armed: ArmedBench, needed: bool) -> contextlib.AbstractContextManager[None]:
        return armed.specimen_access(self) if needed and self._high_voltage else contextlib.nullcontext()
