"""Drive histories of runs: levels, loads and rests in time, from where the recordings lie in the stream of samples."""

from typing import Any

import numpy as np

from model import Array
from model.drive_history import DriveHistory
from protocols.measurements.static_loading import StaticLoading
from protocols.measurements.voltage_steps import ZERO_GUARD_S, VoltageSteps
from protocols.resume import protocol_of_run
from protocols.runfile.reader import Run

SEEN = "seen by the laser"
MAX_ANSWER_S = 0.5
"""From the answer to a prompt to the recording that follows it, at most."""
MIN_READ_S = 1e-3
"""From reaching a level to its reading, at least."""


def history_of_levels(run: Run, columns: dict[str, Array]) -> DriveHistory | None:
    """Return levels and rests of voltage steps in time; None where the file does not have them all, as in an import.

    A recording begins at rest and ends `hold_s` after the ramp; the way back takes as long as the ramp did.
    """
    found = _recordings_of_points(run, columns, 1)
    ramp, level = columns["ramp_time"], columns["drive"]
    if found is None or not (np.isfinite(ramp) & np.isfinite(level)).all():
        return None
    protocol: VoltageSteps = _protocol(run)
    end = found[:, 0, 1]
    reached = end - protocol.hold_s
    begun = reached - ramp
    rest = np.full(ramp.size, run.amplifier_map.rest_v)
    return _history(
        np.stack((begun, reached, end, end + ramp), axis=1),
        np.stack((rest, level, level, rest), axis=1),
        reached,
        reached + columns["read_time"],
        (begun - ZERO_GUARD_S - protocol.window_s / 2)[:, None],
    )


def history_of_loads(run: Run, columns: dict[str, Array]) -> DriveHistory | None:
    """Return the loads of a static loading in time; None where the file does not have them all, as in an import.

    A recording follows a weight that the laser saw put on or lifted by the `record_s` in which it was seen to lie still. Where it
    did not, and a key was pressed, it was about halfway since the recording before.
    """
    found = _recordings_of_points(run, columns, 3)
    load = columns["load"]
    if found is None or not np.isfinite(load).all():
        return None
    protocol: StaticLoading = _protocol(run)
    half = protocol.record_s / 2
    seen_s = [event.time_s for event in run.events() if event.kind == "Answered" and event.fields.get("words") == SEEN]
    begins, ends = found[:, 1:, 0], found[:, :-1, 1]
    seen = np.abs(begins[..., None] - np.array([*seen_s, -np.inf])).min(axis=-1) < MAX_ANSWER_S
    placed, lifted = np.where(seen, np.maximum(begins - protocol.record_s, ends), (begins + ends) / 2).T
    load = np.where(columns["side"] < 0, -load, load)  # as the specimen is bent
    none = np.zeros(load.size)
    return _history(
        np.stack((placed, placed, lifted, lifted), axis=1),
        np.stack((none, load, load, none), axis=1),
        placed,
        found[:, 1, 1] - half,
        np.stack((found[:, 0, 1], found[:, 2, 1]), axis=1) - half,
    )


def _protocol(run: Run) -> Any:
    return protocol_of_run(run, run.path.name)


def _recordings_of_points(run: Run, columns: dict[str, Array], count: int) -> Array | None:
    """Return begin and end of the last `count` recordings of each point, s, (F, count, 2); None where one has fewer."""
    if run.imported or not columns["entry"].size or run.resumed_from is not None:
        return None
    trace, places = run.trace, dict[int, list[tuple[int, int]]]()
    for first, stop, entry in trace.recording_rows():
        places.setdefault(entry, []).append((first, stop))
    rows = [places.get(int(entry), [])[-count:] for entry in columns["entry"]]
    if any(len(each) < count for each in rows):
        return None
    edges = sorted({edge for each in rows for pair in each for edge in pair})
    step_s = 1 / trace.rate_hz
    lasts = [max(edge - 1, 0) for edge in edges]
    ends = {edge: last + step_s if edge else 0.0 for edge, last in zip(edges, trace.times_of_rows(lasts), strict=True)}
    firsts = sorted({first for each in rows for first, _ in each})
    begins = dict(zip(firsts, trace.times_of_rows(firsts), strict=True))
    return np.array([[(begins[first], ends[stop]) for first, stop in each] for each in rows])


def _history(time_s: Array, drive: Array, start_s: Array, read_s: Array, zero_s: Array) -> DriveHistory | None:
    """Return a history of what was done point by point, (F, 4); None where the times are not in order."""
    t = time_s.ravel()
    if np.any(np.diff(t) < 0) or np.any(read_s < start_s + MIN_READ_S):
        return None
    return DriveHistory(t, drive.ravel(), start_s, read_s, zero_s)
