"""Window state as one frozen value with its texts, and the commands that change it."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Any

from app.session.messages import LogLine
from app.session.session import SessionEvent
from drivers import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, SquareWave, Steps
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
    DRIVE_LOST = "drive lost"
    """The card sees another voltage at the amplifier's input than the drive."""
    PAUSED = "paused"
    """At measured rest, high voltage still on."""
    HV_OFF = "hv off"
    """Rest is measured and the operator has switched high voltage off: the specimen may be touched."""
    GOING_TO_REST = "going to rest"
    AT_REST = "at rest"
    UNSAFE = "unsafe"
    NO_BENCH = "no bench"


ENERGIZED = (BenchState.LIVE, BenchState.DRIVE_LOST)
"""States of a run with high voltage on."""


class Lamp(StrEnum):
    """Status of an instrument."""

    WAITING = "connecting"
    READY = "ready"
    SUSPECT = "see the message"
    MISSING = "not connected"


@dataclass(frozen=True, slots=True)
class InstrumentStatus:
    """One instrument of the status bar."""

    role: str
    identity: str
    lamp: Lamp


@dataclass(frozen=True, slots=True)
class RunProgress:
    """Progress of a run. `updated_at_s` is the bench time streamed at this update."""

    title: str
    entries: int
    expected_s: float
    done: int = 0
    remaining_s: float = 0.0
    label: str = ""
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
    """The operator pressed Run."""

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
    """An event, the time it was received, and the bench time streamed by then."""

    event: WindowEvent
    time: datetime
    streamed_s: float = 0.0


@dataclass(frozen=True, slots=True)
class WindowState:
    """Everything the window shows except the samples."""

    amplifier: AmplifierMap
    bench_name: str
    simulated: bool
    instruments: tuple[InstrumentStatus, ...]
    bench_state: BenchState = BenchState.CONNECTING
    connected: bool = False
    """The instruments answered at the last connection."""
    busy: bool = False
    """A run was requested and has not ended."""
    pause_requested: bool = False
    """A pause was requested and has not begun."""
    paused: bool = False
    protocol: str = ""
    """Name of the protocol of the present or last run."""
    high_voltage: bool = True
    """Whether high voltage is on in the present run."""
    drive: Drive | None = None
    rest: RestMeasured | None = None
    """The last rest measurement; None before the first."""
    seen_v: tuple[float, float] | None = None
    """Lowest and highest volts that the card saw last at the amplifier's input, where they are not the drive's."""
    may_be_live: bool = False
    """The specimen may be live although the program goes to rest; until rest is measured."""
    rest_lost: bool = False
    """Rest was not confirmed, and has not been measured since."""
    progress: RunProgress | None = None
    prompt: PromptShown | None = None
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
    def can_run(self) -> bool:
        return self.connected and not self.busy and not self.unsafe

    @property
    def blocked_reason(self) -> str:
        """Why no run can begin; empty if one can."""
        if self.busy:
            return "a run is in progress"
        if self.unsafe:
            return "read and acknowledge the message first"
        return "" if self.connected else "there is no bench"

    @property
    def can_pause(self) -> bool:
        return self.busy and self.bench_state in (*ENERGIZED, BenchState.HV_OFF, BenchState.PAUSED)

    @property
    def voltage_text(self) -> str:
        """Voltage on the specimen as text."""
        match self.bench_state:
            case BenchState.LIVE if self.drive is not None:
                low, high = self.amplifier.specimen_v([self.drive.low_v, self.drive.high_v])
                return format_voltage_range(float(low), float(high))
            case BenchState.LIVE | BenchState.AT_REST | BenchState.PAUSED | BenchState.HV_OFF:
                return "0 V"
            case BenchState.GOING_TO_REST if not self.may_be_live:
                return "to 0 V"
            case BenchState.UNSAFE | BenchState.DRIVE_LOST | BenchState.GOING_TO_REST if self.seen_v is not None:
                low, high = self.amplifier.specimen_v(self.seen_v)
                return f"about {format_voltage_range(float(low), float(high))}"
            case BenchState.IDLE | BenchState.ARMING:
                return "not measured"
            case _:
                return "unknown"

    @property
    def voltage_note(self) -> str:
        """Note below the voltage."""
        match self.bench_state:
            case BenchState.LIVE:
                return (
                    f"on the specimen, {describe_drive(self.drive)}"
                    if self.drive
                    else "on the specimen, high voltage on"
                )
            case BenchState.PAUSED:
                return "rest measured, high voltage still on"
            case BenchState.HV_OFF:
                return f"{'paused; ' * self.paused}rest measured, high voltage off"
            case BenchState.AT_REST if self.rest is not None:
                return f"on the specimen; input at {self.rest.measured_v:.3f} V"
            case BenchState.GOING_TO_REST if self.may_be_live:
                return "may be live: switch the high voltage OFF at the amplifier now"
            case BenchState.GOING_TO_REST:
                return "rest is measured next"
            case BenchState.IDLE:
                return "every run measures rest first"
            case BenchState.ARMING:
                return "rest is not measured yet"
            case BenchState.UNSAFE | BenchState.DRIVE_LOST if self.seen_v is not None:
                seen = " … ".join(dict.fromkeys(f"{round(v, 3) + 0.0:.3f}" for v in self.seen_v))
                return f"if the high voltage is on; the card sees {seen} V"
            case BenchState.UNSAFE:
                return "may carry high voltage"
            case _:
                return "volts on the specimen"

    @property
    def exit_code(self) -> int:
        """Exit code of the program: 3 unsafe, 1 failed or no bench, else 0."""
        if self.bench_state is BenchState.UNSAFE or self.rest_lost:
            return UNSAFE_EXIT
        failed = self.outcome is not None and self.outcome.status is RunStatus.FAILED
        return int(failed or self.bench_state is BenchState.NO_BENCH)


def initial_window_state(amplifier: AmplifierMap, bench: str, simulated: bool, names: Mapping[str, str]) -> WindowState:
    """Return the state before the first event; `names` are the instruments' names in the bench file, by role."""
    return WindowState(
        amplifier, bench, simulated, tuple(InstrumentStatus(r, n, Lamp.WAITING) for r, n in names.items())
    )


def format_voltage_range(low: float, high: float) -> str:
    """`−500 … +1500 V`, `0 V`."""
    figures = [("0" if abs(v) < 0.5 else f"{v:+.0f}").replace("-", "−") for v in (low, high)]
    return f"{figures[0]} V" if figures[0] == figures[1] else f"{figures[0]} … {figures[1]} V"


def describe_drive(drive: Drive) -> str:
    """Describe the frequency of a drive: `160 Hz`, `25 … 525 Hz`, `held`."""
    match drive:
        case Sine(frequency_hz=f) | SquareWave(frequency_hz=f):
            return f"{f:g} Hz"
        case LinearSweep(start_hz=a, stop_hz=b) | PeriodicSweep(start_hz=a, stop_hz=b):
            return f"{a:g} … {b:g} Hz"
        case Hold():
            return "held"
        case Ramp() | Steps():
            return drive.kind.lower()
