"""Figures of a run for comparisons over months: estimates and largest amplitude, with statistical and total uncertainty."""

import math

from app.common import run_figure
from protocols import aspects_of
from protocols.base import INTERFERENCE_AT_REST, RunFigure
from protocols.runfile import RunReadError, RunRecord


def run_figures(run: RunRecord) -> tuple[RunFigure, ...]:
    """Return the finite figures of a run; its estimates where the figures of a laboratory's protocol fail."""
    return figures_and_fault(run)[0]


def figures_and_fault(run: RunRecord) -> tuple[tuple[RunFigure, ...], str]:
    """Return the finite figures of a run, and the error of its protocol's own figures; empty without an error."""
    gain = run.sensor.gain_relative_uncertainty
    estimates = [run_figure(each, gain) for each in run.estimates]
    own = [figure for figure in estimates if figure.name != INTERFERENCE_AT_REST]
    added = [figure for figure in estimates if figure.name == INTERFERENCE_AT_REST]
    try:
        own, fault = [*aspects_of(run.protocol).run_figures(run, own)], ""
    except RunReadError as error:
        fault = str(error)
    finite = (each for each in (*own, *added) if math.isfinite(each.value) and math.isfinite(each.total))
    return tuple(finite), fault
