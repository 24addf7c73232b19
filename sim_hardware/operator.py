"""The operator of a simulated bench: does with the bench what a person would be asked to do."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

from protocols.base.steps import Prompt
from sim_hardware.plant.setup_state import OPERATOR_ACTIONS

if TYPE_CHECKING:
    from sim_hardware.plant.history_report import VoltageReport

SLOW_ACTIONS = {"place-weight", "remove-weight"}
"""What a person looks at for a while before the key is pressed: the laser mostly sees it first."""


class BenchControls(Protocol):
    """Controls of a simulated bench: a `SimulatedBench` in this process, or a `BenchProcess` that serves one."""

    def enable_hv(self) -> None: ...

    def disable_hv(self) -> None: ...

    def perform_action(self, action: str, values: Mapping[str, float]) -> float:
        """Perform one of OPERATOR_ACTIONS; return the bench time at which it is done."""

    def inject(self, fault: str) -> None:
        """Inject one of `sim_hardware.plant.faults.FAULT_DESCRIPTIONS`."""

    def clear(self, fault: str | None = None) -> None:
        """Clear one fault, or all."""

    def active_faults(self) -> tuple[str, ...]: ...

    def report(self, tolerance_v: float = 0.02) -> "VoltageReport":
        """Return the voltages at the amplifier's input until now."""

    def now(self) -> float: ...

    def laser_reading_m(self) -> float | None:
        """Return the displacement that the laser sensor displays now; None out of its range."""


class SimulatedOperator:
    """Answers a run's prompts (protocols.base.operator.Operator) by doing what `prompt.action` says.

    Its words are the first of the choices. Where a weight is placed or lifted, the key is pressed only after a while,
    so that the laser can see it before. A question that no hand answers gets the first choice at once.

    Args:
        patience_s: bench time from a weight's landing until the key.
    """

    def __init__(self, bench: BenchControls, patience_s: float = 10.0) -> None:
        self._bench, self._patience_s = bench, patience_s
        self._answers: dict[int, tuple[float, str]] = {}

    def clear_specimen(self) -> None:
        """Bring the specimen back to how it stood at first, as a person would after a run that was stopped with a weight on."""
        self._bench.disable_hv()  # nobody reaches for a live specimen; a run asks for it once more
        self._bench.perform_action("tidy-up", {})

    def show(self, ask_id: int, prompt: Prompt) -> None:
        """Begin with it at once."""
        bench, due_s = self._bench, 0.0
        match prompt.action:
            case "disable-high-voltage":
                bench.disable_hv()
            case "enable-high-voltage":
                bench.perform_action("connect-electrodes", {})  # nobody leaves a short across them
                bench.enable_hv()
            case action if action in OPERATOR_ACTIONS:
                due_s = bench.perform_action(action, dict(prompt.values))
                due_s = due_s + self._patience_s if action in SLOW_ACTIONS else 0.0
        self._answers[ask_id] = due_s, prompt.choices[0]

    def answer(self, ask_id: int) -> str | None:
        """The words, once, when the time has come."""
        due_s, words = self._answers.get(ask_id, (0.0, None))
        if words is None or (due_s and self._bench.now() < due_s):
            return None
        del self._answers[ask_id]
        return words
