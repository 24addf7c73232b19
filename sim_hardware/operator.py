"""The operator of a simulated bench: does at the amplifier what a person would be asked to do."""

from typing import Protocol

from protocols.steps import Prompt


class Amplified(Protocol):
    """Whatever has a high-voltage switch: a `VirtualBench`, or a `BenchProcess`."""

    def enable_hv(self) -> None: ...

    def disable_hv(self) -> None: ...


class SimulatedOperator:
    """Answers a run's prompts (protocols.operator.Operator) by doing what `prompt.action` says."""

    def __init__(self, bench: Amplified) -> None:
        self._hands = {"disable-high-voltage": bench.disable_hv, "enable-high-voltage": bench.enable_hv}
        self._answers: dict[int, str] = {}

    def show(self, ask_id: int, prompt: Prompt) -> None:
        """Do it at once. An action nobody taught it stays unanswered, as with a person who does not understand."""
        if hand := self._hands.get(prompt.action):
            hand()
            self._answers[ask_id] = "done by the simulated operator"

    def answer(self, ask_id: int) -> str | None:
        """The words, once."""
        return self._answers.pop(ask_id, None)
