"""Figures of a run for comparisons over months: estimates and largest amplitude, with statistical and total uncertainty."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from protocols.base import usable_mask
from protocols.runfile.reader import Run

LENGTH_UNITS = ("m", "m/V", "m/N")
"""Units of what scales with the gain of the displacement sensor."""
LARGEST = "largest max - min"
MARGIN = "margin at the largest"
AMPLITUDE_PROTOCOL = "sine-dwell"


class RunFigure(NamedTuple):
    """A figure of one run, SI.

    Attributes:
        statistical: standard uncertainty by the scatter of the points alone.
        total: standard uncertainty with that of the sensor's gain, which is common to all runs of a calibration.
        condition: what it depends on, such as the drive; figures of different conditions are not compared.
    """

    name: str
    value: float
    statistical: float
    total: float
    unit: str
    condition: str = ""


def run_figures(run: Run) -> tuple[RunFigure, ...]:
    """Return the figures of a run; without those that are not finite."""
    gain = run.sensor.gain_relative_uncertainty
    found = [
        _figure(e.name, e.value, e.standard_error, e.unit, gain if e.unit in LENGTH_UNITS else 0.0)
        for e in run.estimates()
    ]
    if run.protocol == AMPLITUDE_PROTOCOL and run.point_count:
        found += _amplitude_figures(run, gain)
    return tuple(f for f in found if math.isfinite(f.value) and math.isfinite(f.total))


def _amplitude_figures(run: Run, gain: float) -> Iterator[RunFigure]:
    """Yield the largest max - min of the usable points, and its margin over the perception threshold."""
    points = run.points()
    from model.response import perception_margin  # slow to import

    names = ("frequency", "peak_to_peak", "peak_to_peak_errors", "drive_amplitude", "quality")
    if not all(name in points for name in names):
        return
    f, y, errors, drive, quality = (np.asarray(points[name], float) for name in names)
    good = usable_mask(quality) & np.isfinite(y) & np.isfinite(errors) & (f > 0) & (drive > 0)
    if not good.any():
        return
    top = int(np.flatnonzero(good)[y[good].argmax()])
    condition = f"{2 * float(np.median(drive[good])):.2g} V"
    yield _figure(LARGEST, float(y[top]), float(errors[top]), "m", gain, condition)
    margin = float(perception_margin(f[top : top + 1], y[top : top + 1])[0])
    yield _figure(MARGIN, margin, margin * float(errors[top] / y[top]) if y[top] else math.nan, "1", gain, condition)


def _figure(name: str, value: float, error: float, unit: str, gain: float, condition: str = "") -> RunFigure:
    return RunFigure(name, float(value), float(error), math.hypot(error, gain * value), unit, condition)
