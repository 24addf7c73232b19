"""What every protocol is: frozen parameters with units, a plan of entries, steps for each, and a pure analysis.

A protocol is one file: a subclass of `Protocol` whose annotated fields become its form, its command-line settings and
its file attributes. Its plan is a list of entries; each is measured whole and gives one point. That is what makes
pausing, resuming after a crash and measuring a point again the same for all of them.
"""

from abc import ABC, abstractmethod
from collections.abc import Generator, Iterable, Sequence
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict

from drivers.amplifier import HvAmplifier
from protocols.steps import Redo, Step
from protocols.values import Estimate, Planned, Recording, Rehearsal


class Protocol(BaseModel, ABC):
    """Parameters of one measurement; subclasses say what is done with them."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: ClassVar[str]
    title: ClassVar[str]
    point_type: ClassVar[type]
    """Frozen dataclass of annotated quantities, `quality` among them; its fields are the columns of the run's points."""
    axes: ClassVar[tuple[str, str]]
    """The columns that the live plot and a NeXus viewer draw: x and y. The error of y is the column `<y>_errors`."""
    high_voltage: ClassVar[bool] = True
    """Whether the specimen gets high voltage. Where not, the amplifier stays disabled, and the drive must read rest."""

    sample_rate_hz: float

    @abstractmethod
    def plan(self, rest_v: float) -> tuple[Planned, ...]:
        """All entries that are known beforehand, in order; the same for the same parameters."""

    def more(self, points: Sequence[Any], rest_v: float) -> tuple[Planned, ...]:
        """Further entries once all entries so far are measured; none ends the run. Pure: the same for the same points."""
        return ()

    @abstractmethod
    def measure(self, entry: Planned, rest_v: float) -> Generator[Step, Any, Redo | None]:
        """What shall be done for one entry. May branch on what the steps are answered with."""

    @abstractmethod
    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> Any:
        """The point of one entry from its recordings: pure, so that a file gives the numbers of the live run.

        Raises:
            ValueError: these recordings give none; the sentence says why.
        """

    @abstractmethod
    def estimates(self, points: Iterable[Any]) -> tuple[Estimate, ...]:
        """What is identified from all points; empty where they do not suffice."""


def rehearse(protocol: Protocol, amplifier: HvAmplifier, channels: int = 2) -> Rehearsal:
    """Check every drive of a protocol against the guard, and tell what the run will ask of the bench.

    Raises:
        DriveRefused: a drive is not admissible.
    """
    rest_v = amplifier.map.rest_v
    plan = protocol.plan(rest_v)
    drives = [(entry, drive) for entry in plan for drive in entry.drives]
    for _, drive in drives:
        amplifier.admit(drive)
    limits, volts = amplifier.limits, amplifier.map.specimen_v
    duration_s = sum(entry.expected_s for entry in plan)
    worst = "nothing is driven"
    if drives:
        entry, steepest = max(drives, key=lambda pair: pair[1].slew_v_per_s)
        worst = f"{entry.label}: slope {100 * steepest.slew_v_per_s / limits.slew_v_per_s:.0f} % of the limit"
    return Rehearsal(
        duration_s=duration_s,
        entries=len(plan),
        prompts=_prompts(plan, protocol.high_voltage),
        highest_specimen_v=float(volts(max((drive.high_v for _, drive in drives), default=rest_v))),
        lowest_specimen_v=float(volts(min((drive.low_v for _, drive in drives), default=rest_v))),
        file_bytes=round(duration_s * protocol.sample_rate_hz * channels * 2) + 200_000,
        worst=worst,
    )


def _prompts(plan: Sequence[Planned], high_voltage: bool) -> int:
    """How often a person is asked: high voltage off and on, every set-up (with both around it), and what entries ask."""
    asked, standing = (2 if high_voltage else 1), None
    for entry in plan:
        if entry.setup is not None and entry.setup != standing:
            standing = entry.setup
            asked += 3 if high_voltage and standing.hands_on else 1
        asked += entry.prompts
    return asked
