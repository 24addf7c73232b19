"""Simulated operator: answers prompts by acting on a simulated bench; and its controls."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from protocols.base import Prompt, SpecimenMounted
from sim_hardware.plant import OPERATOR_ACTIONS

if TYPE_CHECKING:
    from sim_hardware.plant import VoltageReport

SLOW_ACTIONS = {"place-weight", "remove-weight"}
"""Actions with a delay before the operator's confirmation: mostly the laser detects them first."""


class BenchControls(Protocol):
    """Controls of a simulated bench: a `SimulatedBench` in this process, or a `BenchProcess` that serves one."""

    def enable_hv(self) -> None: ...

    def disable_hv(self) -> None: ...

    def perform_action(self, action: str, values: Mapping[str, float]) -> float:
        """Perform one of OPERATOR_ACTIONS; return the bench time of its end."""

    def inject(self, fault: str) -> None:
        """Inject one of `sim_hardware.plant.faults.FAULT_DESCRIPTIONS`."""

    def clear(self, fault: str | None = None) -> None:
        """Clear one fault, or all."""

    def active_faults(self) -> tuple[str, ...]: ...

    def report(self, tolerance_v: float = 0.02) -> "VoltageReport":
        """Return the voltages at the amplifier's input until now."""

    def now(self) -> float: ...

    def laser_reading_m(self) -> float | None:
        """Return the present displacement of the laser sensor; None out of its range."""

    def room_reading(self) -> tuple[float, float]:
        """Return the present temperature of the air, degrees Celsius, and its relative humidity from 0 to 1."""
        ...


class SimulatedOperator:
    """Answers the prompts of a run (protocols.base.Operator) by performing `prompt.action`.

    The answer is the first choice. It follows a placed or removed weight after a delay, so that the laser can detect it before. A
    prompt without an action is answered immediately.

    Args:
        bench: the simulated bench.
        patience_s: bench time from a weight's landing until the answer.
    """

    def __init__(self, bench: BenchControls, patience_s: float = 10.0) -> None:
        self._bench, self._patience_s = bench, patience_s
        self._answers: dict[int, tuple[float, str]] = {}

    def clear_specimen(self, mountings: Sequence[SpecimenMounted] = (), cycles: float | None = None) -> None:
        """Restore the specimen as it was mounted last, after a run stopped with a weight on; without mountings the initial state.

        Args:
            mountings: every mounting of the specimen, the oldest first.
            cycles: its cycles so far; None on a bench where it does not age.
        """
        self._bench.disable_hv()  # the specimen must not be live; a run prompts for high voltage again
        parts = [each.part for each in mountings]
        values = {f"{part}_mountings": float(parts.count(part)) for part in dict.fromkeys(parts)}
        values |= next((each.values for each in reversed(mountings) if each.part == "mass"), {})
        values |= {} if cycles is None else {"cycles": cycles}
        self._bench.perform_action("tidy-up", values)

    def show(self, ask_id: int, prompt: Prompt, patience_s: float | None = None) -> None:
        """Start the action. `patience_s` replaces this operator's."""
        patience_s = self._patience_s if patience_s is None else patience_s
        bench, due_s = self._bench, 0.0
        match prompt.action:
            case "disable-high-voltage":
                bench.disable_hv()
            case "enable-high-voltage":
                bench.perform_action("connect-electrodes", {})  # a short across them must be removed first
                bench.enable_hv()
            case action if action in OPERATOR_ACTIONS:
                due_s = bench.perform_action(action, dict(prompt.values))
                due_s = due_s + patience_s if action in SLOW_ACTIONS else 0.0
        self._answers[ask_id] = due_s, prompt.choices[0]

    def answer(self, ask_id: int) -> str | None:
        """Return the answer, once, when it is due."""
        due_s, answer = self._answers.get(ask_id, (0.0, None))
        if answer is None or (due_s and self._bench.now() < due_s):
            return None
        del self._answers[ask_id]
        return answer
