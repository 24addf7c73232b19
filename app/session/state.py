"""State of the bench and of the window as frozen values, and the commands that change it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum
from typing import Any

from app.session.messages import LogLine
from app.session.session import SessionEvent
from drivers import Drive
from model import AmplifierMap
from protocols.base import PromptShown, Quality, RestMeasured, RunEnded, RunStatus, Series

UNSAFE_EXIT = 3


class BenchState(StrEnum):
    """State of the bench in a word that can be read from two metres."""

    CONNECTING = "connecting"
    IDLE = "not armed"
    """The instruments answer; rest has not been measured yet."""
    ARMING = "arming"
    LIVE = "live"
    PAUSING = "pausing"
    """Live until the pause begins."""
    DRIVE_LOST = "drive lost"
    """The card sees another voltage at the amplifier's input than the drive, or than rest where rest is wanted."""
    PAUSED = "paused"
    """At measured rest, high voltage still on."""
    HV_OFF = "hv off"
    """Rest is measured and the operator has switched high voltage off: the specimen may be touched."""
    GOING_TO_REST = "going to rest"
    AT_REST = "at rest"
    UNSAFE = "unsafe"
    NO_BENCH = "no bench"


class Lamp(StrEnum):
    """Status of an instrument."""

    WAITING = "connecting"
    READY = "ready"
    SUSPECT = "see the message"
    MISSING = "not connected"


@dataclass(frozen=True, slots=True)
class InstrumentStatus:
    """One instrument of the status bar; `remark` is why it is suspect or waited for, empty where a message says it."""

    role: str
    identity: str
    lamp: Lamp
    remark: str = ""


ENERGIZED = (BenchState.LIVE, BenchState.PAUSED)
"""Phases of a run with high voltage on."""


@dataclass(frozen=True, slots=True)
class RunProgress:
    """Progress of a run. `updated_at_s` is the bench time streamed at this update."""

    title: str
    entries: int
    expected_s: float
    done: int = 0
    remaining_s: float = 0.0
    label: str = ""
    then: str = ""
    """Label of the entry after the present one; empty without one."""
    updated_at_s: float = 0.0

    def remaining_at(self, streamed_s: float) -> float:
        """Return the remaining bench time, counted down by the samples since the update; never past the present entry."""
        entry_s = self.expected_s / max(self.entries, 1)
        return max(self.remaining_s - min(max(streamed_s - self.updated_at_s, 0.0), entry_s), 0.0)

    def fraction_at(self, streamed_s: float) -> float:
        """Return the fraction that is done, 0 to 1."""
        return 1.0 - min(self.remaining_at(streamed_s) / self.expected_s, 1.0) if self.expected_s > 0 else 0.0


@dataclass(frozen=True, slots=True)
class RunRequested:
    """The operator pressed Run; the run waits while the bench is being connected."""

    title: str
    resumed_file: str = ""
    """File of the run to continue, which is read first; its points are shown until the new run begins."""


@dataclass(frozen=True, slots=True)
class CommissioningEnded:
    """A commissioning has ended, and the bench is connected again."""

    message: str
    passed: bool


class OperatorAction(StrEnum):
    """An action of the operator that has no further parameters."""

    PAUSE = "pause"
    """Pause at rest, or resume."""
    STOP = "stop"
    """Stop, or close the window."""
    ACKNOWLEDGE = "acknowledge"
    RECONNECT = "reconnect"
    """Open the bench again."""


WindowEvent = SessionEvent | RunRequested | CommissioningEnded | OperatorAction


@dataclass(frozen=True, slots=True)
class TimedEvent:
    """An event, the time it was received, the bench time streamed by then, and the same time on time.monotonic."""

    event: WindowEvent
    time: datetime
    streamed_s: float = 0.0
    at_s: float = 0.0


