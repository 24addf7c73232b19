"""Protocol base class: parameters with units, a plan of entries, steps per entry, pure analysis.

A protocol is one file: a subclass of `Protocol` whose annotated fields become its form, its command-line settings and its file
attributes. Its plan is a list of entries; each is measured completely and gives one point. Pausing, resuming after a crash and
repeating a point therefore work the same way for all protocols.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from typing import Any, ClassVar, Self, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from drivers import Drive
from model import current_parameter
from protocols.base.aspects import Aspects, AspectsOfModule
from protocols.base.records import (
    MAX_RECORDING_SCANS,
    EstimatedQuantity,
    InterferenceLine,
    PlanEntry,
    Recording,
    Series,
)
from protocols.base.reference import ReferenceModel
from protocols.base.steps import Prompt, Repeat, Step
from protocols.base.verdict import CheckResult


class Protocol(BaseModel, ABC):
    """Parameters and procedure of one measurement."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: ClassVar[str]
    title: ClassVar[str]
    point_type: ClassVar[type]
    """Frozen dataclass of annotated quantities, `quality` among them; its fields are the columns of the run's points."""
    axes: ClassVar[tuple[str, str]]
    """Columns of the live plot: x and y. The error of y is the column `<y>_errors`."""
    default_plot: ClassVar[str] = ""
    """Name of the series that plots and a NeXus viewer show first; empty for the points over `axes`."""
    high_voltage: ClassVar[bool] = True
    """Whether the specimen gets high voltage; if not, the amplifier stays disabled and the drive must read rest."""
    uses_weights: ClassVar[bool] = False
    """Whether the run uses weights, so that their calibration belongs to it."""
    diagnosed_levels: ClassVar[tuple[str, ...]] = ()
    """Abort levels whose cause the protocol itself detects and reports: exceeding them only gives a warning."""
    input_kinds: ClassVar[tuple[str, ...]] = ()
    """Kinds of the bench's further inputs ([[channels]]) of which the protocol needs one; none if it needs none."""
    passes_or_fails: ClassVar[bool] = False
    """Whether a failed check means that the run did not pass; its checks then count even for a run without verdict."""
    substitutes: ClassVar[tuple[str, ...]] = ()
    """Names of protocols for the same quantity, for a source that cannot play this one."""
    restore: ClassVar[Prompt | None] = None
    """Prompt of the next run of another protocol, if this one does not leave the tactor under the sensor."""

    rest_record_s: ClassVar[float] = 1.0
    """Duration of the recording at rest before the first entry, in which hum and other interference is measured; 0: none."""

    max_recording_scans: ClassVar[float] = MAX_RECORDING_SCANS
    """Longest recording of the analysis; infinite for an analysis in parts."""

    aspects: ClassVar[Aspects] = AspectsOfModule()  # type: ignore[assignment]
    """Aspects for fit, import, figures and lists; a laboratory's protocol assigns an instance of its own subclass."""

    sample_rate_hz: float

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        super().__pydantic_init_subclass__(**options)
        aspects = vars(cls).get("aspects")
        if isinstance(aspects, type):
            raise TypeError(
                f"the aspects of {cls.__name__} are the class {aspects.__name__}, not an instance of it; "
                f"write aspects = {aspects.__name__}()"
            )

    @model_validator(mode="before")
    @classmethod
    def _take_former_names(cls, values: Any) -> Any:
        """Return the values under the present names of the parameters, for files of earlier versions."""
        if not isinstance(values, dict):
            return values
        names = cls.model_fields
        present = [name if name in names else current_parameter(name, names) for name in values]
        if doubled := [name for name in present if present.count(name) > 1]:
            raise ValueError(f"{doubled[0]} is given twice, once by its former name; give it once")
        return dict(zip(present, values.values(), strict=True))

    @property
    def meters(self) -> tuple[str, ...]:
        """Names of the meters of the protocol, as in the bench file."""
        return ()

    @abstractmethod
    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        """Return all entries known in advance, in order; the same for the same parameters."""

    def adapted(self, rest_v: float, reason_unsupported: Callable[[Drive], str]) -> Self:
        """Return the protocol with other parameters if the source cannot play its drives; unchanged if that does not help. Pure.

        `reason_unsupported` returns the reason why the source cannot play a drive, empty if it can.
        """
        return self

    def refine(self, points: Sequence[Any], rest_v: float) -> tuple[PlanEntry, ...]:
        """Return further entries after the end of the plan; none ends the run. Pure."""
        return ()

    @abstractmethod
    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, Repeat | None]:
        """Yield the steps of one entry; may branch on their results."""

    @abstractmethod
    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> Any:
        """Return the point of one entry from its recordings. Pure, so that a file gives the numbers of the live run.

        Raises:
            ValueError: the recordings are insufficient; the message gives the reason.
        """

    def series(self, key: tuple[float | str, ...], recordings: Sequence[Recording]) -> tuple[Series, ...]:
        """Return the series of one entry, such as a frequency response; they are stored in the file. Pure.

        Raises:
            ValueError: the recordings are insufficient; the message gives the reason.
        """
        return ()

    def results(
        self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool
    ) -> Generator[Any, None, None]:
        """Yield the point, then the series of an entry; override it to compute both together. Raises ValueError."""
        yield self.point(key, recordings, simulated)
        yield from self.series(key, recordings)

    def warnings(self, points: Sequence[Any]) -> tuple[str, ...]:
        """Return warnings about the points so far; each is shown to the operator once."""
        return ()

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        """Return the protocol's own checks of the result; the verdict is the worst consequence. Pure.

        Args:
            points: the points of the completed plan, unusable ones included.
        """
        return ()

    def reference_checks(self, points: Sequence[Any], reference: ReferenceModel) -> tuple[CheckResult, ...]:
        """Return the checks against the model of the free specimen; none if the points cannot decide. Pure."""
        return ()

    def promised_estimates(self, points: Sequence[Any]) -> tuple[str, ...]:
        """Return the names of the estimates that such a plan must give; without one of them there is no result."""
        return ()

    def folded_onto(self, point: Any, lines: Sequence[InterferenceLine]) -> bool:
        """Return whether a line from above half the sample rate lies at the frequency of a point. Pure."""
        return False

    @classmethod
    def fit_lines(cls, points: Sequence[Any]) -> tuple[Series, ...]:  # noqa: ARG003 - for subclasses
        """Return the lines that the estimates describe, over the axes of the protocol; none without such a line. Pure."""
        return ()

    @abstractmethod
    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        """Return the quantities identified from all points; empty for insufficient points."""


P = TypeVar("P", bound=Protocol)


def first_adapted(
    candidates: Iterable[Mapping[str, Any]], protocol: P, rest_v: float, reason_unsupported: Callable[[Drive], str]
) -> P:
    """Return the protocol with the first of the parameter changes whose drives the source can play; unchanged if none helps.

    The unchanged protocol is tried first; changes that it rejects are skipped.
    """
    for changes in ({}, *candidates):
        try:
            changed = type(protocol)(**{**protocol.model_dump(), **changes}) if changes else protocol
        except ValidationError:
            continue
        drives = {drive for entry in changed.plan(rest_v) for drive in entry.drives}
        if not any(map(reason_unsupported, drives)):
            return changed
    return protocol


def extend_plan(
    protocol: Protocol, plan: Sequence[PlanEntry], points: Mapping[int, Any], rest_v: float
) -> tuple[PlanEntry, ...]:
    """Return the plan with all refinements by the present points (`points` by entry)."""
    whole = tuple(plan)
    while all(i in points for i in range(len(whole))):
        more = protocol.refine([points[i] for i in range(len(whole))], rest_v)
        if not more:
            break
        whole += more
    return whole
