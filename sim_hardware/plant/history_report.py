"""Voltage report: extremes, jumps and slopes at the amplifier's input while high voltage was on.

Independent of the state of the program. Extremes are taken on the plant's grid and at every change; jumps are the discontinuities
between and inside segments, summed within one grid step (steps without duration are one jump).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from model import Array
from sim_hardware.plant.voltage_history import HistoryEntry

_CHUNK = 1_000_000


@dataclass(frozen=True, slots=True)
class VoltageReport:
    """Facts about one history; voltages at the amplifier's input, with high voltage on for all but the last two.

    Attributes:
        live_s: seconds with high voltage on; without any the extremes are rest and the jumps zero.
        lowest_v, highest_v: extremes, including volts of zero duration.
        largest_jump_v: largest discontinuity, continuous slopes excluded.
        steepest_v_per_s: steepest continuous slope.
        outside_rest_s: seconds further from rest than the tolerance.
        switched_at_rest: whether the input was constant at rest at every switching of high voltage.
        end_v: volts at the input at the end.
        ends_at_rest: whether the input is constant at rest at the end and remains so.
    """

    live_s: float
    lowest_v: float
    highest_v: float
    largest_jump_v: float
    steepest_v_per_s: float
    outside_rest_s: float
    switched_at_rest: bool
    end_v: float
    ends_at_rest: bool


def _volts_at(entry: HistoryEntry, t: float) -> float:
    return float(entry.segment.volts(np.array([t]))[0])


def _volts_just_before(entry: HistoryEntry, t: float) -> float:
    return _volts_at(entry, math.nextafter(t, -math.inf))


def _is_constant_at_rest(entry: HistoryEntry, t: float, rest_v: float, tolerance_v: float) -> bool:
    return t >= entry.segment.constant_from_s and abs(_volts_at(entry, t) - rest_v) <= tolerance_v


def _sample_times(entry: HistoryEntry, begin_s: float, end_s: float, rate_hz: float) -> Iterator[Array]:
    """Yield times from begin to just before end, in chunks that share end points; two points for a constant input."""
    edges = [begin_s, *sorted(k for k in entry.segment.breakpoints_s if begin_s < k < end_s), end_s]
    for a, b in pairwise(edges):
        last = math.nextafter(b, -math.inf)
        if a >= entry.segment.constant_from_s or last <= a:
            yield np.array([a, max(a, last)])
            continue
        low, high = math.floor(a * rate_hz) + 1, math.ceil(b * rate_hz)
        previous = a
        for k in range(low, high, _CHUNK):
            inner = np.arange(k, min(k + _CHUNK, high)) / rate_hz
            yield np.concatenate(([previous], inner))
            previous = float(inner[-1])
        yield np.array([previous, last])


def _jumps(entries: Sequence[HistoryEntry], until_s: float) -> Iterator[tuple[float, float, float]]:
    """Yield time, volts before and volts after every discontinuity under high voltage."""
    for i, entry in enumerate(entries):
        if i and entry.hv and entries[i - 1].hv and entry.start_s <= until_s:
            earlier = entries[i - 1]
            # An entry of zero duration counts with its initial volts.
            has_duration = earlier.start_s < entry.start_s
            yield (
                entry.start_s,
                _volts_just_before(earlier, entry.start_s) if has_duration else _volts_at(earlier, entry.start_s),
                _volts_at(entry, entry.start_s),
            )
        end = entries[i + 1].start_s if i + 1 < len(entries) else math.inf
        for knot in entry.segment.breakpoints_s:
            if entry.hv and entry.start_s < knot < min(end, until_s):
                yield knot, _volts_just_before(entry, knot), _volts_at(entry, knot)


def _largest_jump(entries: Sequence[HistoryEntry], until_s: float, rate_hz: float) -> float:
    largest, step, first_v = 0.0, -1, 0.0
    for t, before_v, after_v in _jumps(entries, until_s):
        if math.floor(t * rate_hz) != step:
            step, first_v = math.floor(t * rate_hz), before_v
        largest = max(largest, abs(after_v - first_v))
    return largest


@lru_cache(maxsize=4096)
def _entry_extremes(
    entry: HistoryEntry, end_s: float, rate_hz: float, rest_v: float, tolerance_v: float
) -> tuple[float, float, float, float]:
    """Return lowest and highest volts, steepest slope and seconds outside rest of an entry until `end_s`.

    Cached, because the past does not change and reports are repeated during a run.
    """
    low, high, steepest, outside = math.inf, -math.inf, 0.0, 0.0
    for t in _sample_times(entry, entry.start_s, end_s, rate_hz):
        volts = entry.segment.volts(t)
        low, high = min(low, float(volts.min())), max(high, float(volts.max()))
        spans = np.diff(t)
        outside += float(spans[np.abs(volts[:-1] - rest_v) > tolerance_v].sum())
        # The step of a held waveform, or a rounding error, over a shorter chord beside a breakpoint is no slope.
        wide = spans > 0.1 / rate_hz
        if wide.any():
            steepest = max(steepest, float(np.max(np.abs(np.diff(volts)[wide]) / spans[wide])))
    return low, high, steepest, outside


def make_voltage_report(
    entries: Sequence[HistoryEntry], until_s: float, rate_hz: float, rest_v: float, tolerance_v: float
) -> VoltageReport:
    """Return the report of a history up to `until_s`, sampled at the plant's rate."""
    low, high, steepest, live, outside = math.inf, -math.inf, 0.0, 0.0, 0.0
    switched_at_rest = True
    for i, entry in enumerate(entries):
        if entry.start_s > until_s:
            break
        if i and entry.hv != entries[i - 1].hv:
            switched_at_rest &= _is_constant_at_rest(entry, entry.start_s, rest_v, tolerance_v)
        if not entry.hv:
            continue
        end = min(entries[i + 1].start_s if i + 1 < len(entries) else until_s, until_s)
        live += end - entry.start_s
        lowest, highest, slope, away = _entry_extremes(entry, end, rate_hz, rest_v, tolerance_v)
        low, high, steepest, outside = min(low, lowest), max(high, highest), max(steepest, slope), outside + away
    last = [entry for entry in entries if entry.start_s <= until_s][-1]
    return VoltageReport(
        live_s=live,
        lowest_v=rest_v if math.isinf(low) else low,
        highest_v=rest_v if math.isinf(high) else high,
        largest_jump_v=_largest_jump(entries, until_s, rate_hz),
        steepest_v_per_s=steepest,
        outside_rest_s=outside,
        switched_at_rest=switched_at_rest,
        end_v=_volts_at(last, until_s),
        ends_at_rest=_is_constant_at_rest(last, until_s, rest_v, tolerance_v),
    )
