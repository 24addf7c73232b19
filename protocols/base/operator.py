"""Operator interface: shows prompts and returns answers (window, console, test, simulated operator)."""

from typing import Protocol

from protocols.base.steps import Prompt


class Operator(Protocol):
    """Shows prompts and is polled for answers. Ids are unique, so that a stale answer is never mistaken for a new one.

    An operator may have a property `unreachable_reason`, a text that is empty while an answer is possible; otherwise an abort
    level with the action "ask" ends the run at rest.
    """

    def show(self, ask_id: int, prompt: Prompt) -> None:
        """Show a prompt; must not wait."""

    def answer(self, ask_id: int) -> str | None:
        """Return the answer, or None before it was given. Called many times a second; must not wait."""


DISABLE_HIGH_VOLTAGE = Prompt(
    "disable-high-voltage", "Switch the amplifier's high voltage OFF. The generator's output is about to come up."
)
ENABLE_HIGH_VOLTAGE = Prompt(
    "enable-high-voltage",
    "Rest is measured at the amplifier's input. Hands off the specimen; the amplifier's high voltage must be ON now.",
)
