"""What happens in a run, as values: stored first, then told to every observer, in this order."""

from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any, ClassVar, get_args

from drivers.drive import Drive, as_record
from drivers.interfaces import Block, Scale
from protocols.base.jsonable import to_jsonable
from protocols.base.records import ResultCurve
from protocols.base.steps import Prompt


class RunStatus(StrEnum):
    """How a run stands. A file that still says `running` while its program is gone tells of a crash."""

    RUNNING = "running"
    COMPLETED = "completed"
    STOPPED = "stopped"
    FAILED = "failed"
    UNSAFE = "unsafe"


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
    """The card runs."""

    kind: ClassVar[str] = "StreamStarted"
    rate_hz: float
    scales: tuple[Scale, ...]


@dataclass(frozen=True, slots=True)
class BenchArmed:
    """The source rests, as measured; high voltage is on, says the operator, or stays off where none is needed."""

    kind: ClassVar[str] = "Armed"
    high_voltage: bool = True


@dataclass(frozen=True, slots=True)
class BlockStored:
    """A block is in the file; `row` is the file's row of its first scan."""

    kind: ClassVar[str] = "BlockTaken"
    block: Block
    row: int


@dataclass(frozen=True, slots=True)
class BlockDiscarded:
    """A block that nobody keeps, taken while a person takes their time. Told, never stored."""

    kind: ClassVar[str] = "BlockSeen"
    block: Block


@dataclass(frozen=True, slots=True)
class EntryStarted:
    """An entry of the plan is being measured; `index` counts the plan's entries from 0."""

    kind: ClassVar[str] = "EntryBegan"
    index: int
    label: str
    key: tuple[float | str, ...]


@dataclass(frozen=True, slots=True)
class DriveStarted:
    """The guard admitted a drive and the source began it."""

    kind: ClassVar[str] = "Playing"
    drive: Drive


@dataclass(frozen=True, slots=True)
class SettlingFinished:
    """The wait before a recording is over: the response became steady, the limit came first, or a fixed wait has passed."""

    kind: ClassVar[str] = "SettleEnded"
    settled: bool
    after_s: float


@dataclass(frozen=True, slots=True)
class RecordingFinished:
    """Samples were kept under a drive: these rows of the file."""

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
class CurveReady:
    """An entry gave a curve, as a frequency response with its errors; told after its point and again if it is measured again.

    Told, never stored: a run's file gets its curves when it is finished, and its raw data has them always.
    """

    kind: ClassVar[str] = "CurveReady"
    curve: ResultCurve


@dataclass(frozen=True, slots=True)
class RunPaused:
    """Somebody paused the run: the source rests, as measured. High voltage is as the run has it."""

    kind: ClassVar[str] = "Paused"
    words: str
    high_voltage: bool = True


@dataclass(frozen=True, slots=True)
class RunResumed:
    """The run goes on, with the entry that was interrupted."""

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
    """A person must do something."""

    kind: ClassVar[str] = "Asked"
    ask_id: int
    prompt: Prompt


@dataclass(frozen=True, slots=True)
class PromptAnswered:
    """A person has answered."""

    kind: ClassVar[str] = "Answered"
    ask_id: int
    words: str


@dataclass(frozen=True, slots=True)
class LogMessage:
    """A remark."""

    kind: ClassVar[str] = "Noted"
    text: str


@dataclass(frozen=True, slots=True)
class InjectedFaultChanged:
    """Something of a simulated bench was broken on purpose, or mended: what a run measured then is a lesson."""

    kind: ClassVar[str] = "FaultSwitched"
    fault: str
    """Its name."""
    words: str
    """What it does."""
    broken: bool


@dataclass(frozen=True, slots=True)
class ShutdownStarted:
    """The way out has begun; nothing is measured any more."""

    kind: ClassVar[str] = "GoingToRest"


@dataclass(frozen=True, slots=True)
class RestMeasured:
    """What the card saw of the drive at the end."""

    kind: ClassVar[str] = "AtRest"
    confirmed: bool
    measured_v: float
    words: str


@dataclass(frozen=True, slots=True)
class RunEnded:
    """The last event of every run, also of one whose disk is full. `estimates` are what was identified."""

    kind: ClassVar[str] = "RunEnded"
    status: RunStatus
    reason: str
    path: str
    estimates: tuple[Any, ...] = ()


Event = (
    RunStarted
    | StreamStarted
    | BenchArmed
    | EntryStarted
    | BlockStored
    | BlockDiscarded
    | DriveStarted
    | SettlingFinished
    | RecordingFinished
    | PointMeasured
    | CurveReady
    | RunPaused
    | RunResumed
    | ProgressUpdated
    | PromptShown
    | PromptAnswered
    | LogMessage
    | InjectedFaultChanged
    | ShutdownStarted
    | RestMeasured
    | RunEnded
)

EVENTS: dict[str, type[Event]] = {event.kind: event for event in get_args(Event)}
"""Event types by the name that run files and `--json` use; a `kind` never changes once it was released."""


def event_record(event: Any) -> dict[str, Any]:
    """The fields of an event (any frozen dataclass) as plain values, for the file and for `--json`."""
    return {field.name: _field_to_jsonable(getattr(event, field.name)) for field in fields(event)}


def _field_to_jsonable(value: Any) -> Any:
    return to_jsonable(as_record(value) if isinstance(value, Drive) else value)
