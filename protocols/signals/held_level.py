"""Level, step and creep: means with standard errors for correlated samples, the ramp between levels, and logarithmic creep after it.

The spectrum of the noise at frequency zero, not its variance, gives the error of a mean. It is taken from the lowest cosine
components of the residuals of a straight line and the mains (Lazarus, Lewis, Stock, Watson, J. Bus. Econ. Stat. 36, 2018), which
gives a known number of degrees of freedom for the interval. It is valid for noise with a correlation time below a fiftieth of the
stretch.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from model import Array, misfit_factor
from protocols.base import InterferenceLine
from protocols.signals.checks import check_positive, check_samples
from protocols.signals.interference import SEPARATION_BINS, resolved_lines

MAINS_HZ = 50.0
MAINS_ORDERS = 3
"""Fitted harmonics of the mains; the third is strong with saturated transformers."""

MAX_COSINE_COMPONENTS = 12
"""Largest number of cosine components for the noise estimate: few enough to include slow noise, enough to keep a 95 % interval
below 3 standard errors."""

SAMPLES_PER_LINE = 24
"""Fewest samples of a level for each fitted line of interference."""

MIN_SAMPLES = 24
"""Fewest samples of a level."""


@dataclass(frozen=True, slots=True)
class LevelEstimate:
    """The level of a stretch of samples at its middle, in the unit of the samples.

    Attributes:
        value: level at the middle, drift and mains removed.
        standard_error: of the value, slow noise included.
        degrees_of_freedom: of the standard error.
        drift_per_s: slope of the straight line.
        noise: standard deviation of the residuals of line and mains.
    """

    value: float
    standard_error: float
    degrees_of_freedom: float
    drift_per_s: float
    noise: float


@dataclass(frozen=True, slots=True)
class StepEstimate:
    """Change by a step at a stated time after it, against the level just before; in the unit of the samples.

    Attributes:
        value: after - before.
        standard_error: of the value.
        degrees_of_freedom: of the standard error (Welch, Satterthwaite).
        before, after: the two levels.
    """

    value: float
    standard_error: float
    degrees_of_freedom: float
    before: LevelEstimate
    after: LevelEstimate


def estimate_level(
    samples: ArrayLike, rate_hz: float, mains_hz: float | None = MAINS_HZ, interference: Sequence[InterferenceLine] = ()
) -> LevelEstimate:
    """Return the level of a stretch, (N,), with its standard error.

    Args:
        samples: evenly spaced samples; 0.1 s is a whole number of cycles of 50 and 60 Hz.
        rate_hz: samples per second.
        mains_hz: mains frequency, fitted and removed with two harmonics; None: no fit.
        interference: lines measured at rest: fitted and removed if the stretch resolves them, otherwise counted in the error.

    Raises:
        ValueError: fewer than 24 samples, not finite, or shorter than a cycle of the mains.
    """
    from scipy.fft import dct

    check_positive(rate_hz=rate_hz)
    x = check_samples("the level", samples, MIN_SAMPLES)
    n = x.size
    lines_hz, slow = resolved_lines(interference, n / rate_hz, rate_hz)
    q, inverse, components, freedom = _regression_design(n, rate_hz, mains_hz, lines_hz[: n // SAMPLES_PER_LINE])
    middle = float(x.mean())
    projected = q.T @ (x - middle)
    residual = x - middle - q @ projected
    power = float((dct(residual, norm="ortho")[1 : components + 1] ** 2).sum())
    value, slope = (inverse[:2] @ projected).tolist()
    return LevelEstimate(
        value=middle + value,
        standard_error=math.hypot(math.sqrt(power / freedom) * float(np.linalg.norm(inverse[0])), slow),
        degrees_of_freedom=freedom,
        drift_per_s=slope * 2 * rate_hz / (n - 1),
        noise=float(np.sqrt(residual @ residual / (n - q.shape[1]))),
    )


def estimate_step(
    samples: ArrayLike,
    rate_hz: float,
    step_s: float,
    read_s: float,
    window_s: float = 0.1,
    guard_s: float = 0.0,
    interference: Sequence[InterferenceLine] = (),
) -> StepEstimate:
    """Estimate the value `read_s` after a step against the value just before it.

    Creep is logarithmic, so that a step has no final value: the time of the reading is part of the result.

    Args:
        samples: (N,), before and after the step, evenly spaced.
        rate_hz: samples per second.
        step_s: time of the begin of the step, from the first sample.
        read_s: time of the middle of the reading window after the step.
        window_s: length of both windows.
        guard_s: gap between the end of the first window and the step, for a step with an inexact time.
        interference: see `estimate_level`.

    Raises:
        ValueError: a window lies outside the samples or on the step, or has too few samples.
    """
    check_positive(rate_hz=rate_hz, read_s=read_s, window_s=window_s)
    x = np.asarray(samples, float)
    length = round(window_s * rate_hz)
    end_before = math.floor((step_s - guard_s) * rate_hz)
    begin_after = round((step_s + read_s) * rate_hz - length / 2)
    if end_before - length < 0:
        raise ValueError(
            f"only {max(end_before, 0) / rate_hz:g} s were recorded before the step, {window_s:g} s are needed to take its zero"
        )
    if begin_after < math.ceil(step_s * rate_hz):
        raise ValueError(
            f"a window of {window_s:g} s around {read_s:g} s after the step begins before the step: read later, or shorten it"
        )
    if begin_after + length > x.size:
        raise ValueError(
            f"the record ends {x.size / rate_hz - step_s:g} s after the step, {read_s + window_s / 2:g} s are needed to read it"
        )
    before = estimate_level(x[end_before - length : end_before], rate_hz, interference=interference)
    after = estimate_level(x[begin_after : begin_after + length], rate_hz, interference=interference)
    return StepEstimate(after.value - before.value, *combine_errors(before, after), before, after)


def combine_errors(first: LevelEstimate, second: LevelEstimate) -> tuple[float, float]:
    """Return standard error and degrees of freedom of a sum or difference of two levels (Welch, Satterthwaite)."""
    one, two = first.standard_error**2, second.standard_error**2
    if one + two == 0:
        return 0.0, first.degrees_of_freedom + second.degrees_of_freedom
    freedom = (one + two) ** 2 / (one**2 / first.degrees_of_freedom + two**2 / second.degrees_of_freedom)
    return math.sqrt(one + two), freedom


@lru_cache(maxsize=8)
def _regression_design(
    n: int, rate_hz: float, mains_hz: float | None, lines_hz: tuple[float, ...] = ()
) -> tuple[Array, Array, int, float]:
    """Return quantities of the length alone: an orthogonal basis (n, k), the inverse of its triangle, components and freedom.

    Line and mains account for a share of the lowest cosine components: only the remainder counts, in power and in freedom.
    """
    from scipy.fft import dct

    q, r = np.linalg.qr(_basis(n, rate_hz, mains_hz, lines_hz))
    components = min(MAX_COSINE_COMPONENTS, max(4, int(0.4 * n ** (2 / 3))))
    taken = float((dct(q, norm="ortho", axis=0)[1 : components + 1] ** 2).sum())
    return q, np.linalg.inv(r), components, components - taken


def _basis(n: int, rate_hz: float, mains_hz: float | None, lines_hz: tuple[float, ...]) -> Array:
    """Return 1, the time from -1 to 1, the lines, and the mains at frequencies without a line; (n, 2 + 2 (orders + lines))."""
    fitted = list(lines_hz)
    columns = [np.ones(n), np.linspace(-1, 1, n)]
    if mains_hz is not None:
        if n / rate_hz < 1 / mains_hz:
            raise ValueError(
                f"{1e3 * n / rate_hz:.3g} ms are shorter than a cycle of the mains ({mains_hz:g} Hz): "
                "take a longer window, or give mains_hz=None"
            )
        harmonics = [order * mains_hz for order in range(1, MAINS_ORDERS + 1) if order * mains_hz < 0.45 * rate_hz]
        fitted += [f for f in harmonics if all(abs(f - other) * n >= SEPARATION_BINS * rate_hz for other in lines_hz)]
    t = (np.arange(n) - 0.5 * (n - 1)) / rate_hz
    for f in fitted:
        columns += [np.sin(2 * np.pi * f * t), np.cos(2 * np.pi * f * t)]
    return np.stack(columns, axis=1)


LEVEL_TOLERANCE = 0.01
"""Share of the step within which a sample counts as at the level, if noise is smaller."""

NOISE_FACTOR = 5.0


@dataclass(frozen=True, slots=True)
class DetectedRamp:
    """A ramp in a record; times from its first sample.

    Attributes:
        begin_s, end_s: the last moment at the old level, the first at the new one; equal without a ramp.
        start_level_v, end_level_v: the two levels.
    """

    begin_s: float
    end_s: float
    start_level_v: float
    end_level_v: float

    @property
    def duration_s(self) -> float:
        """Duration of the ramp."""
        return self.end_s - self.begin_s

    def effective_time_s(self, since_s: Array) -> Array:
        """Return the times since an ideal step with the same creep as the ramp at `since_s` after its end.

        Creep with the logarithm of time after a step becomes, after a straight ramp, its average over the ramp: ln t_eff = ((t +
        T) ln (t + T) - t ln t) / T - 1 for a ramp of T that ended t ago.
        """
        ramp = self.duration_s
        if ramp <= 0:
            return since_s
        whole = since_s + ramp
        return np.asarray(np.exp((whole * np.log(whole) - since_s * np.log(since_s)) / ramp - 1))


def find_ramp(drive_v: Array, rate_hz: float, hold_s: float, rest_s: float) -> DetectedRamp:
    """Return the ramp of a record that begins with at least `rest_s` at one level and ends with `hold_s` at another.

    Args:
        drive_v: (N,), volts.
        rate_hz: samples per second.
        hold_s: time at its end that is certainly at a level.
        rest_s: time at its begin that is certainly at a level.

    Raises:
        ValueError: the record is shorter than both times.
    """
    first, last = round(rest_s * rate_hz), round(hold_s * rate_hz)
    if first < 2 or last < 4 or first + last > drive_v.size:
        raise ValueError(
            f"a record of {drive_v.size / rate_hz:g} s holds no {rest_s:g} s of rest and {hold_s:g} s of level"
        )
    before, after = drive_v[:first], drive_v[-(last // 2) :]
    before_v, level_v = float(before.mean()), float(after.mean())
    step_v = level_v - before_v
    noise_v = max(float(before.std()), float(after.std()))
    near_v = max(NOISE_FACTOR * noise_v, LEVEL_TOLERANCE * abs(step_v))
    if abs(step_v) <= 2 * near_v:  # a level equal to rest begins with the hold
        at_s = (drive_v.size - last) / rate_hz
        return DetectedRamp(at_s, at_s, before_v, level_v)
    half = int(np.argmax(np.sign(step_v) * (drive_v - before_v) > abs(step_v) / 2))
    left = np.flatnonzero(np.abs(drive_v[:half] - before_v) <= near_v)
    reached = np.flatnonzero(np.abs(drive_v[half:] - level_v) <= near_v)
    begin_s, end_s = float(left[-1] + 1) / rate_hz, float(half + reached[0]) / rate_hz
    # The point nearest to the end that differs from the noise lies slightly inside the ramp: the line is extrapolated to its ends.
    inside_s = (end_s - begin_s) * near_v / (abs(step_v) - 2 * near_v)
    return DetectedRamp(max(begin_s - inside_s, 0.0), end_s + inside_s, before_v, level_v)


def weighted_fit(columns: Sequence[Array], y: Array, weight: Array) -> tuple[Array, Array]:
    """Return coefficients of columns, (N,) each, and their covariance by least squares; significant scatter widens it.

    `weight` is the inverse standard error of each y, (N,).
    """
    basis = np.stack(columns, axis=1) * weight[:, None]
    inverse = np.asarray(np.linalg.inv(basis.T @ basis), float)
    coefficients = inverse @ basis.T @ (y * weight)
    left = y * weight - basis @ coefficients
    return coefficients, inverse * misfit_factor(float(left @ left), y.size - len(columns)) ** 2


BINS_PER_DECADE = 20
"""Bins of the logarithm of time for averages: the late decades have nearly all samples without more information."""

MIN_BINS = 8


@dataclass(frozen=True, slots=True)
class CreepFit:
    """x(t) = value + per_decade log10(t / 1 s), in the unit of the samples.

    Attributes:
        value, value_error: value after a second, and its standard error.
        per_decade, per_decade_error: growth from t to 10 t.
        degrees_of_freedom: of the standard errors.
    """

    value: float
    value_error: float
    per_decade: float
    per_decade_error: float
    degrees_of_freedom: int


def fit_creep(time_s: ArrayLike, samples: ArrayLike, zero: float = 0.0) -> CreepFit:
    """Fit creep after a step.

    The errors are from the scatter of the bins about the line, each weighted with its number of samples; slow noise increases the
    scatter and is included.

    Args:
        time_s: (N,), time since the step, rising; all > 0.
        samples: (N,), sensor signal.
        zero: the level before the step.

    Raises:
        ValueError: not finite, a time <= 0, or less than half a decade.
    """
    t, x = check_samples("time", time_s, MIN_BINS), check_samples("the creep", samples, MIN_BINS)
    if t.size != x.size:
        raise ValueError(f"{t.size} times and {x.size} samples are given: they must be as many")
    if not t[0] > 0 or np.any(np.diff(t) <= 0):
        raise ValueError(f"the times must rise from above 0 (the first is {t[0]:g} s): creep is counted from the step")
    decades = float(np.log10(t[-1] / t[0]))
    if decades < 0.5:
        raise ValueError(
            f"from {t[0]:g} to {t[-1]:g} s are {decades:.2f} decades, at least 0.5 are needed: record longer, or from earlier on"
        )
    log = np.log10(t)
    edges = np.linspace(log[0], log[-1], int(np.ceil(decades * BINS_PER_DECADE)) + 1)[:-1]
    starts = np.unique(np.searchsorted(log, edges))
    counts = np.diff(np.append(starts, t.size))
    # Means of the regressors, not their values at the bins' middles: the fit is then exact for a bin of any width.
    basis = np.stack([np.add.reduceat(c, starts) / counts for c in (np.ones(t.size), log)], axis=1)
    binned = np.add.reduceat(x - zero, starts) / counts
    freedom = counts.size - basis.shape[1]
    if counts.size < MIN_BINS:
        raise ValueError(
            f"{t.size} samples fill {counts.size} bins of time, at least {MIN_BINS} are needed: sample faster"
        )
    weight = np.sqrt(counts)
    q, r = np.linalg.qr(basis * weight[:, None])
    solution = np.linalg.solve(r, q.T @ (binned * weight))
    left = weight * (binned - basis @ solution)
    inverse = np.linalg.inv(r)
    errors = np.sqrt((inverse**2).sum(1) * float(left @ left) / freedom)
    return CreepFit(float(solution[0]), float(errors[0]), float(solution[1]), float(errors[1]), freedom)
