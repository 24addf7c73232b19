"""What every protocol is: frozen parameters with units, a plan, steps, and a pure analysis.

A protocol is one file: a subclass of `Protocol` whose annotated fields become its form, its command-line settings and
its file attributes, and whose `steps()` yields what shall be done.
"""

from abc import ABC, abstractmethod
from collections.abc import Generator, Iterable
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict

from drivers.amplifier import HvAmplifier
from protocols.steps import Step
from protocols.values import Estimate, Planned, Recording, Rehearsal


class Protocol(BaseModel, ABC):
    """Parameters of one measurement; subclasses say what is done with them."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: ClassVar[str]
    title: ClassVar[str]
    point_type: ClassVar[type]
    """Frozen dataclass of annotated quantities; its fields are the columns of the run's points."""
    axes: ClassVar[tuple[str, str]]
    """The columns that the live plot and a NeXus viewer draw: x and y."""

    sample_rate_hz: float

    @abstractmethod
    def plan(self, rest_v: float) -> tuple[Planned, ...]:
        """All drives this protocol will play, in order."""

    @abstractmethod
    def steps(self, rest_v: float, simulated: bool) -> Generator[Step, Any, None]:
        """What shall be done. May branch on what the steps are answered with."""

    @abstractmethod
    def point(self, recording: Recording, simulated: bool) -> Any:
        """The point that one recording gives: pure, so that a file gives the numbers of the live run."""

    @abstractmethod
    def estimates(self, points: Iterable[Any]) -> tuple[Estimate, ...]:
        """What is identified from all points; empty where they do not suffice."""


def rehearse(protocol: Protocol, amplifier: HvAmplifier, channels: int = 2) -> Rehearsal:
    """Check every drive of a protocol against the guard, and tell what the run will ask of the bench.

    Raises:
        DriveRefused: a drive is not admissible.
    """
    plan = protocol.plan(amplifier.map.rest_v)
    for entry in plan:
        amplifier.admit(entry.drive)
    limits, volts = amplifier.limits, amplifier.map.specimen_v
    steepest = max(plan, key=lambda entry: entry.drive.slew_v_per_s)
    duration_s = sum(entry.expected_s for entry in plan)
    return Rehearsal(
        duration_s=duration_s,
        entries=len(plan),
        prompts=0,
        highest_specimen_v=float(volts(max(entry.drive.high_v for entry in plan))),
        lowest_specimen_v=float(volts(min(entry.drive.low_v for entry in plan))),
        file_bytes=round(duration_s * protocol.sample_rate_hz * channels * 2) + 200_000,
        worst=f"{steepest.label}: slope {100 * steepest.drive.slew_v_per_s / limits.slew_v_per_s:.0f} % of the limit",
    )
