"""Run events: frozen values, stored in the run file first and then published to the observers."""

import math
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, get_args

from drivers import Block, Drive, Scale, as_record
from protocols.base.jsonable import to_jsonable
from protocols.base.records import InterferenceLine, Series
from protocols.base.steps import Prompt
from protocols.base.verdict import Outcome, RunStatus, Verdict


@dataclass(frozen=True, slots=True)
class RunStarted:
    """The run file exists; nothing has moved yet."""

    kind: ClassVar[str] = "RunStarted"
    protocol: str
    path: str
    expected_s: float
    entries: int
    simulated: bool


@dataclass(frozen=True, slots=True)
class StreamStarted:
    """The acquisition has started."""

    kind: ClassVar[str] = "StreamStarted"
    rate_hz: float
    scales: tuple[Scale, ...]


@dataclass(frozen=True, slots=True)
class BenchArmed:
    """The source is at measured rest; the operator confirmed high voltage, or it stays off if not needed."""

    kind: ClassVar[str] = "Armed"
    high_voltage: bool = True
    way_to_rest_s: float = math.nan
    """Predicted duration of the way to rest from the farthest level; NaN if unknown."""
    safety: str = ""
    """How soon the bench is at rest after a stop, and after the death of program and watchdog; empty without high voltage."""


@dataclass(frozen=True, slots=True)
class BlockStored:
    """A block is in the file; `row` is the file's row of its first scan."""

    kind: ClassVar[str] = "BlockTaken"
    block: Block
    row: int


@dataclass(frozen=True, slots=True)
class BlockDiscarded:
    """A block read while waiting for the operator; published, never stored."""

    kind: ClassVar[str] = "BlockSeen"
    block: Block


INTERFERENCE_AT_REST = "interference_at_rest"
"""Name of the largest line in the displacement at rest, which every run estimates beside its own quantities."""


@dataclass(frozen=True, slots=True)
class InterferenceMeasured:
    """The displacement at rest was recorded in these rows of the file and searched for hum and other lines.

    `lines` has the significant ones, the largest first.
    """

    kind: ClassVar[str] = "InterferenceMeasured"
    rows: tuple[int, int]
    lines: tuple[InterferenceLine, ...] = ()


@dataclass(frozen=True, slots=True)
class EntryStarted:
    """An entry of the plan is being measured; `index` counts the plan's entries from 0."""

    kind: ClassVar[str] = "EntryBegan"
    index: int
    label: str
    key: tuple[float | str, ...]


@dataclass(frozen=True, slots=True)
class DriveStarted:
    """The guard admitted a drive and the source started it."""

    kind: ClassVar[str] = "Playing"
    drive: Drive


@dataclass(frozen=True, slots=True)
class SettlingFinished:
    """The wait before a recording is over: response steady, time limit reached, or fixed wait passed."""

    kind: ClassVar[str] = "SettleEnded"
    settled: bool
    after_s: float


@dataclass(frozen=True, slots=True)
class RecordingFinished:
    """A recording under a drive is complete: these rows of the file."""

    kind: ClassVar[str] = "Recorded"
    index: int
    rows: tuple[int, int]
    quality: int
    drive: Drive
    entry: int = 0


@dataclass(frozen=True, slots=True)
class PointMeasured:
    """A point is in the file, as row `index`; `replaces` is the row of an earlier one of the same entry."""

    kind: ClassVar[str] = "PointMeasured"
    index: int
    point: Any
    entry: int = 0
    replaces: int | None = None


@dataclass(frozen=True, slots=True)
class SeriesReady:
    """An entry gave a series, such as a frequency response; published after its point, and again after a repeat.

    Published, never stored as an event: the series are written when the run ends.
    """

    kind: ClassVar[str] = "SeriesReady"
    series: Series


@dataclass(frozen=True, slots=True)
class RunPaused:
    """The run is paused at measured rest; high voltage is unchanged."""

    kind: ClassVar[str] = "Paused"
    words: str
    high_voltage: bool = True


@dataclass(frozen=True, slots=True)
class RunResumed:
    """The run is resumed with the interrupted entry."""

    kind: ClassVar[str] = "Resumed"


@dataclass(frozen=True, slots=True)
class ProgressUpdated:
    """`done` of `entries` are finished; about `left_s` of bench time remain."""

    kind: ClassVar[str] = "Progressed"
    done: int
    entries: int
    left_s: float
    label: str


@dataclass(frozen=True, slots=True)
class PromptShown:
    """The operator is asked to act."""

    kind: ClassVar[str] = "Asked"
    ask_id: int
    prompt: Prompt


