"""Hysteresis loops of displacement over drive: width, area, asymmetry, errors from repeatability.

The spread of one figure over five cycles is itself known to a third only, and a fit weighted by such errors is dominated by loops
that happened to agree. What a cycle differs by from the mean loop is therefore added to it at several phases, as noise does not know
the phase of the drive, and the error of every figure is the spread of the figure over cycles, its variance the mean over these phases.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from model import Array
from protocols.signals.checks import check_positive, check_samples

MIN_POINTS = 8
GRID_LEVELS = 64
"""Drive levels at which rising and falling branch are compared."""
TURNS = 16
"""Phases at which the noise of a cycle is added to the mean loop."""


@dataclass(frozen=True, slots=True)
class HysteresisLoop:
    """Hysteresis, averaged over cycles; each figure with its standard error: spread over the cycles, and interference.

    Attributes:
        width, width_error: falling minus rising branch at the middle of the drive's range, unit of the displacement.
        max_width, max_width_error: the largest width.
        stroke, stroke_error: displacement at the highest drive minus displacement at the lowest.
        area, area_error: integral of the width over the drive, displacement times drive; positive for a lag.
        asymmetry, asymmetry_error: area above the middle of the drive minus area below it, over the area; -1..1.
        noise: the error of the width without interference.
        degrees_of_freedom: cycles - 1.
    """

    width: float
    width_error: float
    max_width: float
    max_width_error: float
    stroke: float
    stroke_error: float
    area: float
    area_error: float
    asymmetry: float
    asymmetry_error: float
    noise: float
    degrees_of_freedom: int

    @property
    def relative_width(self) -> float:
        """Width over stroke: the hysteresis as in data sheets."""
        return self.width / self.stroke


def fold(samples: ArrayLike, rate_hz: float, period_s: float, points: int = 128, dropped: int = 1) -> Array:
    """Return the cycles of a periodic record, each averaged into `points` phases: (cycles, points).

    The period need not be a whole number of samples. Averaging over a phase lowers a sine by sin(pi / points) pi / points.

    Args:
        samples: (N,), from phase 0; an incomplete last cycle is left out.
        rate_hz: samples per second.
        period_s: period of the drive.
        points: number of phases of a cycle.
        dropped: number of cycles left out at the begin: the first loop starts at another point.

    Raises:
        ValueError: no cycle remains, or a phase holds no sample.
    """
    check_positive(rate_hz=rate_hz, period_s=period_s)
    x = check_samples("the record", samples, MIN_POINTS)
    per_cycle = period_s * rate_hz
    cycles = int((x.size + 1e-6) / per_cycle) - dropped
    if dropped < 0 or cycles < 1:
        raise ValueError(
            f"{x.size / per_cycle:.3g} cycles of {period_s:g} s were recorded and {dropped} are dropped: none remains"
        )
    if points < MIN_POINTS or per_cycle < 2 * points:
        raise ValueError(f"a cycle has {per_cycle:g} samples: not enough for {points} phases, at least two each")
    edges = np.ceil((dropped + np.arange(cycles * points + 1) / points) * per_cycle - 1e-6).astype(int)
    sums = np.add.reduceat(x[: edges[-1]], edges[:-1])
    return np.asarray(sums / np.diff(edges)).reshape(cycles, points)


def measure_loops(
    drive: ArrayLike, displacement: ArrayLike, interference: Mapping[int, float] | None = None
) -> HysteresisLoop:
    """Return width, area and asymmetry of repeated loops.

    Args:
        drive: (cycles, points), each cycle once around from anywhere, in equal steps of time or levels.
        displacement: likewise. One cycle is rejected, because it does not show repeatability.
        interference: amplitude, unit of the displacement, of what repeats with every cycle at an unknown phase, by harmonic order.

    Raises:
        ValueError: fewer than two cycles, not finite, or a drive that does not move.
    """
    x, y = np.asarray(drive, float), np.asarray(displacement, float)
    if x.shape != y.shape or x.ndim != 2:
        raise ValueError(f"drive {x.shape} and displacement {y.shape} must both be (cycles, points)")
    cycles, points = x.shape
    if cycles < 2 or points < MIN_POINTS:
        raise ValueError(
            f"{cycles} cycles of {points} points are given: at least 2 of {MIN_POINTS} are needed, "
            "because only repetition shows the error"
        )
    check_samples("the drive", x.ravel(), 1)
    check_samples("the displacement", y.ravel(), 1)
    if not np.ptp(x, axis=1).min() > 0:
        raise ValueError(f"the drive is constant at {x.flat[0]:g} for a whole cycle: there is no loop")
    figures = np.mean([_measure_cycle(*cycle) for cycle in zip(x, y, strict=True)], axis=0)
    drive_v, loop = x.mean(0), y.mean(0)
    centred = drive_v - drive_v.mean()
    # Cycles differ in drive by its noise, and by the samples that fall into a phase; figures at a level of the drive do not.
    noise = y - float(centred @ loop / (centred @ centred)) * x
    noise -= noise.mean(0)
    turns = range(0, points, max(points // TURNS, 1))
    spread = [
        np.var([_measure_cycle(drive_v, loop + np.roll(each, turn)) for each in noise], axis=0, ddof=1)
        for turn in turns
    ]
    variance = np.mean(spread, axis=0) / cycles
    interfered = variance + _interference_variance(drive_v, loop, interference or {})
    width, largest, stroke, area, asymmetry = zip(figures.tolist(), np.sqrt(interfered).tolist(), strict=True)
    return HysteresisLoop(
        *width, *largest, *stroke, *area, *asymmetry, noise=float(np.sqrt(variance[0])), degrees_of_freedom=cycles - 1
    )


def _interference_variance(drive: Array, loop: Array, interference: Mapping[int, float]) -> Array:
    """Return the variance of every figure of a loop, (points,) each, under sines of unknown phase, amplitude by harmonic order."""
    turn = 2 * np.pi * np.arange(drive.size) / drive.size
    variance = np.zeros(5)
    for order, size in interference.items():
        for sine in (np.sin(order * turn), np.cos(order * turn)):
            above, below = (np.array(_measure_cycle(drive, loop + by * sine)) for by in (size, -size))
            variance += 0.5 * (0.5 * (above - below)) ** 2
    return variance


def subtract_mean_line(drive: Array, displacement: Array) -> Array:
    """Return a closed loop less the mean of its rising and falling branch at the same drive, (N,).

    Args:
        drive: (N,), once around from anywhere.
        displacement: (N,).
    """
    low, top = int(drive.argmin()), int(drive.argmax())
    around = np.roll(np.arange(drive.size), -low)
    there = around[: (top - low) % drive.size + 1]
    back = np.append(around[(top - low) % drive.size :], low)
    rising, falling = (_branch(drive, drive[part], displacement[part]) for part in (there, back))
    return np.asarray(displacement - 0.5 * (rising + falling))


def _measure_cycle(x: Array, y: Array) -> tuple[float, ...]:
    """Return width in the middle, largest width, stroke, area and asymmetry of one cycle."""
    low = int(x.argmin())
    x, y = np.roll(x, -low), np.roll(y, -low)
    x, y = np.append(x, x[0]), np.append(y, y[0])
    top = int(x.argmax())
    level = np.linspace(x[0], x[top], GRID_LEVELS + 1)
    width = _branch(level, x[top:], y[top:]) - _branch(level, x[: top + 1], y[: top + 1])
    # The loop is a polygon: its area is exact (Gauss), while a grid misses the steep ends of the branches.
    area = 0.5 * float(np.sum(y[:-1] * x[1:] - y[1:] * x[:-1])) * -1
    largest = float(width[np.abs(width).argmax()])
    lower, upper = float(width[: GRID_LEVELS // 2].sum()), float(width[GRID_LEVELS // 2 + 1 :].sum())
    asymmetry = (upper - lower) / (upper + lower) if upper + lower else 0.0
    return float(width[GRID_LEVELS // 2]), largest, float(y[top] - y[0]), area, asymmetry


def _branch(level: Array, x: Array, y: Array) -> Array:
    """Return the displacement of one branch at drive levels; noise may exchange neighbours."""
    order = np.argsort(x, kind="stable")
    return np.asarray(np.interp(level, x[order], y[order]))
