"""Latency of a sampled response: first and last crossing of a level, and the edge of the drive.

A drive cannot jump: its edge has a duration. The response to an edge is the response to an ideal step, averaged over the edge's
slope; to first order it is the response to the step, delayed by the edge's centroid in time. `Edge` gives the centroid from the
recorded drive, and the change by a second, equal average bounds the error of the first order.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model import Array, Mask

SMOOTHING_S = 1e-4
"""Width of the polynomial that smooths the response: a quarter of a period of the second mode, at 2.3 kHz."""

POLYNOMIAL_ORDER = 3
MIN_SMOOTHING_SAMPLES = 5

EDGE_FLOOR = 0.1
"""Smallest uncertainty as a share of the edge's standard deviation in time: ringing faster than the edge is not resolved."""


@dataclass(frozen=True, slots=True)
class Edge:
    """An edge of the recorded drive between two levels.

    Attributes:
        centroid_s: time of the centroid of its slope, after the first sample.
        spread_s: standard deviation of its slope in time; a straight edge of T has T / sqrt(12).
        step_v: level after minus level before.
        kernel: the slope as recorded, one weight per sample, sum 1, (K,).
    """

    centroid_s: float
    spread_s: float
    step_v: float
    kernel: Array

    @property
    def duration_s(self) -> float:
        """Duration of a straight edge with the same spread."""
        return math.sqrt(12) * self.spread_s

    @property
    def begin_s(self) -> float:
        """Begin of a straight edge with the same centroid and spread."""
        return self.centroid_s - self.duration_s / 2


def find_edge(drive_v: Array, rate_hz: float, nominal_s: float, dwell_s: float) -> Edge:
    """Return the first edge of a drive from its first level to another that lasts for `dwell_s`.

    Args:
        drive_v: recorded drive, (N,).
        rate_hz: samples per second.
        nominal_s: commanded duration of the edge; the recorded one may be up to three times as long.
        dwell_s: duration of the levels before and after the edge.

    Raises:
        ValueError: the drive shows no such edge.
    """
    half = max(round(1.5 * nominal_s * rate_hz), 4)
    before = float(np.median(drive_v[: max(round(0.3 * dwell_s * rate_hz), 8)]))
    away = int(np.argmax(np.abs(drive_v - before)))
    middle = 0.5 * (before + float(drive_v[away]))
    crossed = np.flatnonzero(np.abs(drive_v - before) > abs(middle - before))
    at = int(crossed[0]) if crossed.size else 0
    hold = drive_v[at + half : at + max(round(0.9 * dwell_s * rate_hz), half + 8)]
    if not half < at < len(drive_v) - half or hold.size < 8:
        raise ValueError("the recorded drive shows no step: check the cable from the generator to the card")
    after = float(np.median(hold))
    slope = np.diff(drive_v[at - half : at + half + 1]) / (after - before)
    kernel = slope / slope.sum()
    time = (at - half + 0.5 + np.arange(kernel.size)) / rate_hz
    centroid = float(kernel @ time)
    spread = math.sqrt(max(float(kernel @ (time - centroid) ** 2), (0.3 / rate_hz) ** 2))
    return Edge(centroid, spread, after - before, kernel)


def edge_average(samples: Array, edge: Edge, rate_hz: float) -> Array:
    """Return the samples averaged again over the edge, about the same time; (N,)."""
    half = max(round(edge.duration_s * rate_hz / 2), 1)
    padded = np.pad(samples, half, mode="edge")
    return np.asarray(np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), "valid"))


def smooth(samples: Array, rate_hz: float) -> tuple[Array, float]:
    """Return the samples smoothed by a local polynomial, (N,), and the remaining share of white noise's standard deviation."""
    from scipy.signal import savgol_coeffs, savgol_filter

    width = max(round(SMOOTHING_S * rate_hz), MIN_SMOOTHING_SAMPLES) | 1
    left = float(np.sqrt(np.sum(savgol_coeffs(width, POLYNOMIAL_ORDER) ** 2)))
    return np.asarray(savgol_filter(samples, width, POLYNOMIAL_ORDER)), left


LEVEL_SIGMAS = 1.5
"""Shift of a level, in standard uncertainties of a sample, for the uncertainty of its crossing: noise makes a first crossing
early and a last one late, by up to about one of them."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """Crossing of a level by a response; NaN without one.

    Attributes:
        time_s: time of the crossing.
        standard_error: half of its shift between levels moved by `LEVEL_SIGMAS` uncertainties of the response to both sides; more
            than the noise over the slope if the response barely reaches the level.
        slope_per_s: slope of the response at the crossing, in its unit per second.
    """

    time_s: float
    standard_error: float
    slope_per_s: float


def first_crossing(time_s: Array, response: Array, level: float, noise: float) -> Crossing:
    """Return the time at which `response`, (N,), first reaches `level`; `noise` is its standard uncertainty at a sample."""
    return _crossing(time_s, response, level, noise, lambda at: _first(time_s, response >= at, response, at))


def last_crossing(time_s: Array, response: Array, level: float, noise: float) -> Crossing:
    """Return the time after which `response`, (N,), stays below `level`; NaN if it does not until its end."""
    return _crossing(time_s, response, level, noise, lambda at: _last(time_s, response > at, response, at))


def _crossing(time_s: Array, response: Array, level: float, noise: float, find: Callable[[float], float]) -> Crossing:
    at, early, late = (find(value) for value in (level, level - LEVEL_SIGMAS * noise, level + LEVEL_SIGMAS * noise))
    if not math.isfinite(at):
        return Crossing(math.nan, math.nan, math.nan)
    spread = 0.5 * abs(late - early) if math.isfinite(late - early) else math.inf
    i = min(max(int(np.searchsorted(time_s, at)), 1), time_s.size - 1)
    slope = float((response[i] - response[i - 1]) / (time_s[i] - time_s[i - 1]))
    return Crossing(at, spread, slope)


def _first(time_s: Array, reached: Mask, response: Array, level: float) -> float:
    indices = np.flatnonzero(reached)
    return math.nan if not indices.size else _interpolated(time_s, response, int(indices[0]), level)


def _last(time_s: Array, outside: Mask, response: Array, level: float) -> float:
    indices = np.flatnonzero(outside)
    if not indices.size:
        return float(time_s[0])
    return math.nan if indices[-1] == time_s.size - 1 else _interpolated(time_s, response, int(indices[-1]) + 1, level)


def _interpolated(time_s: Array, response: Array, i: int, level: float) -> float:
    if i == 0 or response[i] == response[i - 1]:
        return float(time_s[i])
    share = (level - response[i - 1]) / (response[i] - response[i - 1])
    return float(time_s[i - 1] + share * (time_s[i] - time_s[i - 1]))
