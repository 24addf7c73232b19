"""Who answers a prompt: the window, the console, a test's script, or the simulated operator."""

from typing import Protocol

from protocols.base.steps import Prompt


class Operator(Protocol):
    """Shown a prompt, polled for the answer. Ids are unique, so a stale answer cannot be mistaken for a new one."""

    def show(self, ask_id: int, prompt: Prompt) -> None:
        """Show a prompt; must not wait."""

    def answer(self, ask_id: int) -> str | None:
        """The answer, or None while there is none. Called many times a second; must not wait."""


DISABLE_HIGH_VOLTAGE = Prompt(
    "disable-high-voltage",
    "Switch the amplifier's high voltage OFF. The generator's output is about to come up.",
)
ENABLE_HIGH_VOLTAGE = Prompt(
    "enable-high-voltage",
    "Rest is measured at the amplifier's input. Hands off the specimen; the amplifier's high voltage must be ON now.",
)
