"""Figures of a run for comparisons over months: estimates and largest amplitude, with statistical and total uncertainty."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from app.common import LENGTH_UNITS
from protocols.runfile.overview import LargestPoint, RunOverview

LARGEST = "largest max - min"
MARGIN = "margin at the largest"
AMPLITUDE_PROTOCOL = "sine-dwell"
LATENCY_PROTOCOL = "latency"
FELT = "latency to"
"""How the names of times to the threshold begin."""
BETWEEN = "rise, after a step"
"""How the names of times between two moments of a response begin, which the sensor's delay does not shift."""


class RunFigure(NamedTuple):
    """A figure of one run, SI.

    Attributes:
        statistical: standard uncertainty by the scatter of the points alone.
        total: standard uncertainty with that of the sensor's gain, which is common to all runs of a calibration.
        condition: what it depends on, such as the drive; figures of different conditions are not compared.
        frequency_hz: at which it was measured, for the margin over a threshold that depends on it; 0 for others.
    """

    name: str
    value: float
    statistical: float
    total: float
    unit: str
    condition: str = ""
    frequency_hz: float = 0.0


def run_figures(run: RunOverview) -> tuple[RunFigure, ...]:
    """Return the figures of a run; without those that are not finite."""
    gain = run.sensor.gain_relative_uncertainty
    found = [
        _figure(e.name, e.value, e.standard_error, e.unit, gain if e.unit in LENGTH_UNITS else 0.0)
        for e in run.estimates
    ]
    if run.protocol == LATENCY_PROTOCOL:
        found = _latency_figures(run, found)
    if run.protocol == AMPLITUDE_PROTOCOL and run.largest is not None:
        found += _amplitude_figures(run.largest, gain)
    return tuple(f for f in found if math.isfinite(f.value) and math.isfinite(f.total))


def _latency_figures(run: RunOverview, figures: list[RunFigure]) -> list[RunFigure]:
    """Return the figures of a latency run with the sensor's delay and gain in their total uncertainty.

    An error of the delay shifts all times from an onset. An error of the gain moves the threshold, which the displacement reaches
    at the measured speed; shares of the final value do not depend on it.
    """
    sensor, threshold_m = run.sensor, float(run.parameters["threshold_m"])
    speeds = {f.name.partition(", ")[2]: f.value for f in figures if f.unit == "m/s"}
    total = []
    for figure in figures:
        name, _, onset = figure.name.partition(", ")
        from_onset = figure.unit == "s" and not figure.name.startswith(BETWEEN)
        delay_s = sensor.delay_uncertainty_s if from_onset else 0.0
        timed = name.startswith(FELT) and speeds.get(onset, 0.0) > 0
        moved_s = sensor.gain_relative_uncertainty * threshold_m / speeds[onset] if timed else 0.0
        total.append(figure._replace(total=math.hypot(figure.total, delay_s, moved_s)))
    return total


def _amplitude_figures(top: LargestPoint, gain: float) -> Iterator[RunFigure]:
    """Yield the largest max - min of the usable points, and its margin over the perception threshold of the abdomen."""
    from model.response import perception_margin  # slow to import

    y, error = top.peak_to_peak_m, top.error_m
    condition = f"{2 * top.median_drive_v:.2g} V"
    yield _figure(LARGEST, y, error, "m", gain, condition)
    margin = float(perception_margin(np.array([top.frequency_hz]), np.array([y]))[0])
    over = _figure(MARGIN, margin, margin * error / y if y else math.nan, "1", gain, condition)
    yield over._replace(frequency_hz=top.frequency_hz)


def _figure(name: str, value: float, error: float, unit: str, gain: float, condition: str = "") -> RunFigure:
    return RunFigure(name, float(value), float(error), math.hypot(error, gain * value), unit, condition)
