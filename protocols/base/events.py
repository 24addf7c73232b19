"""Run events: frozen values, stored in the run file first and then published to the observers."""

import logging
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from typing import Any, ClassVar

from drivers import Block, Drive, Scale, as_record
from protocols.base.records import CycleStatistics, InterferenceLine, Series
from protocols.base.steps import Prompt
from protocols.base.text import to_jsonable
from protocols.base.verdict import Outcome, RunStatus, Verdict

EVENTS: dict[str, type["Event"]] = {}
"""Event types by their name in run files and `--json`; a released `kind` never changes."""


class Event:
    """Base class of the events of a run, each with its `kind`."""

    __slots__ = ()
    kind: ClassVar[str]

    def __init_subclass__(cls, kind: str = "") -> None:
        if kind:  # a dataclass with slots is created a second time, without the keyword
            cls.kind = kind
        EVENTS[cls.kind] = cls


UNNAMED = "unnamed"
"""Specimen of a run that was started without one."""


@dataclass(frozen=True, slots=True)
class RunStarted(Event, kind="RunStarted"):
    """The run file exists; nothing has moved yet."""

    protocol: str
    path: str
    expected_s: float
    entries: int
    simulated: bool
    specimen: str = ""


@dataclass(frozen=True, slots=True)
class StreamStarted(Event, kind="StreamStarted"):
    """The acquisition has started."""

    rate_hz: float
    scales: tuple[Scale, ...]


@dataclass(frozen=True, slots=True)
class BenchArmed(Event, kind="Armed"):
    """The source is at measured rest; the operator confirmed high voltage, or it stays off if not needed."""

    high_voltage: bool = True
    way_to_rest_s: float = math.nan
    """Predicted duration of the way to rest from the farthest level; NaN if unknown."""
    safety: str = ""
    """Time to rest after a stop, and after the death of program and watchdog; empty without high voltage."""


@dataclass(frozen=True, slots=True)
class BlockStored(Event, kind="BlockTaken"):
    """A block is in the file; `row` is the file's row of its first scan."""

    block: Block
    row: int


@dataclass(frozen=True, slots=True)
class BlockDiscarded(Event, kind="BlockSeen"):
    """A block read while waiting for the operator; published, never stored."""

    block: Block


INTERFERENCE_AT_REST = "interference_at_rest"
"""Name of the estimate of the largest line in the displacement at rest, which every run has."""


@dataclass(frozen=True, slots=True)
class InterferenceMeasured(Event, kind="InterferenceMeasured"):
    """The displacement at rest was recorded in these rows of the file and searched for hum and other lines.

    `lines` has the significant lines, the largest first.
    """

    rows: tuple[int, int]
    lines: tuple[InterferenceLine, ...] = ()


@dataclass(frozen=True, slots=True)
class EntryStarted(Event, kind="EntryBegan"):
    """An entry of the plan is being measured; `index` counts the plan's entries from 0."""

    index: int
    label: str
    key: tuple[float | str, ...]


@dataclass(frozen=True, slots=True)
class DriveStarted(Event, kind="Playing"):
    """The guard admitted a drive and the source started it."""

    drive: Drive


@dataclass(frozen=True, slots=True)
class SettlingFinished(Event, kind="SettleEnded"):
    """The wait before a recording is over: response steady, time limit reached, or fixed wait passed."""

    settled: bool
    after_s: float


@dataclass(frozen=True, slots=True)
class CyclesInterrupted(Event, kind="CyclesInterrupted"):
    """A block of cycles was interrupted; its entry continues with the cycles that are left."""

    entry: int
    driven: CycleStatistics


@dataclass(frozen=True, slots=True)
class RecordingFinished(Event, kind="Recorded"):
    """A recording under a drive is complete: these rows of the file."""

    index: int
    rows: tuple[int, int]
    quality: int
    drive: Drive
    entry: int = 0


@dataclass(frozen=True, slots=True)
class PointMeasured(Event, kind="PointMeasured"):
    """A point is in the file, as row `index`; `replaces` is the row of an earlier one of the same entry."""

    index: int
    point: Any
    entry: int = 0
    replaces: int | None = None


