"""Modal time stepper of the tactor, exact for inputs linear between grid points; amplifier slew limit.

Whole blocks of the grid are computed at once: w = T_V V + T_F F + O z, with one small recursion from block to block.
"""

import math
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from model import Array, Complex, Skin, Tactor
from model.response import load_compliance, system_matrices, tactor_modal_form

N = TypeVar("N", Array, Complex)

BLOCK = 128
"""Number of grid steps simulated together; a block has no values before it is complete."""


@dataclass(frozen=True, slots=True)
class Stepper:
    """Matrices of one block for one situation: displacement and next state from the drives at steps -1..BLOCK-1."""

    R_V: Array  # (BLOCK + 1 + 2 m, BLOCK), volts and the state before the block, real and imaginary, to displacement
    R_F: Array  # (BLOCK + 1, BLOCK), newtons to displacement
    W_V: Array  # (BLOCK + 1, 2 m), volts to the state after the block, real and imaginary
    W_F: Array  # (BLOCK + 1, 2 m), of newtons
    yield_V: float  # steady displacement per volt
    yield_F: float  # and per newton
    delay_V: float  # displacement per volt and second of a slow rise, beside the steady one
    delay_F: float  # and per newton and second
    ringing: float  # largest displacement for a state of 1
    advance: Complex  # (m,), state over one block
    poles: Complex  # (k,), first the stepped poles, then the poles beyond the grid
    b_V: Complex  # (k,), z' = s z + b_V V + b_F F
    b_F: Complex  # (k,)
    shapes: Complex  # (2n, k), Re(shapes z) are coordinates and velocities
    inverse: Complex  # (k, 2n)
    slowest_decay: float
    """Slowest decay of a mode, 1/s."""

    @classmethod
    def for_tactor(cls, tactor: Tactor, skin: Skin | None, n: int, step_s: float) -> "Stepper":
        """The stepper of a tactor in `n` shapes, with first-order hold."""
        m = system_matrices(tactor, skin, n)
        # Both sides scaled by the root of M: the eigenvectors keep their digits.
        root = np.linalg.inv(np.linalg.cholesky(m.M))
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-root @ m.K @ root.T, -root @ m.C @ root.T]])
        s, X = np.linalg.eig(A)
        inverse = np.linalg.inv(X)
        X = np.kron(np.eye(2), root.T) @ X
        inverse = inverse @ np.kron(np.eye(2), np.linalg.inv(root.T))
        keep = np.flatnonzero(s.imag >= 0)
        # Modes beyond the grid follow the drive at once; their oscillation could not be sampled anyway.
        keep = keep[np.argsort(np.abs(s[keep]) * step_s > 1.0, kind="stable")]
        twice = np.where(s.imag > 0, 2.0, 1.0)[keep]
        s, X, inverse = s[keep].astype(complex), X[:, keep] * twice, inverse[keep]
        both = np.stack((m.B, m.B_F), axis=-1)
        b_V, b_F = (inverse[:, n:] @ np.linalg.solve(m.M, both)).T
        c = 2 * m.B_F @ X[:n]
        slow = int(np.sum(np.abs(s) * step_s <= 1.0))
        held = s[:slow]
        T_V, W_V = first_order_hold(held, b_V[:slow], c[:slow], step_s)
        T_F, W_F = first_order_hold(held, b_F[:slow], c[:slow], step_s)
        for T, b, more in ((T_V, b_V, 0.0), (T_F, b_F, _residual_compliance(tactor, n))):
            T[np.arange(BLOCK) + 1, np.arange(BLOCK)] += more - float((c[slow:] * b[slow:] / s[slow:]).real.sum())
        powers = c[:slow, None] * np.exp(np.multiply.outer(held * step_s, np.arange(BLOCK) + 1))
        advance = np.exp(held * step_s * BLOCK)
        slowest = float(np.min(-s.real))
        # Real matrices, side by side: a product of real and complex ones takes several times as long.
        O = np.vstack((powers.real, -powers.imag))  # noqa: E741
        pull_V, pull_F = (np.hstack((W.real, W.imag)) for W in (W_V, W_F))
        rests = [-(b / s)[:slow] for b in (b_V, b_F)]
        yield_V, yield_F = (
            float(T[:, -1].sum() + np.append(rest.real, rest.imag) @ O[:, -1])
            for T, rest in zip((T_V, T_F), rests, strict=True)
        )
        delay_V, delay_F = (-float((c[:slow] * b[:slow] / (held * held)).real.sum()) for b in (b_V, b_F))
        R_V, pulls = np.vstack((T_V, O)), (pull_V, pull_F)
        yields = yield_V, yield_F, delay_V, delay_F
        return cls(R_V, T_F, *pulls, *yields, float(np.abs(O).max()), advance, s, b_V, b_F, X, inverse, slowest)

    def steady_state(
        self, volts: float, newtons: float, volts_per_s: float = 0.0, newtons_per_s: float = 0.0
    ) -> Complex:
        """Return the state under constant or slowly rising `volts` and `newtons`."""
        slow = self.advance.size
        s = self.poles[:slow]
        steady = -(self.b_V[:slow] * volts + self.b_F[:slow] * newtons) / s
        return steady - (self.b_V[:slow] * volts_per_s + self.b_F[:slow] * newtons_per_s) / (s * s)

    def converted_state(self, previous: "Stepper", state: Complex, volts: float, newtons: float) -> Complex:
        """Return the state of this stepper with the coordinates and velocities of another one's state."""
        slow = previous.advance.size
        z = -(previous.b_V * volts + previous.b_F * newtons) / previous.poles
        z[:slow] = state
        return (self.inverse @ (previous.shapes @ z).real)[: self.advance.size]

    def run(
        self,
        volts: Array,
        previous_v: float,
        newtons: Array,
        previous_n: float,
        state: Complex,
        newtons_per_s: Array | None = None,
    ) -> tuple[Array, Complex]:
        """Displacement on the grid for whole blocks of drives (n BLOCK,), and the state after them.

        With `newtons_per_s` the force changes slowly: it and its rate are given at the edges of the blocks, (n + 1,) each.
        """
        if newtons_per_s is not None:
            first, last = (self.steady_state(0.0, float(newtons[k]), 0.0, float(newtons_per_s[k])) for k in (0, -1))
            w, state = self.run(volts, previous_v, np.zeros(0), 0.0, state - first)
            edges = self.yield_F * newtons + self.delay_F * newtons_per_s
            blocks = w.reshape(-1, BLOCK)
            blocks += edges[:-1, None] + np.diff(edges)[:, None] * ((np.arange(BLOCK) + 1) / BLOCK)
            return w, state + last
        m = self.advance.size
        inputs = with_previous(volts, previous_v, 2 * m)
        pulls = inputs[:, : BLOCK + 1] @ self.W_V
        pressing = with_previous(newtons, previous_n) if previous_n or newtons.any() else None
        if pressing is not None:
            pulls += pressing @ self.W_F
        states = linear_recursion(self.advance, state, pulls[:, :m] + 1j * pulls[:, m:])
        inputs[:, BLOCK + 1 : BLOCK + 1 + m], inputs[:, BLOCK + 1 + m :] = states[:-1].real, states[:-1].imag
        w = inputs @ self.R_V
        if pressing is not None:
            w += pressing @ self.R_F
        return w.ravel(), states[-1]


