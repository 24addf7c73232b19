"""The quadratic eigenproblem (M s^2 + C s + K) q = 0: poles, residues, and the sums over them.

With M = L_M L_M^T and K = L_K L_K^T the first-order form in y = -L_K^T q, v = L_M^T q' is

    d/dt [y; v] = [[0, -R^T], [R, -D]] [y; v],    R = L_M^-1 L_K,  D = L_M^-1 C L_M^-T,

half skew, half dissipation: it scales with omega, not omega^2, and its left eigenvectors are (-y, v), so one real
eigenproblem of size 2n gives poles *and* residues, and any number of frequencies or instants costs a sum.
"""

from typing import NamedTuple

import numpy as np

from model import Array, Complex

DOUBLE_POLE_TOLERANCE = 1e-4
"""Limit of the product of left and right vector below which two poles nearly coincide and their residues cancel to fewer than
eight digits. The damping is then changed in its eighth digit, which separates them and is the whole error."""


class ModalForm(NamedTuple):
    """w(t) = sum_k residues_k z_k(t) with z_k' = poles_k z_k + u(t); conjugate (or two real) poles are n apart."""

    poles: Complex
    """(..., 2n), rad/s, real part <= 0."""
    residues: Complex
    """(..., 2n), or (..., X, 2n) for X outputs; output times rad/s per unit of drive."""


def modal_form(M: Array, C: Array, K: Array, B: Array, c: Array) -> ModalForm:
    """Poles of M q'' + C q' + K q = B u and residues of the output c q.

    Shapes: M, C, K (..., n, n), symmetric, M and K positive definite; B (..., n); c (..., n) or (..., X, n), in which
    case the residues are (..., X, 2n). Leading axes are parameter sets and broadcast.
    """
    n = M.shape[-1]
    W, L_K = _factors(M, K)
    Wt = W.mT
    A = np.zeros((*M.shape[:-2], 2 * n, 2 * n))
    A[..., n:, :n] = W @ L_K
    np.negative(A[..., n:, :n].mT, out=A[..., :n, n:])
    A[..., n:, n:] = -(W @ C @ Wt)
    one = c.ndim == B.ndim
    rows = np.concatenate((B[..., None, :], c[..., None, :] if one else c), axis=-2) @ Wt
    s, v, norm = _eigenpairs(A)
    if np.abs(norm).min() < DOUBLE_POLE_TOLERANCE:
        double = np.abs(norm).min(-1) < DOUBLE_POLE_TOLERANCE
        A[..., n:, n:] *= np.where(double, 1 + 4 * DOUBLE_POLE_TOLERANCE**2, 1)[..., None, None]
        s, v, norm = _eigenpairs(A)
    g = rows @ v
    r = g[..., 1:, :] * (g[..., :1, :] / (s * norm)[..., None, :])
    if s.shape[-1] == n:
        s, r = np.concatenate((s, s.conj()), axis=-1), np.concatenate((r, r.conj()), axis=-1)
    return ModalForm(s, r[..., 0, :] if one else r)


def receptance(modal: ModalForm, omega: Array) -> Complex:
    """sum_k r_k / (i omega - s_k), shape (*residues.shape[:-1], F) for omega (F,), rad/s.

    Poles that are n apart are joined to real second-order sections (gamma + alpha s) / (s^2 + e s + d).
    """
    n = modal.poles.shape[-1] // 2
    p, q = modal.poles[..., :n], modal.poles[..., n:]
    r = modal.residues if modal.residues.ndim > modal.poles.ndim else modal.residues[..., None, :]
    rp, rq = r[..., :n], r[..., n:]
    e, d = -(p + q).real, (p * q).real
    alpha, gamma = (rp + rq).real, -(rp * q[..., None, :] + rq * p[..., None, :]).real
    on_x = np.concatenate((alpha, gamma), axis=-2)
    on_y = on_x * e[..., None, :]
    w2 = omega * omega
    # d - omega^2 and (e omega)^2 in one product: numpy is slow at broadcasting columns against rows
    table = np.zeros((*d.shape[:-1], 2, d.shape[-1], 2))
    table[..., 0, :, 0], table[..., 0, :, 1], table[..., 1, :, 1] = d, -1, e * e
    powers = np.empty((2, w2.size))
    powers[0], powers[1] = 1, w2
    both = table @ powers
    X, Y = both[..., 0, :, :], both[..., 1, :, :]
    Y += X * X
    np.reciprocal(Y, out=Y)
    X *= Y
    of_x, of_y, m = on_x @ X, on_y @ Y, alpha.shape[-2]
    H = np.empty(alpha.shape[:-1] + w2.shape, complex)
    of_y[..., :m, :] *= w2
    np.add(of_x[..., m:, :], of_y[..., :m, :], out=H.real)
    of_x[..., :m, :] -= of_y[..., m:, :]
    np.multiply(of_x[..., :m, :], omega, out=H.imag)
    return H if r is modal.residues else H[..., 0, :]


def _factors(M: Array, K: Array) -> tuple[Array, Array]:
    """L_M^-1 and L_K; for one set straight from LAPACK, where the overhead of a call counts."""
    if M.ndim > 2:
        return np.linalg.inv(np.asarray(np.linalg.cholesky(M))), np.asarray(np.linalg.cholesky(K))
    from scipy.linalg.lapack import dpotrf, dtrtri  # takes 0.2 s to load

    (L_M, bad_M), (L_K, bad_K) = dpotrf(M, lower=1), dpotrf(K, lower=1)
    if bad_M or bad_K:
        raise np.linalg.LinAlgError("mass or stiffness matrix is not positive definite")
    return dtrtri(L_M, lower=1)[0], L_K


def _eigenpairs(A: Array) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues, the halves v of their unit vectors (y, v), and the product v v - y y of left and right vector.

    Conjugates, or two real eigenvalues, are n apart. Without any real one only the first n are given.
    """
    n = A.shape[-1] // 2
    s, z = _upper_eigenpairs(A) if A.ndim == 2 else _all_eigenpairs(A)
    y, v = z[..., :n, :], z[..., n:, :]
    return s, v, ((v - y) * (v + y)).sum(-2)


def _upper_eigenpairs(A: Array) -> tuple[Complex, Complex]:
    from scipy.linalg.lapack import dgeev

    wr, wi, _, vr, info = dgeev(A, compute_vl=0)
    if info:
        raise np.linalg.LinAlgError("the eigenvalues of the damped beam did not converge")
    if not wi.all():
        return _all_eigenpairs(A)
    s, z = np.empty(wr.size // 2, complex), np.empty((wr.size, wr.size // 2), complex)
    s.real, s.imag, z.real, z.imag = wr[::2], wi[::2], vr[:, ::2], vr[:, 1::2]
    return s, z


def _all_eigenpairs(A: Array) -> tuple[Complex, Complex]:
    s, z = np.linalg.eig(A)
    if s.imag.all():  # LAPACK has conjugates as neighbours
        return np.asarray(s[..., ::2]), np.asarray(z[..., ::2])
    return _sort_real_last(s.astype(complex), z.astype(complex))


def _sort_real_last(s: Complex, z: Complex) -> tuple[Complex, Complex]:
    """Move the real eigenvalues, an even number, to the end; then separate first and second of each pair."""
    order = np.argsort(s.imag == 0, axis=-1, kind="stable")
    order = np.concatenate((order[..., ::2], order[..., 1::2]), axis=-1)
    return np.take_along_axis(s, order, -1), np.take_along_axis(z, order[..., None, :], -1)
