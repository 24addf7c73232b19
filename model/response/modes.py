"""Natural frequencies, mode shapes and damping ratios of the half beam."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from model import NO_SKIN, Array, Beam, Skin, Tactor
from model.beam import matrices
from model.response.harmonic_response import output_rows, system_matrices


def natural_frequencies(tactor: Tactor, skin: Skin | None = None, n: int = 7) -> Array:
    """The n undamped natural frequencies, Hz, ascending: -omega^2 M q + K q = 0 (Sec. IV-1).

    Raises:
        ParameterError: n is not in 3..300.
    """
    return natural_frequencies_of(tactor.beam, (skin or NO_SKIN).k_s, n)


def natural_frequencies_of(beam: Beam, k_s: ArrayLike = 0.0, n: int = 7) -> Array:
    """As `natural_frequencies` for arrays of beams and skins, shape (..., n): singular values of L_K^T L_M^-T."""
    m = matrices(beam, k_s, 0.0, n)
    R = np.linalg.solve(np.linalg.cholesky(m.M), np.linalg.cholesky(m.K))
    omega: Any = np.linalg.svd(R, compute_uv=False)
    return np.asarray(omega[..., ::-1] / (2 * np.pi))


def mode_shapes(tactor: Tactor, x: ArrayLike, skin: Skin | None = None, n: int = 7, count: int = 3) -> Array:
    """The first `count` undamped mode shapes at x (m), shape (count, *x.shape).

    Each is scaled to unit modal mass of the half beam (kg^-1/2) and positive at the centre.

    Raises:
        ParameterError: n is not in 3..300, or x lies outside 0..L.
    """
    m = system_matrices(tactor, skin, n)
    W = np.linalg.inv(np.linalg.cholesky(m.M))
    V = (W.T @ np.linalg.eigh(W @ m.K @ W.T)[1])[:, :count]
    V = V * np.sign(m.B_F @ V)
    return np.asarray(np.moveaxis(output_rows(tactor, x, n) @ V, -1, 0))


def damping_ratios(poles: ArrayLike) -> Array:
    """-Re s / |s| of each pole, shape of `poles`; 1 for a pole that does not oscillate."""
    s = np.asarray(poles)
    return np.asarray(-s.real / np.abs(s))
