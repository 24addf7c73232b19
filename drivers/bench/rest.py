"""Rest verification: criteria by which the card confirms that the drive is at rest."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock

REST_TOLERANCE_V = 0.05
"""Largest measured deviation from rest: noise and gain error of the card, offset error of the generator."""

REST_REPEATABILITY_V = 0.01
"""Largest deviation of rest from its level at arming. The errors of generator and card are equal at both times, so that a
remaining level of some 30 mV is detected and not attributed to an instrument error."""

MAX_NOISE_RATIO, NOISE_MARGIN_V = 2.0, 0.002
"""Largest noise relative to the noise at arming: a small playing sine has the right mean."""

REST_DURATION_S = 0.1
"""Duration for which the card must measure rest without interruption."""

EXTREMES_WINDOW_S = 1.0
"""Time before the timeout over which lowest and highest volts are reported if rest is not confirmed."""

STALE_SAMPLES_S = 0.1
"""Time after a command in which samples may still show the previous state."""


@dataclass(frozen=True, slots=True)
class RestMeasurement:
    """Result of a rest verification."""

    confirmed: bool
    measured_v: float
    message: str
    noise_v: float = math.nan


def verify_rest(
    read_drive_volts: Callable[[], tuple[int, NDArray[np.float64]]],
    clock: Clock,
    start_time_s: float,
    rate_hz: float,
    rest_v: float,
    timeout_s: float,
    initial_rest: RestMeasurement | None = None,
) -> RestMeasurement:
    """Read until the drive has been at rest for REST_DURATION_S, in samples taken after this call.

    Every sample must lie near rest. With `initial_rest`, mean and noise must also agree with the measurement at arming.

    Args:
        read_drive_volts: function that returns the index of the first scan of the next block, and its volts at the amplifier's
            input.
        clock: bench time.
        start_time_s: bench time of scan 0.
        rate_hz: scans per second.
        rest_v: nominal rest level.
        timeout_s: longest wait for rest.
        initial_rest: the measurement at arming.
    """
    expected_v, limit_v, noise_limit_v = rest_v, REST_TOLERANCE_V, math.inf
    if initial_rest is not None:
        expected_v, limit_v = initial_rest.measured_v, REST_REPEATABILITY_V
        noise_limit_v = MAX_NOISE_RATIO * initial_rest.noise_v + NOISE_MARGIN_V
    begin_s = clock.now()
    fresh = math.ceil((begin_s - start_time_s + STALE_SAMPLES_S) * rate_hz)
    needed = math.ceil(REST_DURATION_S * rate_hz)
    still, mean_v, noise_v = np.empty(0), math.nan, math.nan
    extremes: deque[tuple[int, float, float]] = deque()
    while True:
        start, block = read_drive_volts()
        volts = block[max(fresh - start, 0) :]
        if volts.size:
            extremes.append((start + block.size, float(volts.min()), float(volts.max())))
            while extremes[0][0] < start - EXTREMES_WINDOW_S * rate_hz:
                extremes.popleft()
            away = np.flatnonzero(np.abs(volts - rest_v) > REST_TOLERANCE_V)
            still = np.concatenate([still, volts]) if not away.size else volts[int(away[-1]) + 1 :]
            still = still[-needed:]
            seen = still if still.size == needed else volts
            mean_v, noise_v = float(seen.mean()), float(seen.std())
            if still.size == needed and abs(mean_v - expected_v) <= limit_v and noise_v <= noise_limit_v:
                return RestMeasurement(
                    True, mean_v, f"the card sees {mean_v:z.3f} V at the amplifier's input: rest", noise_v
                )
        if start + block.size >= fresh + needed and clock.now() - begin_s > timeout_s:
            noise = f", noise {noise_v:.2g} V" if noise_v > noise_limit_v else ""
            lowest_v, highest_v = min(e[1] for e in extremes), max(e[2] for e in extremes)
            message = (
                f"the card sees {mean_v:z.3f} V (lowest {lowest_v:z.3f} V, highest {highest_v:z.3f} V) at the amplifier's input where rest is {expected_v:.4g} V "
                f"(limit {limit_v:g} V{noise}, watched for {timeout_s:.1f} s)"
            )
            return RestMeasurement(False, mean_v, message, noise_v)