@dataclass(frozen=True, slots=True)
class PromptAnswered:
    """The operator has answered."""

    kind: ClassVar[str] = "Answered"
    ask_id: int
    words: str


@dataclass(frozen=True, slots=True)
class LogMessage:
    """A log message."""

    kind: ClassVar[str] = "Noted"
    text: str


@dataclass(frozen=True, slots=True)
class LevelExceeded:
    """An abort level was exceeded; the points of the entry are flagged, and `action` follows."""

    kind: ClassVar[str] = "LevelExceeded"
    level: str
    """Its name in the table [levels] of the bench file."""
    time_s: float
    """End of the block in which it was found, seconds since the acquisition started."""
    channel: str
    value: float
    limit: float
    unit: str
    """Of value and limit."""
    action: str
    """`warning`, `ask` or `rest`."""
    words: str


@dataclass(frozen=True, slots=True)
class DriveReadbackChanged:
    """The card no longer sees the commanded drive at the amplifier's input, or sees it again; published, never stored.

    It follows from the comparison of the abort level `drive`, also where that level is off or muted. `low_v` and `high_v`
    are the lowest and highest volts of the block. A loss is published for two blocks, because the first may contain the
    moment of the loss.
    """

    kind: ClassVar[str] = "DriveReadback"
    lost: bool
    low_v: float
    high_v: float


@dataclass(frozen=True, slots=True)
class InjectedFaultChanged:
    """A fault of a simulated bench was injected or cleared."""

    kind: ClassVar[str] = "FaultSwitched"
    fault: str
    """Its name."""
    words: str
    """Its effect."""
    broken: bool


@dataclass(frozen=True, slots=True)
class ShutdownStarted:
    """The shutdown has started; nothing is measured any more."""

    kind: ClassVar[str] = "GoingToRest"


@dataclass(frozen=True, slots=True)
class SpecimenMayBeLive:
    """A start, arming or an answer failed while high voltage may be on; the source is brought to rest next.

    `low_v` and `high_v` are the lowest and highest volts at the amplifier's input in the card's last block, NaN if there was
    none; `words` has the reason and the manual steps.
    """

    kind: ClassVar[str] = "MayBeLive"
    low_v: float
    high_v: float
    words: str


@dataclass(frozen=True, slots=True)
class RestMeasured:
    """The drive as measured by the card at the end."""

    kind: ClassVar[str] = "AtRest"
    confirmed: bool
    measured_v: float
    words: str


@dataclass(frozen=True, slots=True)
class RunEnded:
    """The last event of every run, even if the disk is full. `estimates` are the identified quantities.

    `status` and `reason` state how it ended, `verdict` whether its result is usable.
    """

    kind: ClassVar[str] = "RunEnded"
    status: RunStatus
    reason: str
    path: str
    estimates: tuple[Any, ...] = ()
    verdict: Verdict = field(default_factory=Verdict)
    """Where none is given: the status of a run that was stopped, failed or ended unsafe; else not judged."""
    hints: tuple[str, ...] = ()
    """The protocol's warnings about the points."""

    def __post_init__(self) -> None:
        if self.verdict.outcome is Outcome.NOT_JUDGED and self.status is not RunStatus.COMPLETED:
            object.__setattr__(self, "verdict", Verdict.of_status(self.status, self.reason))

    @property
    def summary(self) -> str:
        """Outcome, reasons and how the run ended, as a line."""
        return self.verdict.describe(self.reason)


Event = (
    RunStarted
    | StreamStarted
    | BenchArmed
    | InterferenceMeasured
    | EntryStarted
    | BlockStored
    | BlockDiscarded
    | DriveStarted
    | SettlingFinished
    | RecordingFinished
    | PointMeasured
    | SeriesReady
    | RunPaused
    | RunResumed
    | ProgressUpdated
    | PromptShown
    | PromptAnswered
    | LogMessage
    | LevelExceeded
    | DriveReadbackChanged
    | InjectedFaultChanged
    | ShutdownStarted
    | SpecimenMayBeLive
    | RestMeasured
    | RunEnded
)

EVENTS: dict[str, type[Event]] = {event.kind: event for event in get_args(Event)}
"""Event types by the name that run files and `--json` use; a `kind` never changes once it was released."""


def event_record(event: Any) -> dict[str, Any]:
    """Return the fields of an event (any frozen dataclass) as JSON types, for the file and for `--json`."""
    values = {field.name: getattr(event, field.name) for field in fields(event)}
    return {
        name: to_jsonable(as_record(value) if isinstance(value, Drive) else value) for name, value in values.items()
    }
