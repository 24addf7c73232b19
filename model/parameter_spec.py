"""Parameter specifications: unit, limits and meaning, read from the annotation of a field.

A field is `Annotated[float, Unit("m"), Interval(gt=0), "definition"]`, or `Annotated[float, Interval(gt=0)]` where its quantity
is listed in `model.quantities`. Validation, forms, command-line options and file attributes all use it.
"""

import dataclasses
import operator
from functools import cache
from typing import Any, Self, get_type_hints

import numpy as np
from annotated_types import Interval, Unit
from numpy.typing import ArrayLike

from model.arrays import Array, Mask
from model.quantities import QUANTITIES


class ParameterError(ValueError):
    """A value that is not physical; the message names the parameter, the value, the limit and the remedy."""


@dataclasses.dataclass(frozen=True, slots=True)
class ParameterSpec:
    """One parameter: its name, SI unit, limits, meaning and default (None where there is none)."""

    name: str
    unit: str
    interval: Interval
    description: str
    default: float | None

    @classmethod
    def listed(cls, name: str, interval: Interval, default: float | None) -> Self:
        """Return the parameter with unit and definition of the quantity of its name."""
        return cls(name, QUANTITIES[name].unit, interval, QUANTITIES[name].definition, default)

    @property
    def limits(self) -> str:
        """The limits as text, e.g. "greater than 0 m"; every quantity is also finite."""
        bounds = (
            ("greater than", self.interval.gt),
            ("at least", self.interval.ge),
            ("less than", self.interval.lt),
            ("at most", self.interval.le),
        )
        parts = [
            f"{word} {bound:g} {self.unit.removesuffix('1')}".strip()
            for word, bound in bounds
            if isinstance(bound, int | float)
        ]
        return " and ".join(parts) or "finite"

    def is_valid(self, values: ArrayLike) -> Mask:
        """Mask of `values` (any shape): finite and within the limits."""
        v = np.asarray(values, float)
        inside = np.asarray(np.isfinite(v))
        for compare in (operator.gt, operator.ge, operator.lt, operator.le):
            if (bound := getattr(self.interval, compare.__name__)) is not None:
                inside &= compare(v, bound)
        return inside

    def check(self, values: object) -> Array:
        """`values` as floats; raises ParameterError naming the first one that is not a number, not finite or outside."""
        try:
            v = np.asarray(values)
            if v.dtype.kind not in "iuf":
                raise TypeError
        except (TypeError, ValueError):
            raise ParameterError(
                f"{self.name} ({self.description}) is {values!r}: give a real number in {self.unit}"
            ) from None
        v = v.astype(float, copy=False)
        inside = self.is_valid(v)
        if not inside.all():
            worst = float(v[~inside].flat[0])
            raise ParameterError(
                f"{self.name} ({self.description}) is {worst:g} {self.unit}: it must be {self.limits}; give a value in that range"
            )
        return v


@cache
def parameter_specs(cls: type[Any]) -> tuple[ParameterSpec, ...]:
    """The annotated fields of dataclass `cls`, in order; fields without annotation are left out."""
    hints = get_type_hints(cls, include_extras=True)
    specs = []
    for field in dataclasses.fields(cls):
        marks = getattr(hints[field.name], "__metadata__", ())
        interval = next((m for m in marks if isinstance(m, Interval)), Interval())
        default = None if field.default is dataclasses.MISSING else field.default
        if (unit := next((m.unit for m in marks if isinstance(m, Unit)), None)) is not None:
            description = next((m for m in marks if isinstance(m, str)), field.name)
            specs.append(ParameterSpec(field.name, unit, interval, description, default))
        elif marks:
            specs.append(ParameterSpec.listed(field.name, interval, default))
    return tuple(specs)


def validate_parameters(obj: object) -> None:
    """Check every annotated field of the dataclass instance `obj`; raises ParameterError for the first that fails."""
    cls: Any = type(obj)
    for quantity in parameter_specs(cls):
        quantity.check(getattr(obj, quantity.name))


PERIODIC_FREQUENCY_SPEC = ParameterSpec("frequency", "Hz", Interval(gt=0), "frequency of a periodic drive", None)
"""Frequency of responses and thresholds; defined here, so that a threshold does not load the beam model."""
