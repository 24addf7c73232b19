"""Receptance of the beam with its exact derivatives to every factor of Eq. (14), for few frequencies and many parameters.

Z = K - omega^2 M + i omega C is linear in the factors of the six Gram parts, so with Z x = N'(L1) and Z y = N(L), both from one
factorisation, the response y . N'(L1) has the slopes -(y . part_j x). A fit needs some hundred frequencies a step and all slopes
at once; for this it is cheaper than poles, and it has no square roots that fail at unphysical trial values.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model import Array, Complex
from model.beam import gram

MAX_POLE_STEPS = 20
POLE_TOLERANCE = 1e-11
"""Last step of the search for a pole, relative to its frequency."""

PEAK_STEP = 1e-7
"""Relative step at which Newton's search for a peak ends; convergence is quadratic, so the remaining error is about its square."""

GROUP_WIDTH = 4e-6
"""Relative width of a group of frequencies: of a resonance of quality 50 the interpolated response is wrong by 1e-11."""

Tilt = Callable[[Array], tuple[Array, Array]]
"""Logarithmic slope over omega, s/rad, of a factor of the response, and its derivative, at omega (R,)."""


class Factors(NamedTuple):
    """Factors of the six Gram parts (w w over each segment, then w'' w''), each (..., 6), in M, C and K."""

    M: Array
    C: Array
    K: Array

    def take_rows(self, index: NDArray[np.intp]) -> "Factors":
        """The factors of the runs `index`, repeated with it."""
        return Factors(self.M[index], self.C[index], self.K[index])


class Peak(NamedTuple):
    """Peaks of |H|, or of |H| times a factor."""

    omega: Array
    """(R,), rad/s."""
    slopes: Factors
    """Of omega to the factors M, C, K."""
    curvature: Array
    """(R,): slope over omega of half the slope of |H|^2."""
    square: Array
    """(R,): |H|^2."""
    found: bool
    """Whether every row has a peak."""


class FrequencyNodes(NamedTuple):
    """Three frequencies for each group of nearly equal ones, between which responses are interpolated."""

    rows: NDArray[np.intp]
    """(3 G,): a row with the factors of each node."""
    omega: Array
    """(3 G,), rad/s."""
    groups: NDArray[np.intp]
    """(R,): the group of each row."""
    weights: Array
    """(R, 3): of the nodes of its group."""

    def interpolate(self, values: Complex) -> Complex:
        """Return the values at the rows, (R, ...), from values at the nodes, (3 G, ...)."""
        own = values.reshape(-1, 3, *values.shape[1:])[self.groups]
        return np.asarray(np.einsum("ri,ri...->r...", self.weights, own))


def frequency_nodes(conditions: NDArray[np.intp], omega: Array) -> FrequencyNodes | None:
    """Return nodes for rows (R,) of `conditions` at `omega`; None if that saves no half of the solutions.

    A dwell's points have their measured frequencies, so that points of many runs at one setting differ by some 1e-7.
    """
    at = np.log(omega) / GROUP_WIDTH
    bins = np.floor(at).astype(np.int64)
    _, first, groups = np.unique(bins * (conditions.max() + 1) + conditions, return_index=True, return_inverse=True)
    if 6 * first.size > omega.size:
        return None
    low, high = (np.exp((bins[first] + side) * GROUP_WIDTH) for side in (0, 1))
    u = (omega - low[groups]) / (high - low)[groups]
    weights = np.stack((2 * (u - 0.5) * (u - 1), -4 * u * (u - 1), 2 * u * (u - 0.5)), axis=-1)
    nodes = np.stack((low, (low + high) / 2, high), axis=-1).ravel()
    return FrequencyNodes(np.repeat(first, 3), nodes, groups, weights)


