"""Uncertainty band of a curve from estimates with their covariance, linearised."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from model import Array, Mask, ParameterError, ParameterSpec, variable_specs

ParameterizedCurve = Callable[[Mapping[str, Array]], Array]
"""Function from arrays of P values by name to P curves, (P, F)."""


@dataclass(frozen=True, slots=True)
class EstimateSet:
    """Named values with their covariance, SI.

    Raises:
        ParameterError: an unknown name, a value that is not physical, or an invalid covariance.
    """

    names: tuple[str, ...]
    values: tuple[float, ...]
    covariance: Array
    """(P, P), in the units of the values."""
    specs: Mapping[str, ParameterSpec] = field(default_factory=variable_specs, repr=False)
    """Permitted values by name; default: the variables of the model."""

    def __post_init__(self) -> None:
        specs = self.specs
        if len(self.names) != len(self.values):
            raise ParameterError(
                f"estimates have {len(self.names)} names but {len(self.values)} values: give one value each"
            )
        for name, value in zip(self.names, self.values, strict=True):
            if name not in specs:
                raise ParameterError(f"{name} is not a variable of the model: choose from {', '.join(specs)}")
            specs[name].check(value)
        S = np.asarray(self.covariance, float)
        expected = (len(self.names), len(self.names))
        if S.shape != expected:
            raise ParameterError(f"covariance has shape {S.shape}: {len(self.names)} estimates need {expected}")
        if not np.isfinite(S).all() or (np.diag(S) < 0).any():
            raise ParameterError("covariance has a negative variance or is not finite: repeat the fit that gave it")
        d = np.sqrt(np.where(np.diag(S) > 0, np.diag(S), 1))
        correlation = S / np.outer(d, d)
        if not np.allclose(correlation, correlation.T) or np.linalg.eigvalsh(correlation).min() < -1e-8:
            raise ParameterError(
                "covariance is not symmetric and positive, so it is invalid; repeat the fit that gave it"
            )

    def without(self, names: Collection[str]) -> "EstimateSet | None":
        """Return the estimates without some names; None if nothing is left."""
        at = [i for i, name in enumerate(self.names) if name not in names]
        if not at:
            return None
        values = tuple(self.values[i] for i in at)
        return EstimateSet(
            tuple(self.names[i] for i in at), values, np.asarray(self.covariance)[np.ix_(at, at)], self.specs
        )


@dataclass(frozen=True, slots=True)
class UncertaintyBand:
    """A curve and the band around it, each of shape (F,), in the unit of the curve."""

    centre: Array
    standard_error: Array
    lower: Array
    upper: Array


def linear_band(curve: ParameterizedCurve, estimates: EstimateSet, coverage: float = 0.95) -> UncertaintyBand:
    """Band of normal errors through the curve's derivatives (differences over a thousandth of a standard error, away from physical limits).

    Raises:
        ParameterError: coverage outside 0..1.
    """
    from scipy.special import ndtri

    if not 0 < coverage < 1:
        raise ParameterError(f"coverage is {coverage}: it must lie between 0 and 1, e.g. 0.95")
    v = np.asarray(estimates.values)
    S = np.asarray(estimates.covariance)
    step = np.maximum(1e-5 * np.abs(v), 1e-3 * np.sqrt(np.diag(S)))
    step = np.where(step > 0, step, 1e-9)
    moved = v + np.diag(step)
    moved = np.where(_are_physical(estimates, moved)[:, None], moved, v - np.diag(step))
    w = curve(dict(zip(estimates.names, np.concatenate((v[None], moved)).T, strict=True)))
    J = (w[1:] - w[0]) / np.diag(moved - v)[:, None]
    error = np.sqrt(np.maximum(np.einsum("if,ij,jf->f", J, S, J), 0))
    reach = float(ndtri((1 + coverage) / 2)) * error
    return UncertaintyBand(w[0], error, w[0] - reach, w[0] + reach)


def _are_physical(estimates: EstimateSet, x: ArrayLike) -> Mask:
    columns = zip(estimates.names, np.asarray(x).T, strict=True)
    return np.asarray(np.all([estimates.specs[name].is_valid(a) for name, a in columns], axis=0))
