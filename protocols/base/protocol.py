"""Protocol base class: parameters with units, a plan of entries, steps per entry, pure analysis.

A protocol is one file: a subclass of `Protocol` whose annotated fields become its form, its command-line settings and its file
attributes. Its plan is a list of entries; each is measured completely and gives one point. Pausing, resuming after a crash and
repeating a point therefore work the same way for all protocols.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, NamedTuple, Self, TypeVar

from annotated_types import Interval, Unit
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from drivers import HIGHEST_C, LOWEST_C, Drive
from model import current_parameter
from protocols.base.aspects import Aspects, AspectsOfModule
from protocols.base.events import LevelExceeded
from protocols.base.records import (
    MAX_RECORDING_SCANS,
    Array,
    EstimatedQuantity,
    InterferenceLine,
    PlanEntry,
    Recording,
    Series,
)
from protocols.base.reference import ReferenceModel
from protocols.base.steps import Prompt, Repeat, Step
from protocols.base.verdict import CheckResult


class UnattendedRun(NamedTuple):
    """An unattended run: the person responsible, its longest duration in bench time, and whether it can be stopped from a phone."""

    responsible: str
    longest_s: float
    stop_from_phone: bool = False


class AirTarget(NamedTuple):
    """Temperature of the air to wait for: near `celsius` for `steady_s`; the wait ends the run after `longest_s`."""

    celsius: float
    within_k: float
    steady_s: float
    longest_s: float

    def __str__(self) -> str:
        return f"{self.celsius:g} °C (within {self.within_k:g} K) for {self.steady_s:g} s"


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

    integrates_velocity: ClassVar[bool] = False
    """Whether the analysis takes a vibrometer's velocity; the others need the displacement itself, with its mean."""

    repeatable: ClassVar[bool] = True
    """Whether an entry may be measured again; not where each wears the specimen and is counted."""

    rest_record_s: ClassVar[float] = 1.0
    """Duration of the recording at rest before the first entry, in which hum and other interference is measured; 0: none."""

    max_recording_scans: ClassVar[float] = MAX_RECORDING_SCANS
    """Longest recording of the analysis; infinite for an analysis in parts."""

    aspects: ClassVar[Aspects] = AspectsOfModule()  # type: ignore[assignment]
    """Aspects for fit, import, figures and lists; a laboratory's protocol assigns an instance of its own subclass."""

    sample_rate_hz: float
    air_temperature_c: Annotated[
        float,
        Unit("degC"),
        Interval(ge=LOWEST_C, le=HIGHEST_C),
        "temperature of the air to wait for at rest before the first entry",
    ] = 23.0
    air_within_k: Annotated[
        float, Unit("K"), Interval(ge=0, le=10), "largest distance from air_temperature_c; 0: do not wait"
    ] = 0.0
    air_steady_s: Annotated[
        float, Unit("s"), Interval(ge=0, le=86_400), "for how long the temperature must be within air_within_k"
    ] = 300.0
    air_longest_s: Annotated[float, Unit("s"), Interval(gt=0, le=604_800), "longest wait, after which the run ends"] = (
        7200.0
    )

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
    def air_target(self) -> AirTarget | None:
        """Temperature of the air to wait for; None: the run does not wait."""
        if not self.air_within_k:
            return None
        return AirTarget(self.air_temperature_c, self.air_within_k, self.air_steady_s, self.air_longest_s)

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

    def with_history(self, points: Mapping[str, Array]) -> Self:
        """Return the protocol with expected values from the points of the specimen's last good run of the same name. Pure."""
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

    def drifts(self, points: Sequence[Any]) -> tuple[Series, ...]:
        """Return series over all points so far; drawn anew after each point, and stored with the first entry. Pure."""
        return ()

    def limits_exceeded(self, points: Sequence[Any]) -> tuple[LevelExceeded, ...]:
        """Return the limits of the protocol's own figures that the points so far exceed; each acts once in a run. Pure."""
        return ()

    def uncounted(self, entry: PlanEntry) -> str:
        """Return what an entry may have done uncounted that a killed program has begun, as a sentence; empty if nothing."""
        return ""

    @property
    def unattended_run(self) -> UnattendedRun | None:
        """Who is responsible for a run with nobody at the bench, and its longest duration; None for a run that is attended."""
        return None

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
