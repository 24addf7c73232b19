"""Figures of a run for comparisons over months: estimates and largest amplitude, with statistical and total uncertainty."""

import math
from collections.abc import Iterator

from app.common import LENGTH_UNITS
from protocols import aspects_of
from protocols.base import INTERFERENCE_AT_REST, RunFigure
from protocols.runfile import RunReadError, RunRecord


def run_figures(run: RunRecord) -> Iterator[RunFigure]:
    """Yield the figures of a run; without those that are not finite. Estimates stand in for a laboratory's figures that fail."""
    for figure in figures_and_fault(run)[0]:
        if math.isfinite(figure.value) and math.isfinite(figure.total):
            yield figure


def figures_and_fault(run: RunRecord) -> tuple[tuple[RunFigure, ...], str]:
    """Return the figures of a run, and the reason why those of its protocol failed, empty otherwise."""
    gain = run.sensor.gain_relative_uncertainty
    estimates = [
        RunFigure.with_gain(e.name, e.value, e.standard_error, e.unit, gain if e.unit in LENGTH_UNITS else 0.0)
        for e in run.estimates
    ]
    own = [figure for figure in estimates if figure.name != INTERFERENCE_AT_REST]
    added = [figure for figure in estimates if figure.name == INTERFERENCE_AT_REST]
    try:
        return (*aspects_of(run.protocol).run_figures(run, own), *added), ""
    except RunReadError as error:
        return (*own, *added), str(error)
