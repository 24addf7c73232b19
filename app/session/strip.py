"""Strip: the bench's state, the measured volts with their age, the aim and the run, as every front end shows them."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from app.common import OUTCOME_SYMBOLS, format_duration, pluralize
from app.session.session import UNSEEN, Observation
from app.session.simulation import real_duration_s
from app.session.state import BenchState, WindowState
from drivers import (
    REST_TOLERANCE_V,
    CardReading,
    Drive,
    Hold,
    LinearSweep,
    PeriodicSweep,
    Ramp,
    Sine,
    SquareWave,
    Steps,
)
from model import AmplifierMap
from protocols.base import Outcome

if TYPE_CHECKING:
    from drivers import Bench

PRESENT_S, KNOWN_S = 0.5, 2.0
"""Largest age of volts shown as present, and of volts shown as a value; older volts are reported as the last reading."""

STEP_V = 5.0
"""Volts at the specimen: least difference that is shown as a range, and the steps in which its ends are shown."""

FRESH_S = 0.25
"""Ages up to this one are shown as 0.1 s: while blocks arrive, the text stays and nothing is painted."""

MONITOR_TOLERANCE, MONITOR_TOLERANCE_V = 0.1, 50.0
"""Largest difference between voltage monitor and amplifier's characteristic: share of the voltage, and at least so much."""

AIMS = {
    **dict.fromkeys((BenchState.CONNECTING, BenchState.IDLE, BenchState.NO_BENCH), ""),
    BenchState.ARMING: "measure rest, 0 V",
    BenchState.HV_OFF: "high voltage off, 0 V",
    BenchState.UNSAFE: "rest, not reached, 0 V",
}
"""What the program wants in a phase in which that is not a drive, and not simply rest."""


@dataclass(frozen=True, slots=True)
class RunLine:
    """The run in two lines, with the completed share, 0 to 1; `outcome` of the last run, None during a run."""

    title: str
    note: str
    fraction: float = 0.0
    outcome: Outcome | None = None


@dataclass(frozen=True, slots=True)
class StripView:
    """What a front end shows of the bench.

    Attributes:
        state: of the bench.
        danger: whether the specimen may carry a voltage that is not wanted: shown in red.
        measured: volts at the specimen as the card measured them last; `unknown` if that is long ago, empty without any.
        caption: where and when they were measured.
        age_s: their age in seconds; infinite without any.
        aim: what the program wants.
        act: what the operator has to do about the voltage; empty if nothing.
        run: the run.
        instruments: by role: why it is suspect or waited for, or its status; and when it answered last.

    Views are equal where their texts are: ages that no text shows do not count.
    """

    state: BenchState
    danger: bool
    measured: str
    caption: str
    age_s: float = field(compare=False)
    aim: str
    act: str
    run: RunLine
    instruments: Mapping[str, str] = field(default_factory=dict, compare=False)

    @property
    def present(self) -> bool:
        """Whether the volts are present."""
        return self.age_s <= PRESENT_S

    @property
    def note(self) -> str:
        """What stands below the volts."""
        return "; ".join(filter(None, (self.act, self.caption, self.aim and f"aim: {self.aim}")))


def strip_view(
    view: WindowState,
    seen: Observation = UNSEEN,
    now_s: float = 0.0,
    streamed_s: float = 0.0,
    bench: "Bench | None" = None,
) -> StripView:
    """Return the contents of the strip for a state.

    Args:
        view: the state.
        seen: what the instruments answered last.
        now_s: present time (time.monotonic).
        streamed_s: bench time of the samples since the stream began.
        bench: which is connected, for the speed of a simulated one.
    """
    answered_s = dict(seen.answered_s)
    if seen.card is not None:
        answered_s |= dict.fromkeys(
            ("card", "sensor") if seen.card.sensor_in_range else ("card",), seen.card.measured_s
        )
    instruments = {
        each.role: "; ".join(
            (
                each.remark or str(each.lamp),
                *(f"last answer {_age(now_s - at_s)}" for role, at_s in answered_s.items() if role == each.role),
            )
        )
        for each in view.instruments
    }
    measured, caption, age_s = _measured(view, seen.card, now_s)
    aim, act, run = _aim(view), _act(view), _run_line(view, streamed_s, bench, now_s)
    return StripView(view.bench_state, view.danger, measured, caption, age_s, aim, act, run, instruments)


def monitor_disagrees(reading: CardReading, amplifier: AmplifierMap) -> bool:
    """Whether a voltage monitor is wired and shows another voltage than follows from the amplifier's input."""
    computed = [float(v) for v in amplifier.specimen_v(reading.drive_v)]
    limit_v = max(MONITOR_TOLERANCE * max(map(abs, computed)), MONITOR_TOLERANCE_V)
    return any(abs(a - b) > limit_v for a, b in zip(reading.monitor_v or computed, computed, strict=True))


def is_off_rest(volts: tuple[float, float], amplifier: AmplifierMap) -> bool:
    """Whether lowest or highest volts at the amplifier's input are not rest."""
    return max(abs(v - amplifier.rest_v) for v in volts) > REST_TOLERANCE_V


def format_voltage_range(low: float, high: float) -> str:
    """`−500 … +1500 V`, `0 V`."""
    figures = [("0" if abs(v) < 0.5 else f"{v:+.0f}").replace("-", "−") for v in (low, high)]
    return f"{figures[0]} V" if figures[0] == figures[1] else f"{figures[0]} … {figures[1]} V"