@dataclass(frozen=True, slots=True)
class SeriesReady(Event, kind="SeriesReady"):
    """A series of an entry, such as a frequency response; published after its point, and again after a repeat.

    Published, never stored as an event: the series are written when the run ends.
    """

    series: Series


@dataclass(frozen=True, slots=True)
class RunPaused(Event, kind="Paused"):
    """The run is paused at measured rest; high voltage is unchanged."""

    words: str
    high_voltage: bool = True


@dataclass(frozen=True, slots=True)
class RunResumed(Event, kind="Resumed"):
    """The run is resumed with the interrupted entry."""


@dataclass(frozen=True, slots=True)
class ProgressUpdated(Event, kind="Progressed"):
    """`done` of `entries` are finished; about `left_s` of bench time remain. `label` is the present entry, `then` the next one."""

    done: int
    entries: int
    left_s: float
    label: str
    then: str = ""


@dataclass(frozen=True, slots=True)
class PromptShown(Event, kind="Asked"):
    """The operator is asked to act."""

    ask_id: int
    prompt: Prompt


@dataclass(frozen=True, slots=True)
class PromptAnswered(Event, kind="Answered"):
    """The operator has answered."""

    ask_id: int
    words: str


MOUNTED_PARTS = {
    "mass": "mass glued",
    "plate": "plate clamped",
    "membrane": "membrane put on",
    "laser": "laser moved",
}
"""Parts that can be mounted anew, with their titles."""

MOUNTING_ACTIONS = {"fix-mass": "mass", "place-tactor": "laser", "stretch-membrane": "membrane"}
"""Parts by the action of the prompt that mounts them."""

MOUNTED = "mounted"
"""Number of a prompt for the specimen's own mass, which is glued; other masses are added to it, and taken off again."""

UNCHANGED = "unchanged"
"""Answer to a prompt for a part that is mounted already."""


@dataclass(frozen=True, slots=True)
class SpecimenMounted(Event, kind="Mounted"):
    """A part of the set-up was mounted anew; until the next mounting of the part all runs are of this one.

    Attributes:
        part: one of `MOUNTED_PARTS`.
        time: ISO 8601, UTC; with the part it identifies the mounting.
        who: name of the operator; empty if unknown.
        values: numbers of the prompt, SI, such as the mass.
    """

    part: str
    time: str
    who: str = ""
    values: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def now(cls, part: str, who: str, values: Mapping[str, float] | None = None) -> "SpecimenMounted":
        """Return a mounting at the present time."""
        return cls(part, datetime.now(UTC).isoformat(timespec="milliseconds"), who, dict(values or {}))

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "SpecimenMounted":
        """Return the mounting of a JSON object.

        Raises:
            LookupError, TypeError, ValueError: it is none.
        """
        if record["part"] not in MOUNTED_PARTS:
            raise ValueError(f"there is no part '{record['part']}'; the parts are {', '.join(MOUNTED_PARTS)}")
        datetime.fromisoformat(str(record["time"]))
        values = {str(name): float(value) for name, value in dict(record.get("values", {})).items()}
        return cls(str(record["part"]), str(record["time"]), str(record.get("who", "")), values)

    @classmethod
    def by_prompt(cls, prompt: Prompt, answer: str, who: str) -> "SpecimenMounted | None":
        """Return the mounting by an answered prompt; None for another prompt, and for a part that was mounted already."""
        part = MOUNTING_ACTIONS.get(prompt.action)
        if part is None or answer != prompt.choices[0] or (part == "mass" and not prompt.values.get(MOUNTED)):
            return None
        return cls.now(part, who, prompt.values)


def last_mountings(mountings: Iterable[SpecimenMounted]) -> tuple[SpecimenMounted, ...]:
    """Return the last mounting of each part, of mountings in the order of time."""
    return tuple({each.part: each for each in mountings}.values())


@dataclass(frozen=True, slots=True)
class LogMessage(Event, kind="Noted"):
    """A log message."""

    text: str


@dataclass(frozen=True, slots=True)
class StopOffered(Event, kind="StopOffered"):
    """The present run can be stopped from a phone at this address. Published, never stored: the address has the token."""

    url: str


@dataclass(frozen=True, slots=True)
class StopRequested(Event, kind="StopRequested"):
    """A stop that was not requested by the operator at the bench."""

    by: str
    """Who requested it, as in `a phone at 192.168.1.20`."""


