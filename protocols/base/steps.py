"""Steps: requests of a protocol to the runner, and the result of each; prompts and the operator's interface."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Protocol

from drivers import Drive, Sine
from model import Array


@dataclass(frozen=True, slots=True)
class Settle:
    """Play a drive until the response repeats from one window to the next. Returns `SettlingResult`.

    `window_s` is the length of one window (whole cycles of a sine), `tolerance` the relative change of the response
    between successive windows that counts as steady, `limit_s` the time after which waiting ends unsettled.
    """

    drive: Drive
    window_s: float
    tolerance: float
    limit_s: float


@dataclass(frozen=True, slots=True)
class SettlingResult:
    """Whether the response became steady, and its settling time."""

    settled: bool
    after_s: float


@dataclass(frozen=True, slots=True)
class Play:
    """Play a drive for `wait_s`, independent of the response. Returns `SettlingResult`."""

    drive: Drive
    wait_s: float


@dataclass(frozen=True, slots=True)
class Record:
    """Record `duration_s` of samples under the current drive or at rest. Returns a `Recording`.

    With `drive`, that drive starts once `lead_s` are recorded (one block at least), so that its start is in the
    recording; `duration_s` counts from its start, which is the end of the ramp for a `Hold`.
    """

    duration_s: float
    drive: Drive | None = None
    lead_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Cycle:
    """Play a sine to its end, count its cycles, store its first `keep_s`, then wait at rest. Returns a `Recording` with `cycles`.

    After an interruption only the cycles that are left are played.
    """

    drive: Sine
    keep_s: float
    rest_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Prompt:
    """An action for the operator.

    Attributes:
        action: name of the action, for a simulated operator and a drawing of the set-up.
        text: text for the operator.
        values: the action's numbers by name, for a simulated operator, e.g. `{"mass_kg": 0.05}`.
        choices: possible answers, the expected one first; each has a different initial letter, its key.
        hands_on: whether the specimen must be touched; rest is then measured and high voltage switched off before,
            and both are checked again before anything moves.
    """

    action: str
    text: str
    values: Mapping[str, float] = field(default_factory=dict)
    choices: tuple[str, ...] = ("done",)
    hands_on: bool = False


@dataclass(frozen=True, slots=True)
class Ask:
    """Wait for the operator. Returns the operator's answer."""

    prompt: Prompt


class Detector(Protocol):
    """Detects an event in drive (V) and displacement (m), block by block."""

    def feed(self, drive_v: Array, displacement_m: Array) -> bool:
        """Process samples; return True once the event is detected."""


@dataclass(frozen=True, slots=True)
class WaitForDetection:
    """Show a prompt and wait until `detector` detects the action, or the operator answers.

    Returns `DetectionResult`. The samples are not stored: the operator may need an hour.
    """

    prompt: Prompt
    detector: Detector


@dataclass(frozen=True, slots=True)
class DetectionResult:
    """Result of `WaitForDetection`: detected by the laser (`answer` is None), or answered by the operator."""

    detected: bool
    answer: str | None


@dataclass(frozen=True, slots=True)
class ReadMeter:
    """Read a meter of the bench by its name. Returns a `Reading`."""

    meter: str


@dataclass(frozen=True, slots=True)
class Log:
    """Write a message to the log and the file."""

    text: str


Step = Settle | Play | Record | Cycle | Ask | WaitForDetection | ReadMeter | Log


class Repeat(Enum):
    """Request to measure again, returned by `Protocol.measure`."""

    THIS = "this entry"
    PREVIOUS = "the entry before, then this one"


StepResult = Any
"""Result of a step, as in its docstring."""


class Operator(Protocol):
    """Shows prompts and is polled for answers. Ids are unique, so that a stale answer is never mistaken for a new one.

    An operator may have a property `unreachable_reason`, a text that is empty while an answer is possible; otherwise an abort
    level with the action "ask" ends the run at rest.
    """

    def show(self, ask_id: int, prompt: Prompt) -> None:
        """Show a prompt; must not wait."""

    def answer(self, ask_id: int) -> str | None:
        """Return the answer, or None before it was given. Called many times a second; must not wait."""


DISABLE_HIGH_VOLTAGE = Prompt(
    "disable-high-voltage", "Switch the amplifier's high voltage OFF. The generator's output is about to come up."
)
ENABLE_HIGH_VOLTAGE = Prompt(
    "enable-high-voltage",
    "Rest is measured at the amplifier's input. Hands off the specimen; the amplifier's high voltage must be ON now.",
)
