"""A person's hands on the specimen: only where rest was measured and high voltage is off, and both again before going on."""

import contextlib
from collections.abc import Sequence

from drivers.bench.bench import Armed
from protocols.base.operator import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE
from protocols.base.steps import Prompt
from protocols.runner.executor import Executor


class Hands:
    """Has a person set up what entries need, and switch high voltage: a HighVoltageSwitch whose hands are prompts.

    Args:
        high_voltage: whether the specimen gets any in this run.
    """

    def __init__(self, executor: Executor, high_voltage: bool) -> None:
        self._executor, self._high_voltage = executor, high_voltage
        self._standing: Prompt | None = None
        """What was set up last, and stands."""

    def disable(self) -> None:
        """Have the operator switch high voltage off."""
        self._executor.ask(DISABLE_HIGH_VOLTAGE)

    def enable(self) -> None:
        """Have the operator switch high voltage on."""
        self._executor.ask(ENABLE_HIGH_VOLTAGE)

    def prepare(self, armed: Armed, prompts: Sequence[Prompt]) -> None:
        """Have a person do one thing after the other, before the first entry."""
        with self._on_specimen(armed, any(prompt.hands_on for prompt in prompts)):
            for prompt in prompts:
                self._executor.ask(prompt)

    def set_up(self, armed: Armed, setup: Prompt | None) -> None:
        """Have a person set up what an entry needs, where that is not what stands there."""
        if setup is None or setup == self._standing:
            return
        self._standing = None
        with self._on_specimen(armed, setup.hands_on):
            self._executor.ask(setup)
        self._standing = setup

    def _on_specimen(self, armed: Armed, on: bool) -> contextlib.AbstractContextManager[None]:
        return armed.hands_on(self) if on and self._high_voltage else contextlib.nullcontext()