def format_measured_volts(low: float, high: float) -> str:
    """Return measured volts: one value where they differ by less than STEP_V, else a range in steps of STEP_V."""
    if high - low >= STEP_V:
        return format_voltage_range(*(STEP_V * round(v / STEP_V) for v in (low, high)))
    mean = (low + high) / 2 if abs(low + high) >= 2 * STEP_V else 0.0
    return format_voltage_range(mean, mean)


def describe_drive(drive: Drive) -> str:
    """Describe a drive: `sine, 160 Hz`, `linear sweep, 25 … 525 Hz`, `level held`."""
    match drive:
        case Sine(frequency_hz=f) | SquareWave(frequency_hz=f):
            details = f", {f:g} Hz"
        case LinearSweep(start_hz=a, stop_hz=b) | PeriodicSweep(start_hz=a, stop_hz=b):
            details = f", {a:g} … {b:g} Hz"
        case Hold():
            return "level held"
        case Ramp() | Steps():
            details = ""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", drive.kind).lower() + details


def _measured(view: WindowState, reading: CardReading | None, now_s: float) -> tuple[str, str, float]:
    """Return the measured volts, their caption and their age."""
    if view.phase is BenchState.NO_BENCH:
        return "", "nothing measures", math.inf
    if reading is None or view.phase is BenchState.CONNECTING:
        return "unknown" if view.danger else "", "not measured yet", math.inf
    age_s, computed = reading.age_s(now_s), format_measured_volts(*view.amplifier.specimen_v(reading.drive_v))
    text = computed if reading.monitor_v is None else format_measured_volts(*reading.monitor_v)
    if age_s > KNOWN_S:
        return "unknown", f"last {text}, {format_duration(age_s)} ago", age_s
    if is_off_rest(reading.drive_v, view.amplifier):
        known = view.high_voltage is True and not view.danger
    else:
        known = view.phase not in (BenchState.IDLE, BenchState.ARMING)
    known = known or reading.monitor_v is not None
    caption = f"{'at the specimen' if known else 'if the high voltage is on'}, {_age(age_s)}"
    if monitor_disagrees(reading, view.amplifier):
        caption += f", by its monitor; the amplifier's input would give {computed}: look at the amplifier"
    if not known or view.danger:
        text, caption = (text, f"about, {caption}") if "…" in text else (f"about {text}", caption)
    return text, caption, age_s


def _age(age_s: float) -> str:
    return f"{0.1 if age_s <= FRESH_S else age_s:.1f} s ago"


def _aim(view: WindowState) -> str:
    """Return the program's aim."""
    if view.phase is BenchState.LIVE and view.drive is not None:
        volts = view.amplifier.specimen_v([view.drive.low_v, view.drive.high_v])
        return f"{describe_drive(view.drive)}, {format_voltage_range(*volts)}"
    if view.phase is BenchState.AT_REST and view.rest is not None:
        return f"rest, {view.rest.measured_v:.3f} V, 0 V"
    return AIMS.get(view.phase, "rest, 0 V")


def _act(view: WindowState) -> str:
    """Return the operator's next action concerning the voltage; empty if none is needed."""
    if view.danger:
        when = "before you touch the specimen" if view.phase is BenchState.IDLE else "now"
        is_seen = view.off_aim and "card" not in view.remarks  # a card that is not read sees nothing
        why = "; the card sees another voltage than is wanted" if is_seen else ""
        return f"Switch the high voltage OFF at the amplifier {when}{why}"
    if view.off_aim and view.phase is BenchState.HV_OFF:
        return "The amplifier's input is not at rest: leave the high voltage off"
    return "High voltage is still on" if view.phase is BenchState.PAUSED else ""


def _run_line(view: WindowState, streamed_s: float, bench: "Bench | None", now_s: float) -> RunLine:
    """Return the run in two lines."""
    progress = view.progress
    flagged = f", {view.unusable} not usable" if view.unusable else ""
    outcome = None if view.outcome is None else view.outcome.verdict.outcome
    verdict = "no run yet" if outcome is None else f"{OUTCOME_SYMBOLS[outcome]} {outcome}"
    waits_s = now_s - view.connecting_since_s
    waited = f", {format_duration(waits_s)}" if view.phase is BenchState.CONNECTING and waits_s >= 1 else ""
    if view.queued:
        awaited = f", waits for the {view.awaited}" if view.awaited else ""
        return RunLine(view.queued, f"begins when the bench is connected{awaited}{waited}")
    if view.phase is BenchState.CONNECTING:
        return RunLine(view.bench_name, f"waits for the {view.awaited or 'instruments'}{waited}")
    if progress is None:
        return RunLine(view.bench_name, verdict if view.connected else "")
    done = f"{progress.done} of {pluralize(progress.entries, 'point')}{flagged}"
    if view.busy:
        title = f"{progress.title} · {progress.label}" if progress.label else progress.title
        left = format_duration(real_duration_s(progress.remaining_at(streamed_s), bench))
        note = f"{done}, {left} left" if progress.entries else "begins"
        return RunLine(title, note, progress.fraction_at(streamed_s))
    fraction = progress.done / max(progress.entries, 1)
    if outcome is None:
        return RunLine(progress.title, done, fraction)
    return RunLine(progress.title, f"{verdict}, {done}", fraction, outcome)