@dataclass(frozen=True, slots=True)
class WindowState:
    """Everything the window shows except the samples."""

    amplifier: AmplifierMap
    bench_name: str
    simulated: bool
    fitted: tuple[InstrumentStatus, ...]
    """The instruments as they were connected; see `instruments`."""
    phase: BenchState = BenchState.CONNECTING
    """State of the bench by the events of the program; see `bench_state`."""
    off_aim: bool = False
    """Whether the card sees another voltage at the amplifier's input than the drive, or than rest where rest is wanted."""
    suspects: frozenset[str] = frozenset()
    """Roles of the instruments at which a message has pointed, until the bench is armed again."""
    remarks: Mapping[str, str] = field(default_factory=dict)
    """Faults of instruments in the card's reading, by role."""
    unread: bool = False
    """Whether the card has not been read for a while although high voltage may be on."""
    warned: bool = False
    """Whether the program has warned that the specimen may be live, and has not measured rest since."""
    obey_by_s: float = math.inf
    """Time (time.monotonic) at which a bench that goes to rest must be on its way."""
    watched: bool = False
    """Whether the card is watched between runs."""
    connecting_since_s: float = math.nan
    """Time (time.monotonic) at which the bench was asked for last; NaN if unknown."""
    awaited: str = ""
    """Role of the instrument that is being opened; empty if none is."""
    connected: bool = False
    """The instruments answered at the last connection."""
    queued: str = ""
    """Title of the run that begins when the bench is connected."""
    busy: bool = False
    """A run was requested and has not ended."""
    pause_requested: bool = False
    """A pause was requested and has not begun."""
    paused: bool = False
    protocol: str = ""
    """Name of the protocol of the present or last run; empty from the request of a run until it begins."""
    high_voltage: bool | None = None
    """Whether high voltage is on, by the operator's answers in the present run; None where that is not known."""
    drive: Drive | None = None
    """The drive that is wanted; None where rest is."""
    rest: RestMeasured | None = None
    """The last rest measurement; None before the first."""
    rest_lost: bool = False
    """Rest was not confirmed, and has not been measured since."""
    progress: RunProgress | None = None
    prompt: PromptShown | None = None
    answered: int = 0
    """Prompts of the run that were answered."""
    points: tuple[Any, ...] = ()
    entries: tuple[int, ...] = ()
    """The entry of the plan each point belongs to."""
    curves: tuple[Series, ...] = ()
    """Curves of the entries; the newest of each entry, name and label."""
    outcome: RunEnded | None = None
    gain_uncertainty: float = 0.0
    """Relative standard uncertainty of the displacement sensor's gain."""
    unsafe: str = ""
    """The unsafe message, until it is acknowledged."""
    problem: str = ""
    """Reason of the last failure, until it is dismissed or a new run begins."""
    verdict_message: str = ""
    """Verdict on a run that is not good, its reasons line by line, until it is dismissed or a new run begins."""
    messages: tuple[LogLine, ...] = ()
    message_count: int = 0
    """Number of messages so far, including dropped ones."""

    @property
    def unusable(self) -> int:
        """Number of points that are not usable for fits."""
        flags = [Quality(point.quality) for point in self.points]
        return sum(not flag.usable and Quality.SUPERSEDED not in flag for flag in flags)

    @property
    def bench_state(self) -> BenchState:
        """State of the bench: the phase by the program's events, unless the card's reading contradicts it."""
        if self.off_aim and self.phase in (*ENERGIZED, BenchState.GOING_TO_REST, BenchState.AT_REST):
            return BenchState.DRIVE_LOST
        if self.phase is BenchState.LIVE and self.pause_requested:
            return BenchState.PAUSING
        return self.phase

    @property
    def instruments(self) -> tuple[InstrumentStatus, ...]:
        """The instruments; a connected one is suspect where a message or the card's reading indicates a fault in it."""
        remarks = {**self.remarks, **({"generator": "the card sees another voltage"} if self.off_aim else {})}

        def status(each: InstrumentStatus) -> InstrumentStatus:
            if each.lamp is Lamp.READY and (each.role in self.suspects or each.role in remarks):
                return replace(each, lamp=Lamp.SUSPECT, remark=remarks.get(each.role, ""))
            is_awaited = each.lamp is Lamp.WAITING and each.role == self.awaited
            return replace(each, remark="no answer yet") if is_awaited else each

        return tuple(map(status, self.fitted))

    @property
    def danger(self) -> bool:
        """Whether the specimen may carry a voltage that the program does not want."""
        strays = self.off_aim and self.phase is BenchState.IDLE and self.high_voltage is not False
        return strays or self.warned or self.unread or self.bench_state in (BenchState.UNSAFE, BenchState.DRIVE_LOST)

    @property
    def can_run(self) -> bool:
        return self.connected and not self.busy and not self.unsafe

    @property
    def can_queue(self) -> bool:
        """Whether a run may be requested that begins when the bench is connected."""
        connecting = not self.connected and any(each.lamp is Lamp.WAITING for each in self.fitted)
        return connecting and not (self.busy or self.unsafe or self.queued)

    @property
    def blocked_reason(self) -> str:
        """Why no run can begin now; empty if one can."""
        if self.busy:
            return "a run is in progress"
        if self.unsafe:
            return "read and acknowledge the message first"
        if self.queued:
            return f"{self.queued} begins when the bench is connected"
        if self.can_queue:
            return "the bench is still being connected"
        return "" if self.connected else "there is no bench"

    @property
    def can_pause(self) -> bool:
        return self.busy and self.phase in (*ENERGIZED, BenchState.HV_OFF)

    @property
    def exit_code(self) -> int:
        """Exit code of the program: 3 unsafe, 1 failed or no bench, else 0."""
        if self.phase is BenchState.UNSAFE or self.rest_lost:
            return UNSAFE_EXIT
        failed = self.outcome is not None and self.outcome.status is RunStatus.FAILED
        return int(failed or self.phase is BenchState.NO_BENCH)


def initial_window_state(amplifier: AmplifierMap, bench: str, simulated: bool, names: Mapping[str, str]) -> WindowState:
    """Return the state before the first event; `names` are the instruments' names in the bench file, by role."""
    return WindowState(
        amplifier, bench, simulated, tuple(InstrumentStatus(r, n, Lamp.WAITING) for r, n in names.items())
    )
