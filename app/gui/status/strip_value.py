"""Strip: what it shows of the bench."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.common import OUTCOME_SYMBOLS, format_duration
from app.session import BenchState, WindowState, real_duration_s
from protocols.base import Outcome

if TYPE_CHECKING:
    from drivers import Bench


@dataclass(frozen=True, slots=True)
class RunLine:
    """The run in two lines, with the share that is done, 0 to 1; `outcome` is that of the last run, None during one."""

    title: str
    note: str
    fraction: float = 0.0
    outcome: Outcome | None = None


@dataclass(frozen=True, slots=True)
class StripView:
    """What is shown of the bench."""

    state: str
    danger: bool
    measured: str
    caption: str
    age_s: float
    aim: str
    act: str
    run: RunLine

    @property
    def present(self) -> bool:
        """Whether the volts are present."""
        return self.age_s <= 0.5


def strip_view(view: WindowState, streamed_s: float = 0.0, bench: "Bench | None" = None) -> StripView:
    """Return what is shown of a state."""
    danger = view.bench_state in (BenchState.UNSAFE, BenchState.DRIVE_LOST)
    progress = view.progress
    outcome = None if view.outcome is None else view.outcome.verdict.outcome
    if progress is None:
        run = RunLine(view.bench_name, "no run yet" if view.connected else "")
    elif view.busy:
        left = format_duration(real_duration_s(progress.remaining_at(streamed_s), bench))
        note = f"{progress.done} of {progress.entries} points, {left} left" if progress.entries else "begins"
        title = f"{progress.title} · {progress.label}" if progress.label else progress.title
        run = RunLine(title, note, progress.fraction_at(streamed_s))
    else:
        fraction = progress.done / max(progress.entries, 1)
        done = f"{progress.done} of {progress.entries} points"
        run = RunLine(progress.title, done, fraction)
        if outcome is not None:
            title = f"{OUTCOME_SYMBOLS[outcome]} {outcome.upper()}"
            run = RunLine(title, f"{progress.title}, {done}", fraction, outcome)
    return StripView(
        "pausing" if view.pause_requested and view.bench_state is BenchState.LIVE else view.bench_state,
        danger,
        view.voltage_text,
        view.voltage_note,
        0.1,
        "" if view.bench_state in (BenchState.CONNECTING, BenchState.NO_BENCH) else "rest, 0 V",
        "Switch HV off at the amplifier" if danger else "",
        run,
    )
