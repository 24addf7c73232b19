"""M, C, K and B of Eqs. (13)-(14): linear in the physical parameters over Gram integrals of the geometry alone."""

from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from model import Array, Beam
from model.beam.basis import check_shape_count, shape_functions, wavenumbers


class Gram(NamedTuple):
    """Integrals of the shapes over the three segments, dimensionless; leading axes are geometries, if many."""

    parts: Array
    """(..., 6, n, n): integral of N N^T over each segment, then of N'' N''^T over each segment."""
    slope: Array
    """(..., n): N'(L1)."""
    centre: Array
    """(..., n): N(L)."""
    basis: Array
    """(..., n, n): takes N of Eqs. (15)-(17) to the equivalent basis of all these integrals."""


class Matrices(NamedTuple):
    """M q'' + C q' + K q = B V + F_app B_F, Eq. (13), SI; leading axes are parameter sets, if many."""

    M: Array
    C: Array
    K: Array
    B: Array
    """(..., n): generalised force of 1 V on the specimen, Eq. (14d)."""
    B_F: Array
    """(..., n): generalised force of a load of 1 N at the centre, half of which each half beam carries."""


def gram(l1: float | Array, l2: float | Array, n: int) -> Gram:
    """Gram integrals for L1 / L = l1 and L2 / L = l2 (floats, or arrays of one shape that becomes the leading axes).

    Gauss-Legendre segment by segment, because w'' jumps at L1; a single geometry is computed once and remembered.

    Raises:
        ParameterError: n is not in 3..300.
    """
    if isinstance(l1, float) and isinstance(l2, float):
        return _one_gram(l1, l2, n)
    l1, l2 = np.broadcast_arrays(np.asarray(l1, float), np.asarray(l2, float))
    return _integrate(l1, l2, check_shape_count(n))


@lru_cache(maxsize=256, typed=True)
def _one_gram(l1: float, l2: float, n: int) -> Gram:
    g = _integrate(np.asarray(l1), np.asarray(l2), check_shape_count(n))
    for a in g:
        a.setflags(write=False)
    return g


_gauss_legendre = cache(np.polynomial.legendre.leggauss)
"""Nodes and weights of Gauss-Legendre quadrature on -1..1, of a number of nodes."""


def _integrate(l1: Array, l2: Array, n: int) -> Gram:
    nodes, weights = _gauss_legendre(16 + 2 * n)
    t, weight = (nodes + 1) / 2, weights / 2
    ends = np.stack((np.zeros_like(l1), l1, l2, np.ones_like(l1)), axis=-1)
    length = np.diff(ends, axis=-1)
    xi = ends[..., :-1, None] + length[..., None] * t
    w = length[..., None] * weight

    def at_nodes(derivative: int) -> Array:
        N = shape_functions(xi, l1[..., None, None], l2[..., None, None], n, derivative)
        return np.moveaxis(N, 0, -2)  # (..., 3, n, nodes)

    value, curvature = at_nodes(0), at_nodes(2)
    basis = _basis(np.moveaxis(value, -3, -2), np.moveaxis(curvature, -3, -2), w, n)

    def products(N: Array) -> Array:
        N = basis[..., None, :, :] @ N
        return np.asarray((N * w[..., None, :]) @ np.swapaxes(N, -1, -2))

    slope = np.moveaxis(shape_functions(l1, l1, l2, n, 1), 0, -1)
    centre = np.moveaxis(shape_functions(np.ones_like(l1), l1, l2, n), 0, -1)
    return Gram(
        np.concatenate((products(value), products(curvature)), axis=-3),
        _change_basis(basis, slope),
        _change_basis(basis, centre),
        basis,
    )


def _basis(N: Array, N2: Array, w: Array, n: int) -> Array:
    """Rows that transform N of Eqs. (15)-(17) into the basis of the computation: the same space, better conditioned.

    With many modes the two supplementary shapes are nearly linear combinations of them. Their part outside the modes, scaled to
    unit norm, keeps M as good as orthogonal at n = 40. N and N2 (second derivative) have shape (..., n, 3, nodes).
    """
    flat, flat2, weight = (a.reshape(*a.shape[:-2], -1) for a in (N, N2, w))
    inside = (flat2[..., -2:, :] * weight[..., None, :]) @ np.swapaxes(flat2[..., :-2, :], -1, -2)
    share = inside / wavenumbers(n - 2) ** 4
    rest = flat[..., -2:, :] - share @ flat[..., :-2, :]
    size = np.sqrt((rest**2 * weight[..., None, :]).sum(-1))
    basis = np.broadcast_to(np.eye(n), (*size.shape[:-1], n, n)).copy()
    basis[..., -2:, :-2] = -share
    basis[..., -2:, :] /= size[..., None]
    return basis


def _change_basis(basis: Array, N: Array) -> Array:
    return np.asarray((basis @ N[..., None])[..., 0])


def matrices(
    beam: Beam,
    k_s: ArrayLike = 0.0,
    c_s: ArrayLike = 0.0,
    n: int = 7,
    integrals: Callable[[float | Array, float | Array, int], Gram] = gram,
) -> Matrices:
    """M, C, K, B of Eqs. (13)-(14) for one beam or for arrays of them, with skin k_s (N/m^2) and c_s (kg/(m s)).

    `integrals`: of the paper's shape functions, or `hermite_gram`.

    Shapes: (n, n) and (n,) for one beam, with the broadcast shape of all arrays in front for many.

    Raises:
        ParameterError: n is not in 3..300.
    """
    L, L1, L2, rho1, rho2, eta, c0, k1, k2, mu = beam
    g = integrals(L1 / L, L2 / L, n)
    L3 = L * L * L
    M, C, K = _weighted_sums(
        g.parts,
        (L * rho1, L * rho2, L * (rho2 + eta), 0.0, 0.0, 0.0),
        (L * c0, L * c0, L * (c0 + c_s), 0.0, 0.0, 0.0),
        (0.0, 0.0, L * k_s, k1 / L3, k2 / L3, k2 / L3),
    )
    B, B_F = -np.asarray(mu / L)[..., None] * g.slope, g.centre / 2
    if B.ndim > 1 or M.ndim > 2:
        sets = np.broadcast_shapes(M.shape[:-1], B.shape)
        B, B_F = np.broadcast_to(B, sets), np.broadcast_to(B_F, sets)
    return Matrices(M, C, K, B, B_F)


def _weighted_sums(parts: Array, *rows: tuple[Any, ...]) -> Iterator[Array]:
    """One matrix per row of factors: the sum over the six parts of factor times part."""
    flat = [factor for row in rows for factor in row]
    try:
        factors = np.array(flat, float)
    except ValueError:  # floats and arrays mixed
        factors = np.array(np.broadcast_arrays(*flat))
    table = np.moveaxis(factors, 0, -1) if factors.ndim > 1 else factors
    table = table.reshape(*table.shape[:-1], len(rows), -1)
    n = parts.shape[-1]
    sums = table @ parts.reshape(*parts.shape[:-2], n * n)
    sums = sums.reshape(*sums.shape[:-1], n, n)
    return (sums[..., i, :, :] for i in range(len(rows)))
