"""Evaluation of a long level: steadiness, and whether Stop may hasten its end."""

import math

import numpy as np

from drivers.evidence import OutputCheck
from model import Array
from protocols.commissioning.exercise import Trace
from protocols.commissioning.verdict import CheckedOutput

LEVEL_V, HELD_S = 0.2, 10.0
LONG_LEVEL_LIMIT_V = 0.01
"""Largest departure of a held level from its median."""

REACHED_S = 0.05
SEEN_V = 0.02
SMOOTHING_S = 0.01

EARLY_HELD_S, EARLY_STOP_AFTER_S = 4.0, 1.0
"""Duration of a level with a hastened end, and time of Stop."""

DEPARTURE_V, JUMP_S, MARGIN_S = 0.04, 2e-4, 0.1
"""Largest deviation of a hastened level from itself until its return to rest, and from rest after it, and largest change within
JUMP_S."""

LONGEST_EARLY_STOP_S = 2.0


def is_reached(trace: Trace) -> bool:
    """Whether the level was reached."""
    held, before_v = _held(trace), float(np.median(trace.volts[: round(REACHED_S * trace.rate_hz)]))
    return held.size > 0 and abs(float(np.median(held)) - before_v) > SEEN_V


def check_long_level(trace: Trace | None) -> CheckedOutput:
    """Return the check that a level is steady for the duration stated by the driver."""
    value, detail = math.nan, ""
    if trace is not None and is_reached(trace):
        volts = _smoothed(_held(trace), trace.rate_hz, SMOOTHING_S)
        value = float(np.abs(volts - np.median(volts)).max())
        detail = f"within {volts.size / trace.rate_hz:.1f} s"
    return CheckedOutput(OutputCheck.LONG_LEVEL, value, "V", None, LONG_LEVEL_LIMIT_V, detail)


def hastened_stop_s(trace: Trace | None, ends_s: float) -> float:
    """Return the duration of Stop from a level with a hastened end; NaN for a jump of the output.

    Args:
        trace: recording beyond the natural end of the level.
        ends_s: bench time of the natural end.
    """
    if trace is None or trace.error or not is_reached(trace):
        return math.nan
    took_s = trace.rest_s - trace.stop_s
    volts = _smoothed(trace.volts, trace.rate_hz, JUMP_S / 2)
    level_v = float(np.median(trace.span(trace.started_s + REACHED_S, trace.stop_s)))
    at_rest_v = float(np.median(trace.volts[-round(MARGIN_S * trace.rate_hz) :]))
    t = trace.start_s + np.arange(volts.size) / trace.rate_hz
    stopping = volts[(t > trace.stop_s) & (t < ends_s + MARGIN_S)]
    resting = volts[(t > trace.rest_s + MARGIN_S / 10) & (t < ends_s + MARGIN_S)]
    count = round(JUMP_S * trace.rate_hz)
    low_v, high_v = sorted((level_v, at_rest_v))
    follows = (
        trace.rest_s < ends_s - MARGIN_S
        and took_s < LONGEST_EARLY_STOP_S
        and stopping.size > count
        and resting.size > count
        and low_v - DEPARTURE_V < stopping.min() <= stopping.max() < high_v + DEPARTURE_V
        and np.abs(resting - at_rest_v).max() < DEPARTURE_V
        and np.abs(stopping[count:] - stopping[:-count]).max() < DEPARTURE_V
    )
    return took_s if follows else math.nan


def _held(trace: Trace) -> Array:
    return trace.span(trace.started_s + REACHED_S, min(trace.held_until_s, trace.stop_s) - REACHED_S)


def _smoothed(volts: Array, rate_hz: float, seconds: float) -> Array:
    size = max(round(seconds * rate_hz), 1)
    return np.convolve(volts, np.full(size, 1 / size), "valid") if volts.size > size else volts
