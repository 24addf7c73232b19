"""The tactor in time, exact from its poles: after a step, after the onset of a periodic drive, under any sampled drive."""

from typing import Literal

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike, NDArray

from model.parameters import Tactor
from model.poles import Modal
from model.quantity import ParameterError, Quantity
from model.response import modal
from model.skin import Skin

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

TIME = Quantity("time", "s", Interval(ge=0), "time since the drive began", None)
RATE = Quantity("rate", "Hz", Interval(gt=0), "sample rate of the drive", None)


def step_response(
    tactor: Tactor,
    time_s: ArrayLike,
    volts: float = 1500.0,
    skin: Skin | None = None,
    n: int = 7,
    x: float | None = None,
) -> Array:
    """w(x, t), m, after a step of `volts` on the specimen at t = 0 from rest; shape of `time_s`.

    Raises:
        ParameterError: a time < 0, n not in 3..300, x outside 0..L.
    """
    return volts * unit_step(modal(tactor, skin, n, x), TIME.check(time_s))


def unit_step(form: Modal, t: Array) -> Array:
    """sum_k r_k (exp(s_k t) - 1) / s_k for one output, shape of t."""
    s, r = form
    above = s.imag >= 0  # of a conjugate pair one tells both
    s, r = s[above], np.where(s.imag > 0, 2.0, 1.0)[above] * r[above]
    return np.asarray((np.expm1(np.multiply.outer(t, s)) @ (r / s)).real)


def onset_response(form: Modal, t: Array, frequency_hz: float, V: Complex) -> Complex:
    """Response to the drive Re sum_k V_k exp(i k w t) that begins at t = 0, complex before Re; shape of t.

    With one harmonic its modulus is the envelope, free of the start phase.
    """
    s, r = form
    k = 2j * np.pi * frequency_hz * np.arange(V.size)
    gain = V[:, None] * r / (k[:, None] - s)  # (K + 1, 2n)
    steady = np.exp(np.multiply.outer(t, k)) @ gain.sum(1)
    return np.asarray(steady - np.exp(np.multiply.outer(t, s)) @ gain.sum(0))


def sampled_response(
    tactor: Tactor,
    drive_v: ArrayLike,
    rate_hz: float,
    skin: Skin | None = None,
    n: int = 7,
    x: float | None = None,
    hold: Literal["linear", "zero"] = "linear",
) -> Array:
    """w(x) at each sample of a drive (volts on the specimen, shape (N,)), from rest; exact for the interpolation named.

    `hold` says what happens between samples: straight lines, or a value that is held as a digital output holds it.

    Raises:
        ParameterError: the drive is not finite, rate <= 0, n not in 3..300, x outside 0..L.
    """
    u = Quantity("drive", "V", Interval(), "sampled drive on the specimen", None).check(drive_v)
    if u.ndim != 1:
        raise ParameterError(f"drive has {u.ndim} axes: give one row of samples, shape (N,)")
    return march(modal(tactor, skin, n, x), u, float(RATE.check(rate_hz)), hold)


def march(form: Modal, u: Array, rate_hz: float, hold: Literal["linear", "zero"] = "linear") -> Array:
    """Exact recursion z_k[m + 1] = exp(s h) z_k[m] + drive over one sample, summed over the poles; shape (N,)."""
    from scipy.signal import lfilter

    w = np.zeros(u.size)
    for s, r in zip(*form, strict=True):
        if s.imag < 0:
            continue  # the conjugate of one already counted twice
        weight = (2 if s.imag > 0 else 1) * r / rate_hz
        b0, b1 = _weights(s / rate_hz, hold)
        forced = weight * (b0 * u + b1 * np.concatenate(([0.0], u[:-1])))
        forced[0] = 0  # at rest at the first sample
        w += lfilter([1.0], [1.0, -np.exp(s / rate_hz)], forced).real
    return w


def _weights(sh: complex, hold: str) -> tuple[complex, complex]:
    """What the new and the old sample contribute over one sample, in units of its length."""
    p1 = complex(np.expm1(sh)) / sh
    if hold == "zero":
        return 0.0, p1
    p2 = (p1 - 1) / sh if abs(sh) > 1e-2 else 1 / 2 + sh * (1 / 6 + sh * (1 / 24 + sh * (1 / 120 + sh / 720)))
    return p2, p1 - p2
