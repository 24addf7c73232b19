"""What a protocol may ask of the runner: a closed union of steps, and what each is answered with."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.deprecated import renamed
from drivers.drive import Drive


@dataclass(frozen=True, slots=True)
class Settle:
    """Play a drive and watch until the response repeats from one window to the next. Answered with `SettlingResult`.

    `window_s` is the length of one window (whole cycles of a sine), `tolerance` the relative change of the response
    between successive windows that counts as steady, `limit_s` the time after which waiting ends unsettled.
    """

    drive: Drive
    window_s: float
    tolerance: float
    limit_s: float


@dataclass(frozen=True, slots=True)
class SettlingResult:
    """Whether the response became steady, and after how long."""

    settled: bool
    after_s: float


@dataclass(frozen=True, slots=True)
class Play:
    """Play a drive and let `wait_s` pass, whatever the response does. Answered with `SettlingResult`."""

    drive: Drive
    wait_s: float


@dataclass(frozen=True, slots=True)
class Record:
    """Keep the next `duration_s` of samples, under the drive that plays or at rest. Answered with a `Recording`.

    With `drive`, that drive is begun once `lead_s` were recorded (one block at least), so that its start and what was
    before it are in the recording; `duration_s` counts from its beginning, which is the end of the ramp for a `Hold`.
    """

    duration_s: float
    drive: Drive | None = None
    lead_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Prompt:
    """Something only a person can do.

    Attributes:
        action: its name, for a simulated operator and for a drawing of the set-up.
        text: what a person reads.
        values: the action's numbers by name, for a simulated operator, e.g. `{"mass_kg": 0.05}`.
        choices: possible answers, the expected one first; each begins with another letter, its key.
        hands_on: whether the specimen must be touched; then rest is measured and high voltage switched off before,
            and both again before anything moves.
    """

    action: str
    text: str
    values: Mapping[str, float] = field(default_factory=dict)
    choices: tuple[str, ...] = ("done",)
    hands_on: bool = False


@dataclass(frozen=True, slots=True)
class Ask:
    """Wait until the operator has done what the prompt says. Answered with the operator's words."""

    prompt: Prompt


class Detector(Protocol):
    """Watches drive (V) and displacement (m), block by block, until it has seen what it looks for."""

    def feed(self, drive_v: NDArray[np.float64], displacement_m: NDArray[np.float64]) -> bool:
        """Take more samples; True once it has seen it."""


@dataclass(frozen=True, slots=True)
class WaitForDetection:
    """Show a prompt and watch the laser until `detector` has seen what was asked for, or the operator answers.

    Answered with `DetectionResult`. What the card sees meanwhile is not kept: a person may take an hour.
    """

    prompt: Prompt
    detector: Detector


@renamed(seen="detected", words="answer")
@dataclass(frozen=True, slots=True)
class DetectionResult:
    """How an `WaitForDetection` ended: seen by the laser (`words` is None), or answered by the operator."""

    detected: bool
    answer: str | None


@dataclass(frozen=True, slots=True)
class ReadMeter:
    """One reading of a meter of the bench, by its name. Answered with a `Reading`."""

    meter: str


@dataclass(frozen=True, slots=True)
class Log:
    """A remark for the log and the file."""

    text: str


Step = Settle | Play | Record | Ask | WaitForDetection | ReadMeter | Log


class Repeat(Enum):
    """What `Protocol.measure` may return to have something measured again."""

    THIS = "this entry"
    PREVIOUS = "the entry before, then this one"


StepResult = Any
"""What a step is answered with, as its docstring says."""
