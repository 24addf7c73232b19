"""Record of the window's state for a web page: sign, voltage, progress, prompt, points and result as plain JSON values."""

import math
from dataclasses import dataclass, field
from typing import Any

from app.common import OUTCOME_SYMBOLS, axis_name, typeset
from app.session import BenchState, Observation, WindowState, format_bench_duration, protocol_title, strip_view
from drivers import Bench
from model import format_estimate, shown_unit
from protocols import PROTOCOLS
from protocols.base import Quality, RunStatus
from protocols.runfile import point_columns

MAX_POINTS = 2000
"""Points of a record; of more, the newest."""
MAX_MESSAGES = 6
LIVE = (BenchState.LIVE, BenchState.PAUSING, BenchState.PAUSED)
"""States of a run with high voltage on."""


@dataclass(frozen=True)
class Snapshot:
    """Contents of the window.

    Attributes:
        next_step: next step of the open campaign, as text; empty without one.
        streamed_s: bench time of the samples since the begin of the run.
        bench: connected bench, for the speed of a simulated one.
        age_s: seconds since the window's last frame.
        seen: what the instruments answered last.
        now_s: present time (time.monotonic).
    """

    state: WindowState
    specimen: str = ""
    next_step: str = ""
    streamed_s: float = 0.0
    bench: Bench | None = None
    age_s: float = 0.0
    seen: Observation = field(default_factory=Observation)
    now_s: float = 0.0


def snapshot_record(snapshot: Snapshot) -> dict[str, Any]:
    """Return a snapshot as JSON values; non-finite values are null."""
    view = snapshot.state
    progress = view.progress if view.busy else None
    strip = strip_view(view, snapshot.seen, snapshot.now_s)
    title = "" if not view.protocol else protocol_title(view.protocol)
    return {
        "age_s": round(snapshot.age_s, 1),
        "bench": view.bench_name,
        "simulated": view.simulated,
        "specimen": snapshot.specimen,
        "state": str(strip.state),
        "urgent": strip.danger or bool(view.unsafe),
        "live": strip.state in LIVE,
        "voltage": strip.measured,
        "voltage_note": strip.note,
        "voltage_present": strip.present,
        "instruments": dict(strip.instruments),
        "unsafe": view.unsafe,
        "problem": view.problem,
        "protocol": title,
        "busy": view.busy,
        "progress": None
        if progress is None
        else {
            "done": progress.done,
            "entries": progress.entries,
            "label": progress.label,
            "left": f"left: {format_bench_duration(progress.remaining_at(snapshot.streamed_s), snapshot.bench)}",
            "fraction": round(progress.fraction_at(snapshot.streamed_s), 4),
        },
        "next_step": _next_step(snapshot),
        "operator_needed": view.prompt is not None,
        "points": _points(view),
        "result": _result(view),
        "messages": [[f"{line.time:%H:%M:%S}", line.text] for line in view.messages[-MAX_MESSAGES:]],
    }


def _next_step(snapshot: Snapshot) -> str:
    view = snapshot.state
    if view.unsafe:
        return "Read the message at the bench"
    if view.prompt is not None:
        return view.prompt.prompt.text
    if view.busy:
        return "Pausing" if view.pause_requested else "Paused: resume at the bench" if view.paused else ""
    return snapshot.next_step


def _points(view: WindowState) -> dict[str, Any]:
    kind = PROTOCOLS.get(view.protocol)
    if kind is None:
        return {"x": "", "y": "", "points": []}
    columns, (x_name, y_name) = point_columns(kind.point_type), kind.axes
    (x_factor, x_unit), (y_factor, y_unit) = (shown_unit(columns[name][0]) for name in (x_name, y_name))
    measured: list[Any] = list(view.points[-MAX_POINTS:])
    points = [
        [x, y, Quality(point.quality).usable]
        for point in measured
        if hasattr(point, x_name)
        and hasattr(point, y_name)
        and math.isfinite(x := x_factor * float(getattr(point, x_name)))
        and math.isfinite(y := y_factor * float(getattr(point, y_name)))
    ]
    return {
        "x": f"{axis_name(x_name)} ({x_unit})" if x_unit else axis_name(x_name),
        "y": f"{axis_name(y_name)} ({y_unit})" if y_unit else axis_name(y_name),
        "points": points,
    }


def _result(view: WindowState) -> dict[str, Any] | None:
    ended = view.outcome
    if ended is None or view.busy:
        return None
    verdict = ended.verdict.outcome
    return {
        "text": f"{OUTCOME_SYMBOLS.get(verdict, '')} {verdict}".strip(),
        "good": ended.status is RunStatus.COMPLETED and not view.verdict_message,
        "reason": ended.reason,
        "estimates": [typeset(format_estimate(estimate)) for estimate in ended.estimates],
    }
