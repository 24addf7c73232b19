"""Hermite beam elements: Gram integrals of cubic shapes, which need fewer unknowns than the paper's shapes at high accuracy.

The unknowns are deflection and slope at the nodes; L1 and L2 are nodes, so that the jump of w'' at L1 costs no accuracy.
(Przemieniecki, Theory of Matrix Structural Analysis, 1968, ch. 5 and 11.)
"""

import numpy as np

from model import Array, ParameterError
from model.beam.galerkin import Gram

MASS = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]) / 420
BENDING = np.array([[12.0, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
SLOPE_POWERS = np.array([0, 1, 0, 1])
"""A slope times the length of its element has the size of a deflection."""


def hermite_gram(l1: float | Array, l2: float | Array, n: int) -> Gram:
    """Gram integrals of `n` unknowns for L1 / L = l1 and L2 / L = l2, as `gram` has them for the paper's shape functions.

    Each of the three segments has (n + 1) / 6 elements.

    Raises:
        ParameterError: n is not 5, 11, 17 and so on up to 299.
    """
    per_segment, rest = divmod(n + 1, 6)
    if rest or not 5 <= n <= 299:
        raise ParameterError(f"{n} unknowns: Hermite elements have 5, 11, 17 and so on up to 299")
    l1, l2 = np.broadcast_arrays(np.asarray(l1, float), np.asarray(l2, float))
    length = np.diff(np.stack((np.zeros_like(l1), l1, l2, np.ones_like(l1)), axis=-1), axis=-1) / per_segment
    h = length[..., None, None]
    scale = h ** (SLOPE_POWERS[:, None] + SLOPE_POWERS)
    nodes = 3 * per_segment + 1
    parts = np.zeros((*l1.shape, 6, 2 * nodes, 2 * nodes))
    for first, factor in ((0, MASS * scale * h), (3, BENDING * scale / h**3)):
        for element in range(nodes - 1):
            at = slice(2 * element, 2 * element + 4)
            segment = element // per_segment
            parts[..., first + segment, at, at] += factor[..., segment, :, :]
    free = np.r_[2 : 2 * nodes - 1]  # clamped at x = 0, level at the centre
    slope, centre = np.zeros((*l1.shape, 2 * nodes)), np.zeros((*l1.shape, 2 * nodes))
    slope[..., 2 * per_segment + 1], centre[..., -2] = 1.0, 1.0
    basis = np.broadcast_to(np.eye(n), (*l1.shape, n, n))
    return Gram(parts[..., free[:, None], free], slope[..., free], centre[..., free], basis)
