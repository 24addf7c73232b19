"""What a protocol may ask of the runner: a closed union of steps, and what each is answered with."""

from dataclasses import dataclass
from typing import Any

from drivers.drive import Drive


@dataclass(frozen=True, slots=True)
class Settle:
    """Play a drive and watch until the response repeats from one window to the next. Answered with `Settled`.

    `window_s` is the length of one window (whole cycles of a sine), `tolerance` the relative change of the response
    between successive windows that counts as steady, `limit_s` the time after which waiting ends unsettled.
    """

    drive: Drive
    window_s: float
    tolerance: float
    limit_s: float


@dataclass(frozen=True, slots=True)
class Settled:
    """Whether the response became steady, and after how long."""

    settled: bool
    after_s: float


@dataclass(frozen=True, slots=True)
class Play:
    """Play a drive and let `wait_s` pass, whatever the response does. Answered with `Settled`."""

    drive: Drive
    wait_s: float


@dataclass(frozen=True, slots=True)
class Record:
    """Keep the next `duration_s` of samples under the drive that plays. Answered with a `Recording`."""

    duration_s: float


@dataclass(frozen=True, slots=True)
class Measured:
    """A point is finished: `point` is a frozen dataclass of annotated quantities, one row of the run's points."""

    point: Any


@dataclass(frozen=True, slots=True)
class Prompt:
    """Something only a person can do. `action` names it for a simulated operator; `text` is what a person reads."""

    action: str
    text: str


@dataclass(frozen=True, slots=True)
class Ask:
    """Wait until the operator has done what the prompt says. Answered with the operator's words."""

    prompt: Prompt


@dataclass(frozen=True, slots=True)
class Read:
    """One reading of a meter of the bench, by its name. Answered with a `Reading`."""

    meter: str


@dataclass(frozen=True, slots=True)
class Note:
    """A remark for the log and the file."""

    text: str


Step = Settle | Play | Record | Measured | Ask | Read | Note
