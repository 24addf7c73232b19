"""Latency of a sampled response: first and last crossing of a level, and the edge of the drive.

A drive cannot jump: its edge has a duration. The response to an edge is the response to an ideal step at the edge's centroid,
averaged over the edge. `find_edge` gives the centroid from the recorded drive, `remove_edge` undoes the average.
"""

import math
from dataclasses import dataclass

import numpy as np

from model import Array

SMOOTHING_S = 1e-4
"""Width of the polynomial that smooths the response: a quarter of a period of the second mode, at 2.3 kHz."""

POLYNOMIAL_ORDER = 3
MIN_SMOOTHING_SAMPLES = 5

LEAST_EDGE_SHARE = 0.2
"""Share of a component that the average over an edge must leave for its restoration: the noise there grows two and a half times."""


@dataclass(frozen=True, slots=True)
class Edge:
    """An edge of the recorded drive between two levels.

    Attributes:
        centroid_s: time of the centroid of its slope, after the first sample.
        spread_s: standard deviation of its slope in time; a straight edge of T has T / sqrt(12).
        step_v: level after minus level before.
    """

    centroid_s: float
    spread_s: float
    step_v: float

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
    return Edge(centroid, spread, after - before)


def remove_edge(responses: Array, edge: Edge, rate_hz: float, least_share: float = LEAST_EDGE_SHARE) -> Array:
    """Return the responses to an ideal step at the edge's centroid: the average over a straight edge, undone (Wiener); (..., N).

    Components of which the edge leaves less than `least_share` are not restored; a response to an edge of 0.28 ms lacks those near 3.6 kHz.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    size = responses.shape[-1]
    whole = next_fast_len(size + 20 * math.ceil(edge.duration_s * rate_hz), real=True)
    # The record repeats in the transform: it returns smoothly from its end to its begin.
    back = 0.5 - 0.5 * np.cos(np.linspace(0, math.pi, whole - size))
    ends = responses[..., -1:] + (responses[..., :1] - responses[..., -1:]) * back
    share = np.sinc(np.fft.rfftfreq(whole, 1 / rate_hz) * edge.duration_s)
    gain = (1 + least_share**2) * share / (share**2 + least_share**2)
    return np.asarray(irfft(rfft(np.concatenate([responses, ends], axis=-1)) * gain, whole)[..., :size])


def smooth(samples: Array, rate_hz: float, width_s: float = SMOOTHING_S) -> Array:
    """Return the samples smoothed by a local polynomial; (..., N)."""
    from scipy.signal import savgol_filter

    width = max(round(width_s * rate_hz), MIN_SMOOTHING_SAMPLES) | 1
    return np.asarray(savgol_filter(samples, width, POLYNOMIAL_ORDER))


def first_crossings(time_s: Array, responses: Array, levels: Array | float) -> Array:
    """Return the time at which each response first reaches its level; NaN where it does not.

    Args:
        time_s: (N,).
        responses: (M, N).
        levels: (M,), or one for all.

    Returns:
        (M,), interpolated between samples.
    """
    reached = responses >= np.broadcast_to(levels, len(responses))[:, None]
    return np.where(reached.any(1), _interpolated(time_s, responses, levels, reached.argmax(1)), np.nan)


def last_crossings(time_s: Array, responses: Array, levels: Array | float) -> Array:
    """Return the time after which each response stays below its level, (M,); NaN where it does not until its end."""
    outside = responses > np.broadcast_to(levels, len(responses))[:, None]
    after = outside.shape[1] - outside[:, ::-1].argmax(1)  # the first index inside
    found = _interpolated(time_s, responses, levels, np.minimum(after, outside.shape[1] - 1))
    return np.where(outside.any(1), np.where(outside[:, -1], np.nan, found), time_s[0])


def _interpolated(time_s: Array, responses: Array, levels: Array | float, at: Array) -> Array:
    rows, before = np.arange(len(responses)), np.maximum(at - 1, 0)
    low, high = responses[rows, before], responses[rows, at]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(high == low, 1.0, (levels - low) / (high - low))
    return np.asarray(time_s[before] + share * (time_s[at] - time_s[before]))
