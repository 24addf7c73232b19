"""Logarithmic creep of a drive: lags from the fastest motion to a day, exact on the plant's grid."""

import numpy as np

from model import Array
from sim_hardware.plant.stepper import BLOCK, first_order_hold, linear_recursion, with_previous

LAGS_PER_DECADE = 3
"""Two lags a decade let the creep per decade ripple by 0.2 %, three by 0.004 %."""
TIME_CONSTANTS_S = np.logspace(-6, 5, 11 * LAGS_PER_DECADE + 1)
"""Time constants of the lags: their sum follows the logarithm of time from 1 us to a day."""
REFERENCE_S = 1 / (2 * np.pi * 100)
"""Time of zero creep: the time constant of 100 Hz, about the resonance."""


class CreepModel:
    """Creep of one drive: a step gains the same share of itself in every decade of time.

    A sum of first-order lags, evenly spaced in the logarithm of time. The immediate part is reduced so that the response to a
    step is the step at `REFERENCE_S`. A lag of tau has followed a step by 1 - exp(-t / tau); the sum of these over a spectrum of
    lags that begins at tau_0 is ln(t / tau_0) + 0.577.

    Args:
        per_decade: share of a step gained in every decade of time.
        step_s: step of the plant's grid.
    """

    def __init__(self, per_decade: float, step_s: float) -> None:
        self._share = per_decade / LAGS_PER_DECADE
        begin = float(np.log10(TIME_CONSTANTS_S[0])) - 0.5 / LAGS_PER_DECADE
        self._instant = 1 + per_decade * (begin - float(np.log10(REFERENCE_S)) - np.euler_gamma / np.log(10))
        self._block_s = BLOCK * step_s
        self._lags = np.zeros(TIME_CONSTANTS_S.size)
        if self._share:
            s = (-1 / TIME_CONSTANTS_S).astype(complex)
            T, W = first_order_hold(s, -s, np.full(s.size, self._share, complex), step_s)
            T[np.arange(BLOCK) + 1, np.arange(BLOCK)] += self._instant
            of_lags = self._share * np.exp(np.multiply.outer(s.real * step_s, np.arange(BLOCK) + 1))
            self._of_drive, self._pulls = np.vstack((T, of_lags)), W.real
            self._advance = np.exp(s.real * self._block_s)

    def process(self, drive: Array, previous: float) -> Array:
        """Return a drive (n BLOCK,) with its creep; `previous` is the drive just before."""
        if not self._share or not (previous or drive.any() or self._lags.any()):
            return drive
        inputs = with_previous(drive, previous, self._lags.size)
        lags = linear_recursion(self._advance, self._lags, inputs[:, : BLOCK + 1] @ self._pulls)
        self._lags = lags[-1].copy()
        inputs[:, BLOCK + 1 :] = lags[:-1]
        return (inputs @ self._of_drive).ravel()

    def crept(self, drive: float) -> float:
        """Return a drive with its creep until now."""
        return self._instant * drive + self._share * float(self._lags.sum()) if self._share else drive

    def hold(self, drive: float, blocks: int) -> tuple[Array, Array]:
        """Return a constant drive with its creep at the edges of the next blocks, and the rate of its creep, (blocks + 1,) each."""
        if not self._share:
            return np.full(blocks + 1, drive), np.zeros(blocks + 1)
        edges_s = self._block_s * np.arange(blocks + 1)[:, None]
        behind = (drive - self._lags) * np.exp(-edges_s / TIME_CONSTANTS_S)
        crept = self._instant * drive + self._share * (drive - behind).sum(axis=1)
        return crept, self._share * (behind @ (1 / TIME_CONSTANTS_S))

    def curvature(self, drive: float) -> float:
        """Return a bound of the second derivative of the creep under a constant drive, per s^2."""
        return self._share * float(np.abs(drive - self._lags) @ TIME_CONSTANTS_S**-2.0)

    def advance(self, drive: float, gap_s: float) -> None:
        """Advance by `gap_s` of constant drive."""
        self._lags = drive + (self._lags - drive) * np.exp(-gap_s / TIME_CONSTANTS_S)
