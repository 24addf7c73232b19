"""Uncertainty budget: statistical and total uncertainty of identified parameters, and the share of every source (GUM)."""

from dataclasses import dataclass

import numpy as np

from model import Array
from model.identification.fit_result import JointFit
from model.identification.observations import ErrorTarget, SharedError

NOISE = "noise"
"""Source of the statistical uncertainty: scatter of the measured points."""
INPUT_SOURCES: dict[ErrorTarget, str] = {
    "load": "weights",
    "mass": "added masses",
    "level": "voltage levels",
    "elongation": "elongations",
    "frequency": "frequencies",
    "rest": "drive before the runs",
}
"""Source of the many errors of single inputs: each weight, mass or level; and of drifts at rest."""


@dataclass(frozen=True)
class UncertaintyBudget:
    """Standard uncertainty of each parameter, split into independent sources; its square is the sum of their squares.

    Attributes:
        names: the parameters, (P,).
        sources: noise, shared errors of instruments, and prior values, (S,).
        components: contribution of each source to the standard uncertainty of each parameter, (S, P).
    """

    names: tuple[str, ...]
    sources: tuple[str, ...]
    components: Array

    @property
    def statistical(self) -> Array:
        """(P,): from the scatter of the points; decreases with more points."""
        return np.asarray(self.components[0])

    @property
    def systematic(self) -> Array:
        """(P,): from all other sources; independent of the number of points."""
        return np.asarray(np.sqrt((self.components[1:] ** 2).sum(axis=0)))

    @property
    def total(self) -> Array:
        """(P,): from all sources."""
        return np.asarray(np.sqrt((self.components**2).sum(axis=0)))

    @property
    def shares(self) -> Array:
        """(S, P): shares of the squared total; every column sums to 1."""
        squares = self.components**2
        total = squares.sum(axis=0)
        return np.asarray(squares / np.where(total > 0, total, 1.0))


def uncertainty_budget(fit: JointFit) -> UncertaintyBudget:
    """Split the uncertainties of a fit's estimates by source.

    An estimate is a weighted sum of the readings and of the prior values; the uncertainty of each of these is multiplied by its
    weight. Errors of all runs, enlarged by their misfit, are the statistical part.
    """
    names = tuple(e.name for e in fit.estimates())
    at = [fit.names.index(name) for name in names]
    squares = fit.row_influences[at] ** 2
    rows = fit.prior_rows
    first = min(rows.values(), default=squares.shape[1])
    components = {NOISE: squares[:, :first].sum(axis=1)}
    shared = fit.observations.shared_errors
    for name, row in rows.items():
        source = _source(shared[name]) if name in shared else name
        components[source] = components.get(source, np.zeros(len(names))) + squares[:, row]
    for source, shift in fit.further_shifts:
        components[source] = components.get(source, np.zeros(len(names))) + np.array(shift)[at] ** 2
    return UncertaintyBudget(names, tuple(components), np.sqrt(np.array(list(components.values()))))


def _source(error: SharedError) -> str:
    if error.source:
        return error.source
    return error.name if error.at is None else INPUT_SOURCES.get(error.acts_on, error.name)