def linear_recursion(advance: N, state: N, inputs: Any) -> N:
    """Return all states of z' = advance z + input, shape (n + 1, m), from `state`, by doubling in log2 n steps."""
    states = np.concatenate((state[None], inputs))
    reach, power = 1, advance
    while reach < len(states):
        states[reach:] += power * states[:-reach]
        reach, power = 2 * reach, power * power
    return states


def with_previous(drive: Array, previous: float, room: int = 0) -> Array:
    """Return blocks (n, BLOCK + 1 + room), each preceded by the previous value and followed by room."""
    out = np.empty((drive.size // BLOCK, BLOCK + 1 + room))
    out[:, 1 : BLOCK + 1] = drive.reshape(-1, BLOCK)
    out[0, 0], out[1:, 0] = previous, out[:-1, BLOCK]
    return out


def first_order_hold(s: Complex, b: Complex, c: Complex, step_s: float) -> tuple[Array, Complex]:
    """First-order hold of z' = s z + b u, w = Re c z over a block: T (BLOCK + 1, BLOCK) and W (BLOCK + 1, m)."""
    a, z = np.exp(s * step_s), s * step_s
    new = (a - 1 - z) / (s * z)  # weight of the drive at the end of a step
    old = (a - 1) / s - new  # and of the drive at its begin
    k = np.arange(BLOCK)
    powers = a[:, None] ** k
    both = powers * (a * new + old)[:, None]
    r = c * b
    later = (r @ both).real  # response `lag` + 1 steps after a drive
    T = np.zeros((BLOCK + 1, BLOCK))
    T[0] = (r @ (powers * old[:, None])).real
    for j in range(BLOCK):
        T[j + 1, j] = float((r @ new).real)
        T[j + 1, j + 1 :] = later[: BLOCK - 1 - j]
    W = np.zeros((BLOCK + 1, s.size), complex)
    W[0] = a ** (BLOCK - 1) * old
    W[1:BLOCK] = both[:, : BLOCK - 1][:, ::-1].T
    W[BLOCK] = new
    return T, W * b


def _residual_compliance(tactor: Tactor, n: int) -> float:
    """Return the compliance of the shapes beyond the n-th under a point load, m/N: its kink needs many of them."""
    form = tactor_modal_form(tactor, None, n, excitation="load")
    return float(load_compliance(tactor) + np.sum((form.residues / form.poles).real))


def limit_slew(target: Array, start_v: float, step_v: float) -> Array:
    """Return `target` followed from `start_v` with at most `step_v` per sample; unchanged if slow enough."""
    rises = target.copy()
    rises[1:] -= target[:-1]
    rises[0] -= start_v
    if rises.max() <= step_v and rises.min() >= -step_v:
        return target
    jumps = np.flatnonzero(np.abs(rises) > step_v)
    out, targets = target.copy(), target.tolist()
    i, n = int(jumps[0]), target.size
    while True:
        at = float(out[i - 1]) if i else start_v
        while i < n and abs(targets[i] - at) > step_v:
            at += math.copysign(step_v, targets[i] - at)
            out[i] = at
            i += 1
        # Caught up: sample i is admissible; continue at the next one that is not.
        later = int(np.searchsorted(jumps, i, side="right"))
        if later >= jumps.size:
            return out
        i = int(jumps[later])
