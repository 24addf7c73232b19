"""Exact response to a finite linear sweep: each pole driven by a chirp is a complex error function.

For z' = s z + exp(i theta(t)), theta = a t + b t^2 / 2, from rest, completing the square gives

    z(t) = sqrt(pi) / (2 p) exp(s t + q^2) [erfc(-q) - erfc(p t - q)],   p^2 = -i b / 2,  q = (i a - s) / (2 p),

written with the scaled function wofz so that nothing overflows. The amplifier's k-th harmonic is a chirp with k a and k b.
"""

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike

from model import AmplifierMap, Array, Complex, Mask, ParameterError, ParameterSpec, Skin, Tactor
from model.beam import ModalForm
from model.response.drive_spectrum import fourier_series
from model.response.harmonic_response import FREQUENCY_SPEC, tactor_modal_form

DURATION_SPEC = ParameterSpec("duration", "s", Interval(gt=0), "duration of the sweep", None)


def sweep_response(
    tactor: Tactor,
    time_s: ArrayLike,
    start_hz: float = 25.0,
    stop_hz: float = 525.0,
    duration_s: float = 300.0,
    amplitude_v: float = 2.5,
    offset_v: float = 2.5,
    amplifier: AmplifierMap | None = None,
    skin: Skin | None = None,
    n: int = 7,
    orders: int = 16,
) -> Array:
    """Centre deflection, m, at times within a linear sweep at the amplifier's input that begins at rest at t = 0.

    The input is `offset + amplitude sin(2 pi (start t + (stop - start) t^2 / (2 duration)))`; defaults are the paper's sweep.
    `orders` harmonics of the amplifier's two slopes are followed. Before t = 0 the offset has long been there.

    Raises:
        ParameterError: a time outside 0..duration, a frequency < 0, or a drive outside the amplifier's range.
    """
    duration = float(DURATION_SPEC.check(duration_s))
    t = ParameterSpec("time", "s", Interval(ge=0, le=duration), "time since the sweep began", None).check(time_s)
    start, stop = (float(FREQUENCY_SPEC.check(f)) for f in (start_hz, stop_hz))
    if orders < 1:
        raise ParameterError(f"orders is {orders}: at least the fundamental (1) must be followed")
    V = fourier_series("sine", amplitude_v, offset_v, amplifier or AmplifierMap(), orders)
    form = tactor_modal_form(tactor, skin, n)
    rest = float((amplifier or AmplifierMap()).specimen_v(offset_v))
    rate = (stop - start) / duration
    static = -(form.residues / form.poles).sum().real
    w = np.full(t.shape, rest * static)
    w += (V[0].real - rest) * chirp_response(form, t, 0.0, 0.0).real
    for k in range(1, orders + 1):
        w += (V[k] * chirp_response(form, t, 2 * np.pi * k * start, 2 * np.pi * k * rate)).real
    return w


def chirp_response(form: ModalForm, t: Array, a: float, b: float) -> Complex:
    """sum_k r_k z_k(t) for the drive exp(i (a t + b t^2 / 2)) from rest; complex, shape of t.

    The drive is complex, so the real and imaginary parts are the answers to the cosine and the sine.
    """
    w = np.zeros(t.shape, complex)
    for s, r in zip(*form, strict=True):
        w += r * ((np.exp(1j * a * t) - np.exp(s * t)) / (1j * a - s) if b == 0 else _chirp_response(s, t, a, b))
    return w


def _chirp_response(s: complex, t: Array, a: float, b: float) -> Complex:
    from scipy.special import wofz

    p = np.sqrt(-0.5j * b)
    q = (1j * a - s) / (2 * p)
    drive, decay = np.exp(1j * (a * t + b * t * t / 2)), np.exp(s * t)

    def half(zeta: Complex, factor: Complex) -> tuple[Complex, Mask]:
        """`factor` exp(zeta^2) erfc(zeta) without the 2 that erfc gains left of the origin, and where it is missing."""
        left = zeta.real < 0
        return np.where(left, -1, 1) * factor * wofz(1j * np.where(left, -zeta, zeta)), left

    begin, begin_left = half(np.broadcast_to(np.asarray(-q), t.shape), decay)
    now, now_left = half(p * t - q, drive)
    twos = begin_left.astype(float) - now_left
    passed = np.where(twos != 0, 2 * twos * np.exp(np.where(twos != 0, s * t + q * q, 0)), 0)
    return np.asarray(np.sqrt(np.pi) / (2 * p) * (begin - now + passed))