class ReceptanceSolver:
    """One geometry: responses and their slopes, for rows of factors and frequencies.

    Raises:
        ParameterError: n is not in 3..300.
    """

    def __init__(self, l1: float, l2: float, n: int) -> None:
        g = gram(float(l1), float(l2), n)
        self._n = n
        self.parts = g.parts.reshape(6, n * n)
        self.ends = np.stack((g.slope, g.centre), axis=-1)

    def response(self, a: Factors, omega: Array) -> tuple[Complex, Complex]:
        """H (R,), m per newton metre at L1 times L, and t (R, 6): dH = -sum_j t_j dz_j with z = K - omega^2 M + i omega C."""
        _, x, y = self._solve(a, omega)
        return self._H(x), np.asarray(self._part_products(y, x))

    def response_with_ends(
        self,
        a: Factors,
        omega: Array,
        ends: Sequence[tuple[tuple[float, float], tuple[float, float]]],
        conditions: NDArray[np.intp],
    ) -> tuple[Complex, Complex, list[Complex]]:
        """As `response`, with the differences of H, (R,) each, between the ends of pairs of neighbouring geometries L1 / L, L2 / L.

        They are linearized: the difference of Z and of the right sides with the x and y of this geometry, without a further solution.
        Rows with one number in `conditions`, (R,), have equal factors; those at nearly equal frequencies are interpolated.
        """
        if (nodes := frequency_nodes(conditions, omega)) is not None:
            every = np.arange(nodes.rows.size)
            H, t, moved = self.response_with_ends(a.take_rows(nodes.rows), nodes.omega, ends, every)
            return nodes.interpolate(H), nodes.interpolate(t), [nodes.interpolate(each) for each in moved]
        _, x, y = self._solve(a, omega)
        z = a.K - omega[:, None] ** 2 * a.M + 1j * omega[:, None] * a.C
        moved = []
        for pair in ends:
            up, down = (ReceptanceSolver(*end, self._n) for end in pair)
            right = up.ends - down.ends
            inner = np.einsum("rj,rj->r", self._part_products(y, x, up.parts - down.parts), z)
            moved.append(np.asarray(y @ right[:, 0] + x @ right[:, 1] - inner))
        return self._H(x), np.asarray(self._part_products(y, x)), moved

    def undamped_resonance(self, a: Factors) -> tuple[Array, Array]:
        """Lowest undamped omega (R,), and (R, 6) with d(omega^2) = sum_j t_j (dK_j - omega^2 dM_j)."""
        M, K = (np.asarray(f @ self.parts).reshape(-1, self._n, self._n) for f in (a.M, a.K))
        W = np.linalg.inv(np.linalg.cholesky(M))
        squares, vectors = np.linalg.eigh(W @ K @ W.mT)
        q = np.asarray((W.mT @ vectors[..., :1])[..., 0])
        return np.sqrt(squares[:, 0]), self._part_products(q, q)

    def pole(self, a: Factors) -> tuple[Complex, Factors]:
        """First pole s (R,) of K + s C + s^2 M, in the upper half plane, and its slopes to the factors M, C, K.

        Inverse iteration, Z(s) q' = Z'(s) q, from the undamped mode; derivatives as of a simple eigenvalue.
        """
        n = self._n
        first, square_slopes = self.undamped_resonance(a)
        s = 1j * first - 0.5 * (square_slopes * a.C).sum(-1)
        M, C, K = (np.asarray(f @ self.parts).reshape(-1, n, n) for f in a)
        q = np.tile(self.ends[:, 1], (s.size, 1)).astype(complex)
        for _ in range(MAX_POLE_STEPS):
            at = s[:, None, None]
            slope = (C + 2 * at * M) @ q[..., None]
            step = np.linalg.solve(K + at * C + at * at * M, slope)[..., 0]
            move = (q * q).sum(-1) / (q * step).sum(-1)
            s = s - move
            q = step / np.linalg.norm(step, axis=-1, keepdims=True)
            if np.abs(move).max() < POLE_TOLERANCE * first.min():
                break
        t = self._part_products(q, q)
        per = -1 / (t * (a.C + 2 * s[:, None] * a.M)).sum(-1)[:, None]
        return s, Factors(per * t * (s * s)[:, None], per * t * s[:, None], per * t)

    def resonance_peak(self, a: Factors, tilt: Tilt | None = None) -> Peak:
        """Maximum of |H| near the first resonance.

        Newton's method on d|H|^2 / d omega; the slopes follow from the implicit function. A row too damped for a peak gets its
        undamped frequency. With a `tilt` the maximum refers to |H| times a factor.
        """
        first, square_slopes = self.undamped_resonance(a)
        zeta = (square_slopes * a.C).sum(-1) / (2 * first)
        omega = first * np.sqrt(np.maximum(1 - 2 * zeta**2, 0.05))
        for _ in range(30):
            g, g_omega, _ = self.peak_slope(a, omega, tilt)
            step = np.clip(-g / g_omega, -0.1 * first, 0.1 * first)
            step = np.where(g_omega < 0, step, np.sign(g) * 0.05 * first)
            omega = np.clip(omega + step, 0.02 * first, 2 * first)
            if np.abs(step).max() < PEAK_STEP * first.min():
                break
        g, g_omega, square, slopes = self._peak_condition(a, omega, tilt)
        converged = (g_omega < 0) & (np.abs(g) < 1e-6 * np.abs(g_omega) * first) & (omega > 0.1 * first)
        omega = np.where(converged, omega, first)
        level = square_slopes / (2 * first[:, None])
        flat = Factors(-(first**2)[:, None] * level, 0 * level, level)
        down = -1 / np.where(converged, g_omega, 1.0)[:, None]
        moved = (np.where(converged[:, None], down * each(), f) for each, f in zip(slopes, flat, strict=True))
        return Peak(omega, Factors(*moved), g_omega, square, bool(converged.all()))

    def peak_slope(self, a: Factors, omega: Array, tilt: Tilt | None = None) -> tuple[Array, Array, Array]:
        """Half the slope of |H|^2 over omega at omega (R,), which is 0 at a peak, its own slope over omega, and |H|^2."""
        return self._peak_condition(a, omega, tilt)[:3]

    def _peak_condition(
        self, a: Factors, omega: Array, tilt: Tilt | None
    ) -> tuple[Array, Array, Array, list[Callable[[], Array]]]:
        """Half the slope of |H|^2: g = Re(H* H') = (|H|^2)' / 2, its slope to omega, |H|^2, and functions of its slopes to M, C, K.

        With a factor c(omega), g + |H|^2 (ln|c|)', which is 0 where |c H| is largest.
        """
        Z, x, y = self._solve(a, omega)
        w = omega[:, None]
        z1 = 1j * a.C - 2 * w * a.M
        Z1 = (z1 @ self.parts).reshape(Z.shape)
        forces = Z1 @ np.stack((x, y), axis=-1)
        inner = np.linalg.solve(Z, forces)
        x1, y1 = inner[..., 0], inner[..., 1]
        H, H1 = self._H(x), -(forces[..., 0] * y).sum(-1)
        H2 = 2 * (forces[..., 1] * x1).sum(-1) - (y * (Z1.real @ x[..., None])[..., 0]).sum(-1) / omega
        g, g_omega = (H.conj() * H1).real, np.abs(H1) ** 2 + (H.conj() * H2).real
        steepness, bend = (np.zeros(1), np.zeros(1)) if tilt is None else tilt(omega)
        square = np.abs(H) ** 2
        g, g_omega = g + steepness * square, g_omega + bend * square + 2 * steepness * g

        @cache
        def products() -> tuple[Any, Any]:
            return self._part_products(y, x), self._part_products(y1, x) + self._part_products(y, x1)

        def slope(z: Any, z_omega: Any) -> Array:
            """Slopes for a factor that adds z to Z and z_omega to its derivative to omega."""
            t, u = products()
            H_a, H1_a = -t * z, u * z - t * z_omega
            moved = H_a.conj() * H1[:, None] + H.conj()[:, None] * H1_a
            return np.asarray((moved + 2 * steepness[:, None] * H.conj()[:, None] * H_a).real)

        parts = ((-w * w, -2 * w), (1j * w, 1j), (1.0, 0.0))
        return g, g_omega, square, [partial(slope, *each) for each in parts]

    def _solve(self, a: Factors, omega: Array) -> tuple[Any, Any, Any]:
        w = omega[:, None]
        Z = ((a.K - w * w * a.M + 1j * w * a.C) @ self.parts).reshape(-1, self._n, self._n)
        xy = np.linalg.solve(Z, self.ends)
        return Z, xy[..., 0], xy[..., 1]

    def _H(self, x: Any) -> Complex:
        return np.asarray(x @ self.ends[:, 1])

    def _part_products(self, u: Any, v: Any, parts: Array | None = None) -> Any:
        """Products u . part_j v, (R, 6)."""
        return np.asarray(
            (u[:, :, None] * v[:, None, :]).reshape(-1, self._n**2) @ (self.parts if parts is None else parts).T
        )
