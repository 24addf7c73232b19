"""The shape functions of the Galerkin solution, Eqs. (15)-(17), on the dimensionless half beam xi = x / L in [0, 1].

Eq. (15) as printed subtracts cosh from sinh and loses all digits from about the tenth shape on. Referred to the centre, the
symmetric shapes are `cos(b (1 - xi)) / cos b - cosh(b (1 - xi)) / cosh b`, the same function with the same scale, and the
hyperbolic part is a sum of decaying exponentials. Eqs. (16) and (17) are scaled to 1 at the centre.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from model import Array, ParameterError

N_MAX = 300
"""Largest useful number of shapes: the error is below 1e-7, and rounding of the supplementary shapes becomes visible."""


def check_shape_count(n: int) -> int:
    """`n` itself; raises ParameterError unless it is a whole number in 3..N_MAX."""
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or not 3 <= n <= N_MAX:
        raise ParameterError(
            f"n (number of shape functions) is {n}: it must be a whole number from 3 to {N_MAX}; the paper uses 7"
        )
    return int(n)


@lru_cache(maxsize=128)
def wavenumbers(count: int) -> Array:
    """b_j = beta_j L, shape (count,): roots of cos(2b) cosh(2b) = 1 whose shape is symmetric, i.e. tan b = -tanh b."""
    b = (np.arange(1, count + 1) - 0.25) * np.pi
    for _ in range(6):
        t = np.tanh(b)
        b = b - (np.sin(b) + np.cos(b) * t) / (np.cos(b) - np.sin(b) * t + np.cos(b) * (1 - t * t))
    roots = np.asarray(b, float)
    roots.setflags(write=False)
    return roots


def symmetric_modes(xi: ArrayLike, count: int, derivative: int = 0) -> Array:
    """phi_j of Eq. (15) or a derivative to xi (0..3), shape (count, *xi.shape)."""
    y = 1 - np.asarray(xi, float)
    b = wavenumbers(count).reshape(-1, *(1,) * y.ndim)
    sign = np.where(np.arange(1, count + 1) % 2, -1.0, 1.0).reshape(b.shape)
    a = sign * np.sqrt(1 + np.tanh(b) ** 2)  # 1 / cos b, exact at the root
    rise, fall = np.exp(-b * (1 - y)), np.exp(-b * (1 + y))
    odd = derivative % 2
    hyperbolic = (rise - fall if odd else rise + fall) / (1 + np.exp(-2 * b))
    circular = a * (np.sin(b * y) if odd else np.cos(b * y))
    c, h = ((1, -1), (1, 1), (-1, -1), (-1, 1))[derivative]
    return np.asarray(b**derivative * (c * circular + h * hyperbolic))


def moment_shape(xi: ArrayLike, l1: ArrayLike, derivative: int = 0) -> Array:
    """phi~_1 of Eq. (16), static response to a moment at xi = l1 = L1 / L, scaled to 1 at the centre."""
    x, l1 = np.asarray(xi, float), np.asarray(l1, float)
    left = ((1 - l1) * x**2, 2 * (1 - l1) * x, 2 * (1 - l1) + 0 * x, 0 * x)[derivative]
    right = (l1 * (2 * x - x**2 - l1), 2 * l1 * (1 - x), -2 * l1 + 0 * x, 0 * x)[derivative]
    return np.asarray(np.where(x < l1, left, right) / (l1 * (1 - l1)))


def load_shape(xi: ArrayLike, l2: ArrayLike, derivative: int = 0) -> Array:
    """phi~_2 of Eq. (17), static response to a uniform force over [l2, 1], l2 = L2 / L, scaled to 1 at the centre."""
    x, l2 = np.asarray(xi, float), np.asarray(l2, float)
    a, b = 4 * (l2 - 1), 4 - 6 * l2**2 + 2 * l2**3
    left = (a * x**3 + b * x**2, 3 * a * x**2 + 2 * b * x, 6 * a * x + 2 * b, 6 * a + 0 * x)[derivative]
    d = 4 + 2 * l2**3
    right = (
        x**4 - 4 * x**3 + d * x**2 - 4 * l2**3 * x + l2**4,
        4 * x**3 - 12 * x**2 + 2 * d * x - 4 * l2**3,
        12 * x**2 - 24 * x + 2 * d,
        24 * x - 24,
    )[derivative]
    return np.asarray(np.where(x < l2, left, right) / (1 - 2 * l2**3 + l2**4))


def shape_functions(xi: ArrayLike, l1: ArrayLike, l2: ArrayLike, n: int, derivative: int = 0) -> Array:
    """N = [phi_1 ... phi_{n-2}, phi~_1, phi~_2] or its derivative to xi, shape (n, *xi.shape).

    `l1` and `l2` broadcast against `xi`. At xi = l1 the second derivative is the one from the right.

    Raises:
        ParameterError: n is not in 3..300.
    """
    x = np.asarray(xi, float)
    parts = (moment_shape(x, l1, derivative)[None], load_shape(x, l2, derivative)[None])
    return np.concatenate((symmetric_modes(x, check_shape_count(n) - 2, derivative), *parts))
