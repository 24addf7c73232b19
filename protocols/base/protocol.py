"""What every protocol is: frozen parameters with units, a plan of entries, steps for each, and a pure analysis.

A protocol is one file: a subclass of `Protocol` whose annotated fields become its form, its command-line settings and
its file attributes. Its plan is a list of entries; each is measured whole and gives one point. That is what makes
pausing, resuming after a crash and measuring a point again the same for all of them.
"""

from abc import ABC, abstractmethod
from collections.abc import Generator, Iterable, Mapping, Sequence
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict

from drivers.deprecated import renamed
from protocols.base.records import EstimatedQuantity, PlanEntry, Recording, ResultCurve
from protocols.base.steps import Repeat, Step


@renamed(more="refine", remarks="warnings")
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

    @property
    def meters(self) -> tuple[str, ...]:
        """The meters of the bench it reads, by their names in the bench file."""
        return ()

    @abstractmethod
    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        """All entries that are known beforehand, in order; the same for the same parameters."""

    def refine(self, points: Sequence[Any], rest_v: float) -> tuple[PlanEntry, ...]:
        """Further entries once all entries so far are measured; none ends the run. Pure: the same for the same points."""
        return ()

    @abstractmethod
    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, Repeat | None]:
        """What shall be done for one entry. May branch on what the steps are answered with."""

    @abstractmethod
    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> Any:
        """The point of one entry from its recordings: pure, so that a file gives the numbers of the live run.

        Raises:
            ValueError: these recordings give none; the sentence says why.
        """

    def curves(self, key: tuple[float | str, ...], recordings: Sequence[Recording]) -> tuple[ResultCurve, ...]:
        """What one entry gives beside its point, kept in the file: a frequency response. As pure as `point`.

        Raises:
            ValueError: these recordings give none; the sentence says why.
        """
        return ()

    def results(
        self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool
    ) -> Generator[Any, None, None]:
        """The point, then the curves of an entry: for a protocol that finds them together. ValueError as these."""
        yield self.point(key, recordings, simulated)
        yield from self.curves(key, recordings)

    def warnings(self, points: Sequence[Any]) -> tuple[str, ...]:
        """What the points so far say that somebody at the bench should hear now, in sentences; each is told once."""
        return ()

    @abstractmethod
    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        """What is identified from all points; empty where they do not suffice."""


def extend_plan(
    protocol: Protocol, plan: Sequence[PlanEntry], points: Mapping[int, Any], rest_v: float
) -> tuple[PlanEntry, ...]:
    """The plan with everything the protocol asks for once all entries so far have a point (`points` by entry)."""
    whole = tuple(plan)
    while all(i in points for i in range(len(whole))):
        more = protocol.refine([points[i] for i in range(len(whole))], rest_v)
        if not more:
            break
        whole += more
    return whole
