"""Calibration of a specimen: the accepted estimates as a versioned record."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from math import isfinite, sqrt
from typing import Any, Self

import numpy as np

from model import EstimatedQuantity, Membrane, ParameterError, Tactor, parameter_specs, variable_specs
from model.studies import EstimateSet


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """One parameter in two calibrations; None for a calibration without it."""

    name: str
    unit: str
    before: float | None
    after: float | None
    sigmas: float | None
    """The difference in units of its own standard error, both calibrations taken as independent."""


_TYPES = {"version": int, "simulated": bool} | dict.fromkeys(("fixed", "reduced", "known", "statistical"), Mapping)
"""Types of a record's values other than text."""


_NEWER = ("doubt", "reason", "known", "statistical", "dimensions")
"""Names that a record omits if they have no value."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Accepted estimates of one specimen with their covariance; `as_record` and `from_record` convert to and from files.

    Raises:
        ParameterError: the covariance does not belong to the estimates, or is not a covariance.
    """

    specimen: str
    version: int
    estimates: tuple[EstimatedQuantity, ...]
    covariance: tuple[tuple[float, ...], ...]
    """(P, P), rows and columns as the estimates, in their units."""
    method: str
    runs: tuple[str, ...]
    code: str
    """Version of the program of the identification."""
    accepted_at: str
    """Time of acceptance, ISO 8601."""
    accepted_by: str
    simulated: bool
    fixed: Mapping[str, float | None]
    """Fixed values of all other parameters; a contact length of None is L - L2."""
    note: str = ""
    reduced: Mapping[str, Any] = field(default_factory=dict)
    """The bench file whose calibration was used to reduce the raw samples again; empty for runs used as stored."""
    doubt: str = ""
    """Reason for a decision: the model is not adequate for the runs, or was not tested; empty for an adequate model."""
    reason: str = ""
    """Reason of the person who accepted a doubtful result."""
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Prior value and standard uncertainty of estimates with a prior, such as lengths."""
    statistical: Mapping[str, float] = field(default_factory=dict)
    """Statistical part of an estimate's standard error, by name; empty in older records."""
    dimensions: str = ""
    """Source of dimensions and masses, as text; empty if they are exact."""

    def __post_init__(self) -> None:
        P = len(self.estimates)
        S = np.asarray(self.covariance, float)
        if S.shape != (P, P):
            raise ParameterError(f"calibration of {self.specimen}: {P} estimates need a {P} x {P} covariance")
        for i, e in enumerate(self.estimates):
            if not (isfinite(e.value) and abs(sqrt(max(S[i, i], 0)) - e.standard_error) <= 1e-6 * e.standard_error):
                raise ParameterError(
                    f"calibration of {self.specimen}: standard error of {e.name} is {e.standard_error:g}, its variance "
                    f"{S[i, i]:g}: the record is damaged; accept the estimates again"
                )

    @property
    def decision(self) -> str:
        """Doubt and reason as text; empty for an adequate result."""
        return f"{self.doubt}. Accepted all the same: {self.reason}" if self.doubt else ""

    def tactor(self) -> Tactor:
        """The tactor with these estimates."""
        return Tactor(**{q.name: self._value(q.name) for q in parameter_specs(Tactor)})

    def membrane(self) -> Membrane:
        """The membrane with these estimates."""
        return Membrane(**{q.name: self._value(q.name) for q in parameter_specs(Membrane)})

    def estimate_set(self) -> EstimateSet:
        """The estimates of model variables, for `model.studies.uncertainties.linear_band`."""
        keep = [i for i, e in enumerate(self.estimates) if e.name in variable_specs()]
        return EstimateSet(
            tuple(self.estimates[i].name for i in keep),
            tuple(self.estimates[i].value for i in keep),
            np.asarray(self.covariance, float)[np.ix_(keep, keep)],
        )

    def as_record(self) -> dict[str, Any]:
        """Plain nested values, ready for JSON."""
        record = asdict(self) | {"kind": "calibration", "fixed": dict(self.fixed), "reduced": dict(self.reduced)}
        record["known"] = {name: list(pair) for name, pair in self.known.items()}
        record["statistical"] = dict(self.statistical)
        return {name: value for name, value in record.items() if value or name not in _NEWER}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """Return the calibration of a record made by `as_record`.

        Raises:
            ParameterError: a key is missing or unknown, or a value does not fit.
        """
        names = {f.name for f in fields(cls)}
        given = set(record) - {"kind"} | {"reduced", *_NEWER}  # absent in older records
        if record.get("kind") != "calibration" or given != names:
            missing, unknown = ", ".join(sorted(names - given)), ", ".join(sorted(given - names))
            raise ParameterError(
                f"this is not a calibration record: missing {missing or 'nothing'}; unknown {unknown or 'nothing'}"
            )
        try:
            estimates = tuple(EstimatedQuantity(**{**e, "source": tuple(e["source"])}) for e in record["estimates"])
            covariance = tuple(tuple(float(x) for x in row) for row in record["covariance"])
            rest = {k: v for k, v in record.items() if k in names - {"estimates", "covariance", "runs", "known"}}
            for name, value in rest.items():
                if not isinstance(value, _TYPES.get(name, str)):
                    raise TypeError(f"{name} is {value!r:.40}")
            stated = {name: (float(value), float(error)) for name, (value, error) in record.get("known", {}).items()}
            return cls(estimates=estimates, covariance=covariance, runs=tuple(record["runs"]), known=stated, **rest)
        except (TypeError, KeyError, ValueError, AttributeError) as error:
            raise ParameterError(f"this calibration record is damaged: {error}; accept the estimates again") from None

    def _value(self, name: str) -> float:
        value = next((e.value for e in self.estimates if e.name == name), None)
        value = self.fixed.get(name) if value is None else value
        if value is None:
            raise ParameterError(f"calibration of {self.specimen} has no {name}: identify it, or give it as fixed")
        return float(value)


def compare_calibrations(before: Calibration, after: Calibration) -> tuple[ParameterChange, ...]:
    """Return the differences of two calibrations, parameter by parameter, in the order of the newer one."""
    old, new = ({e.name: e for e in c.estimates} for c in (before, after))
    out = []
    for name in (*new, *(n for n in old if n not in new)):
        a, b = old.get(name), new.get(name)
        size = None
        if a is not None and b is not None:
            spread = sqrt(a.standard_error**2 + b.standard_error**2)
            size = (b.value - a.value) / spread if spread > 0 else None
        unit = (b or a).unit  # type: ignore[union-attr]
        out.append(ParameterChange(name, unit, a.value if a else None, b.value if b else None, size))
    return tuple(out)
