"""Figures of a run for comparisons over months: estimates and largest amplitude, with statistical and total uncertainty."""

import math
from collections.abc import Iterator

from app.common import LENGTH_UNITS
from protocols import aspects_of
from protocols.base import INTERFERENCE_AT_REST, RunFigure
from protocols.runfile import RunRecord


def run_figures(run: RunRecord) -> Iterator[RunFigure]:
    """Yield the figures of a run; without those that are not finite."""
    gain = run.sensor.gain_relative_uncertainty
    estimates = [
        RunFigure.with_gain(e.name, e.value, e.standard_error, e.unit, gain if e.unit in LENGTH_UNITS else 0.0)
        for e in run.estimates
    ]
    own = [figure for figure in estimates if figure.name != INTERFERENCE_AT_REST]
    added = (figure for figure in estimates if figure.name == INTERFERENCE_AT_REST)
    for figure in (*aspects_of(run.protocol).run_figures(run, own), *added):
        if math.isfinite(figure.value) and math.isfinite(figure.total):
            yield figure
