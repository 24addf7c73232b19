"""Operator actions on the specimen: at measured rest with high voltage off, both checked afterwards."""

import contextlib
from collections.abc import Sequence

from drivers import ArmedBench
from protocols.base import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE, Prompt
from protocols.runner.operator_prompts import OperatorPrompts


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
                self._prompts.ask(prompt)

    def set_up(self, armed: ArmedBench, setup: Prompt | None) -> None:
        """Prompt for the set-up of an entry if it differs from the current one."""
        if setup is None or setup == self._current_setup:
            return
        self._current_setup = None
        with self._specimen_access(armed, setup.hands_on):
            self._prompts.ask(setup)
        self._current_setup = setup

    def _specimen_access(self, armed: ArmedBench, needed: bool) -> contextlib.AbstractContextManager[None]:
        return armed.specimen_access(self) if needed and self._high_voltage else contextlib.nullcontext()
