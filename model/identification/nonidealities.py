"""Nonidealities of a real specimen and its instruments, as parameters of the fit: what the beam model leaves out.

At their defaults they change nothing. Each can be free, fixed or have a prior, like a parameter of the model.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from annotated_types import Interval

from model import Array, ParameterSpec

Values = Mapping[str, Any]

NONIDEALITIES = {
    spec.name: spec
    for spec in (
        ParameterSpec(
            "mass_fraction", "1", Interval(gt=0), "share of the masses put in the cylinder that acts at the centre", 1.0
        ),
        ParameterSpec(
            "mass_offset", "kg", Interval(), "mass of cylinder and glue, or an error common to all added masses", 0.0
        ),
        ParameterSpec(
            "mass_put_in",
            "kg",
            Interval(ge=0),
            "mass put in the cylinder for the dwells, of which m_add acts; 0: unknown, m_add is identified by itself",
            0.0,
        ),
    )
}
DEFAULTS: dict[str, Any] = {name: spec.default for name, spec in NONIDEALITIES.items()}


def acting_mass(v: Values, mass_kg: Any) -> Any:
    """Return the mass that acts at the centre, kg, of one that was put in the cylinder: a number, or (S,) for S sets."""
    return v["mass_fraction"] * mass_kg + v["mass_offset"]


def acting_masses(v: Values, mass_kg: Array) -> Array:
    """Return the masses that act, (S, F), of those put in, (S, F)."""
    return np.asarray(np.reshape(v["mass_fraction"], (-1, 1)) * mass_kg + np.reshape(v["mass_offset"], (-1, 1)))


def with_acting_mass(v: Values) -> Values:
    """Return the parameters with the m_add that follows from a known `mass_put_in`."""
    return {**v, "m_add": acting_mass(v, v["mass_put_in"])} if np.any(v["mass_put_in"]) else v
