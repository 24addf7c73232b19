"""What a run's specimen is for given values of the parameters: its beam, its skin, the factors of its equation of motion.

`v` holds every parameter by name: plain numbers, or arrays (S,) of as many sets.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.identification import names as known
from model.identification.observations import FrequencyResponse
from model.identification.receptance import Factors
from model.parameters import Beam
from model.skin import point_stiffness

Array = NDArray[np.float64]
Values = Mapping[str, Any]


def beam_of(v: Values, added_mass_kg: Any = None) -> Beam:
    """The beam with its own added mass, or another."""
    k1 = v["E_Al"] * v["b_Al"] * v["h_Al"] ** 3 / 12
    eta = (v["m_add"] if added_mass_kg is None else added_mass_kg) / (2 * (v["L"] - v["L2"]))
    return Beam(v["L"], v["L1"], v["L2"], v["rho1"], v["rho2"], eta, v["c0"], k1, v["k2"], v["mu"])


def skin_of(run: FrequencyResponse, v: Values) -> tuple[Any, Any]:
    """k_s in N/m^2 and c_s in kg/(m s) under a run; 0 where the tactor was free."""
    if run.elongation_m is None:
        return 0.0, 0.0
    delta = run.elongation_m / v["L_m"]
    length = v["L"] - v["L2"] if v["contact_length"] is None else v["contact_length"]
    k_s, c_s = v.get(known.at("k_s", run.elongation_m)), v.get(known.at("c_s", run.elongation_m))
    if k_s is None:
        k_s = point_stiffness(v["L_m"], v["b_m"], v["h_m"], v["E_m"], delta) / length
    return k_s, v["c_s_delta"] * delta + v["c_s_0"] if c_s is None else c_s


def factors_of(beam: Beam, skin: tuple[Any, Any], sets: int) -> Factors:
    """What multiplies the Gram parts of Eq. (14), (S, 6) each in M, C and K."""
    zero = np.zeros(sets)
    L, L3 = beam.L, beam.L**3
    k_s, c_s = skin

    def table(*columns: Any) -> Array:
        return np.stack([zero + c for c in columns], axis=-1)

    return Factors(
        table(L * beam.rho1, L * beam.rho2, L * (beam.rho2 + beam.eta), 0, 0, 0),
        table(L * beam.c0, L * beam.c0, L * (beam.c0 + c_s), 0, 0, 0),
        table(0, 0, L * k_s, beam.k1 / L3, beam.k2 / L3, beam.k2 / L3),
    )
