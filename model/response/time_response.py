"""Step response and onset response of the tactor, exact from its poles."""

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike

from model import Array, Complex, ParameterSpec, Skin, Tactor
from model.beam import ModalForm
from model.response.harmonic_response import tactor_modal_form

TIME_SPEC = ParameterSpec("time", "s", Interval(ge=0), "time since the drive began", None)


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
    return volts * unit_step(tactor_modal_form(tactor, skin, n, x), TIME_SPEC.check(time_s))


def unit_step(form: ModalForm, t: Array) -> Array:
    """sum_k r_k (exp(s_k t) - 1) / s_k for one output, shape of t."""
    s, r = form
    above = s.imag >= 0  # one of each conjugate pair is enough
    s, r = s[above], np.where(s.imag > 0, 2.0, 1.0)[above] * r[above]
    return np.asarray((np.expm1(np.multiply.outer(t, s)) @ (r / s)).real)


def onset_response(form: ModalForm, t: Array, frequency_hz: float, V: Complex) -> Complex:
    """Response to the drive Re sum_k V_k exp(i k w t) that begins at t = 0, complex before Re; shape of t.

    With one harmonic its modulus is the envelope, free of the start phase.
    """
    s, r = form
    k = 2j * np.pi * frequency_hz * np.arange(V.size)
    gain = V[:, None] * r / (k[:, None] - s)  # (K + 1, 2n)
    steady = np.exp(np.multiply.outer(t, k)) @ gain.sum(1)
    return np.asarray(steady - np.exp(np.multiply.outer(t, s)) @ gain.sum(0))
