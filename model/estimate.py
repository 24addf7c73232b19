"""Estimated quantity: value, standard error, unit and source, in run files, fits and calibrations."""

from dataclasses import dataclass
from typing import Self

from model.quantities import find_quantity


@dataclass(frozen=True, slots=True)
class EstimatedQuantity:
    """An identified quantity: value and standard error in `unit`; `source` is its origin or the names of the runs."""

    name: str
    value: float
    standard_error: float
    unit: str
    source: str | tuple[str, ...]

    @classmethod
    def listed(cls, name: str, value: float, standard_error: float, source: str) -> Self:
        """Return the estimate of a listed quantity, `natural_frequency` or `compliance, MFC up`, in its SI unit.

        Raises:
            KeyError: `name` begins with no identifier of `model.quantities`.
        """
        if (quantity := find_quantity(name)) is None:
            raise KeyError(name)
        return cls(name, value, standard_error, quantity.unit, source)
