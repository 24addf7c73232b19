"""Estimated quantity: value, standard error, unit and source, in run files, fits and calibrations."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class EstimatedQuantity:
    """An identified quantity: value and standard error in `unit`; `source` is its origin or the names of the runs."""

    name: str
    value: float
    standard_error: float
    unit: str
    source: str | tuple[str, ...]
