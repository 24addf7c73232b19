"""Array types: floats, complex numbers, flags; and the rule for integrals over them."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mask = NDArray[np.bool_]


@cache
def gauss_legendre(count: int) -> tuple[Array, Array]:
    """Nodes and weights of Gauss-Legendre quadrature on -1..1."""
    return np.polynomial.legendre.leggauss(count)
