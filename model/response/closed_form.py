"""Exact frequency response of the three-segment beam of Eqs. (1)-(6), without Galerkin.

In each segment w'''' = z w with z = (omega^2 m - i omega c - k_s) / k, complex; four constants per segment, twelve in all,
follow from the clamp, the two interfaces and the centre. Nothing here is shared with the Galerkin solution, so that each
can verify the other.
"""

from math import factorial

import numpy as np
from numpy.typing import ArrayLike

from model import NO_SKIN, Array, Complex, Skin, Tactor
from model.response.harmonic_response import Excitation, check_frequency, check_position


def exact_response(
    tactor: Tactor,
    frequency_hz: ArrayLike,
    skin: Skin | None = None,
    x: ArrayLike | None = None,
    excitation: Excitation = "voltage",
    derivative: int = 0,
    clamp_stiffness: float | None = None,
) -> Complex:
    """Deflection (or its derivative to x, 0..3) per volt on the specimen or per newton at the centre.

    Arguments, shapes and errors as in `model.response.harmonic_response.frequency_response`; frequency 0 is the static solution.
    `clamp_stiffness` (N m per radian) lets the clamp rotate: k1 w''(0) = clamp_stiffness w'(0) in place of Eq. (3b); None is rigid.
    """
    f = check_frequency(frequency_hz)
    at = check_position(tactor, tactor.L if x is None else x)
    z = _fourth_powers(tactor, 2 * np.pi * f, skin or NO_SKIN)
    ends = np.array([0.0, tactor.L1, tactor.L2, tactor.L])
    constants = _constants(tactor, z, np.diff(ends), excitation, clamp_stiffness)
    where = np.clip(np.searchsorted(ends, np.atleast_1d(at), side="right") - 1, 0, 2)
    rows = []
    for position, i in zip(np.atleast_1d(at), where, strict=True):
        length = ends[i + 1] - ends[i]
        functions = _functions(z[i] * length**4, (position - ends[i]) / length)[:, derivative]
        rows.append((functions * constants[:, i]).sum(-1) / length**derivative)
    return np.array(rows) if at.ndim else rows[0]


def _fourth_powers(tactor: Tactor, omega: Array, skin: Skin) -> list[Complex]:
    """Factor z of each segment, (F,), 1/m^4: Eqs. (1) and (2) under exp(i omega t)."""
    t = tactor
    segments = ((t.rho1, t.c0, 0.0, t.k1), (t.rho2, t.c0, 0.0, t.k2), (t.rho2 + t.eta, t.c0 + skin.c_s, skin.k_s, t.k2))
    return [np.asarray((omega**2 * mass - 1j * omega * c - k_s) / k, complex) for mass, c, k_s, k in segments]


def _functions(zeta: Complex, u: float) -> Complex:
    """Four solutions of w'''' = zeta w at u in [0, 1] and their derivatives 0..3, shape (F, 4 derivatives, 4).

    Exponentials that are at most 1 in size, each decaying from the end where it is largest; where |zeta| < 1, and they
    all look alike, the power series that start with 1, u, u^2 / 2, u^3 / 6.
    """
    lam = zeta[:, None] ** 0.25 * 1j ** np.arange(4)
    growing = lam.real > 0
    powers = lam[:, None, :] ** np.arange(4)[:, None]
    exponentials = powers * np.exp(np.where(growing, lam * (u - 1), lam * u))[:, None, :]
    small = np.abs(zeta) < 1
    z = np.where(small, zeta, 0)
    powers = np.arange(5)

    def term(m: int) -> Complex:
        return np.asarray(z[:, None] ** powers @ [u ** (4 * j + m) / factorial(4 * j + m) for j in powers], complex)

    s = [term(m) for m in range(4)]
    polynomials = np.stack(
        [np.stack([s[m - d] if m >= d else z * s[m - d + 4] for m in range(4)], -1) for d in range(4)], 1
    )
    return np.where(small[:, None, None], polynomials, exponentials)


def _constants(
    tactor: Tactor, z: list[Complex], lengths: Array, excitation: Excitation, clamp_stiffness: float | None = None
) -> Complex:
    """The four constants of each segment, (F, 3, 4), from conditions (3)-(6); moments and forces are divided by k2."""
    F = z[0].size
    scale = (tactor.L / lengths[:, None]) ** np.arange(4)
    start = [_functions(z[i] * lengths[i] ** 4, 0.0) * scale[i][:, None] for i in range(3)]
    end = [_functions(z[i] * lengths[i] ** 4, 1.0) * scale[i][:, None] for i in range(3)]
    step = np.array([1.0, 1.0, tactor.k1 / tactor.k2, tactor.k1 / tactor.k2])[:, None]
    A, b = np.zeros((F, 12, 12), complex), np.zeros(12)
    A[:, 0:2, 0:4] = start[0][:, :2]
    if clamp_stiffness is not None:
        A[:, 1, 0:4] -= tactor.k1 / (tactor.L * clamp_stiffness) * start[0][:, 2]
    A[:, 2:6, 0:4], A[:, 2:6, 4:8] = step * end[0], -start[1]
    A[:, 6:10, 4:8], A[:, 6:10, 8:12] = end[1], -start[2]
    A[:, 10:12, 8:12] = end[2][:, [1, 3]]
    if excitation == "voltage":
        b[4] = -tactor.mu * tactor.L**2 / tactor.k2
    else:  # k3 w'''(L) = -F/2: positive in the direction of the load, the sign of Eq. (7) but not of Eq. (4b)
        b[11] = -0.5 * tactor.L**3 / tactor.k2
    size = np.abs(A).max(axis=-1)
    return np.linalg.solve(A / size[..., None], (b / size)[..., None])[..., 0].reshape(F, 3, 4)
