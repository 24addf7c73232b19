"""Exact static deflection of the free tactor: under a load at its centre (Eq. 7) and under a voltage (Eq. 8).

The denominator of Eq. (7) is misprinted in the paper; see docs/decisions/0010-errors-in-the-paper.md.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from model import Array, Beam, Tactor
from model.response.harmonic_response import check_position


def load_compliance(tactor: Tactor | Beam) -> Any:
    """Centre deflection per newton at the centre, m/N: Eq. (7) with 24 k1 k2 [...] below. Floats, or a Beam of arrays."""
    L, L1, k1, k2 = tactor.L, tactor.L1, tactor.k1, tactor.k2
    above = (
        k1**2 * (L - L1) ** 4 + k2**2 * L1**4 - 2 * k1 * k2 * L1 * (-2 * L**3 + 3 * L**2 * L1 - 2 * L * L1**2 + L1**3)
    )
    return above / (24 * k1 * k2 * (k1 * (L - L1) + k2 * L1))


def voltage_gain(tactor: Tactor | Beam) -> Any:
    """Centre deflection per volt on the specimen, m/V: Eq. (8). Floats, or a Beam of arrays."""
    L, L1, k1, k2, mu = tactor.L, tactor.L1, tactor.k1, tactor.k2, tactor.mu
    return L * L1 * (L1 - L) / (2 * (k1 * (L - L1) + k2 * L1)) * mu


def deflection(tactor: Tactor, x: ArrayLike, volts: float = 0.0, load_n: float = 0.0) -> Array:
    """w(x), m, shape of x: `volts` on the specimen and `load_n` newtons at the centre together, no skin.

    The bending moment is F/2 (a - x) under the load and a constant under the voltage; both constants follow from
    w'(L) = 0.

    Raises:
        ParameterError: x lies outside 0..L.
    """
    x = check_position(tactor, x)
    L, L1, k1, k2 = tactor.L, tactor.L1, tactor.k1, tactor.k2
    flexibility = L1 / k1 + (L - L1) / k2
    a = (L1**2 / k1 + (L**2 - L1**2) / k2) / 2 / flexibility
    m = -tactor.mu * volts * (L - L1) / k2 / flexibility
    F = load_n / 2

    def bent(x: Array, start: float, moment: float, k: float) -> Array:
        """Double integral from `start` of (moment - F x) / k."""
        h = x - start
        return h * h * (moment - F * start - F * h / 3) / 2 / k

    def turned(x: float, start: float, moment: float, k: float) -> float:
        return (x - start) * (moment - F * (x + start) / 2) / k

    left = bent(np.minimum(x, L1), 0.0, F * a + m, k1)
    over = np.maximum(x - L1, 0.0)
    right = turned(L1, 0.0, F * a + m, k1) * over + bent(L1 + over, L1, F * a + m + tactor.mu * volts, k2)
    return np.asarray(left + right)