@dataclass(frozen=True, slots=True)
class LevelExceeded(Event, kind="LevelExceeded"):
    """An abort level was exceeded; the points of the entry are flagged, and `action` follows."""

    level: str
    """Name in the table [levels] of the bench file, or of a figure of the protocol with a limit."""
    time_s: float
    """End of the block that exceeded the level, seconds since the start of the acquisition; NaN for a figure."""
    channel: str
    value: float
    limit: float
    unit: str
    """Unit of value and limit."""
    action: str
    """`warning`, `ask` or `rest`."""
    words: str


@dataclass(frozen=True, slots=True)
class DriveReadbackChanged(Event, kind="DriveReadback"):
    """The card no longer sees the commanded drive at the amplifier's input, or sees it again; published, never stored.

    It follows from the comparison of the abort level `drive`, even if that level is off or muted. `low_v` and `high_v` are the
    lowest and highest volts of the block. A loss is published for two blocks, because the first may contain the moment of the
    loss.
    """

    lost: bool
    low_v: float
    high_v: float


@dataclass(frozen=True, slots=True)
class InjectedFaultChanged(Event, kind="FaultSwitched"):
    """Injection or end of a fault of a simulated bench."""

    fault: str
    """Its name."""
    words: str
    """Its effect."""
    broken: bool


@dataclass(frozen=True, slots=True)
class ShutdownStarted(Event, kind="GoingToRest"):
    """The shutdown has started; no further measurement.

    `wait_s` is the longest time without a change of the output: the natural end of its drive, and the replies of the source.
    """

    wait_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SpecimenMayBeLive(Event, kind="MayBeLive"):
    """A start, arming or an answer failed while high voltage may be on; the source is brought to rest next.

    `low_v` and `high_v` are the lowest and highest volts at the amplifier's input in the card's last block, NaN if there was
    none or if it is too old to count; `words` has the reason and the manual steps, `part` is the instrument that failed
    (`generator`, `card` or empty), and `age_s` the age of the block in real seconds.
    """

    low_v: float
    high_v: float
    words: str
    part: str = ""
    age_s: float = math.inf


@dataclass(frozen=True, slots=True)
class RestMeasured(Event, kind="AtRest"):
    """The drive as measured by the card at the end."""

    confirmed: bool
    measured_v: float
    words: str


@dataclass(frozen=True, slots=True)
class RunEnded(Event, kind="RunEnded"):
    """The last event of every run, even if the disk is full. `estimates` are the identified quantities.

    `status` and `reason` state the end of the run, `verdict` whether its result is usable.
    """

    status: RunStatus
    reason: str
    path: str
    estimates: tuple[Any, ...] = ()
    verdict: Verdict = field(default_factory=Verdict)
    """The given outcome; otherwise the status of a stopped, failed or unsafe run, or not judged."""
    hints: tuple[str, ...] = ()
    """The protocol's warnings about the points."""

    def __post_init__(self) -> None:
        if self.verdict.outcome is Outcome.NOT_JUDGED and self.status is not RunStatus.COMPLETED:
            object.__setattr__(self, "verdict", Verdict.of_status(self.status, self.reason))

    @property
    def summary(self) -> str:
        """Outcome, reasons and end of the run, as a line."""
        return self.verdict.describe(self.reason)


def event_record(event: Any) -> dict[str, Any]:
    """Return the fields of an event (any frozen dataclass) as JSON types, for the file and for `--json`."""
    values = ((each.name, getattr(event, each.name)) for each in fields(event))
    return {name: to_jsonable(as_record(value) if isinstance(value, Drive) else value) for name, value in values}


log = logging.getLogger(__name__)

Observer = Callable[[Any], object]


class EventBus:
    """Delivers each event to all observers, in the order of their subscription.

    An observer's exception is logged and reaches neither the publisher nor the other observers.
    """

    def __init__(self, *observers: Observer) -> None:
        self._observers = list(observers)

    def subscribe(self, observer: Observer) -> None:
        """Add an observer; it is called in the publisher's thread."""
        self._observers.append(observer)

    def publish(self, event: Any) -> None:
        """Deliver an event."""
        for observer in self._observers:
            try:
                observer(event)
            except Exception:
                log.exception("an observer failed on %s", event.kind)
