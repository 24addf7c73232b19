"""Frequency response of the tactor from its poles: under a pure sine on the specimen, and under the amplifier's drive."""

from typing import TYPE_CHECKING, Literal

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike

from model import NO_SKIN, AmplifierMap, Array, Complex, ParameterSpec, Skin, Tactor
from model.beam import Matrices, ModalForm, gram, matrices, modal_form, receptance, shape_functions
from model.parameter_spec import PERIODIC_FREQUENCY_SPEC
from model.response.drive_spectrum import Waveform, fourier_series

if TYPE_CHECKING:
    from model.response.periodic_response import PeriodicResponse

Excitation = Literal["voltage", "load"]

FREQUENCY_SPEC = ParameterSpec("frequency", "Hz", Interval(ge=0), "frequency of the drive", None)
MAX_HARMONIC_HZ = 6000.0
"""Harmonics are followed well beyond the second resonance."""


def tactor_modal_form(
    tactor: Tactor, skin: Skin | None = None, n: int = 7, x: ArrayLike | None = None, excitation: Excitation = "voltage"
) -> ModalForm:
    """Poles (2n,) and residues of w(x) for exact time stepping: w = Re sum r_k z_k, z_k' = s_k z_k + V(t).

    `x` in m: None is the centre, a float gives residues (2n,), an array of X positions gives (X, 2n). `excitation` is a volt
    on the specimen or a newton at the centre.

    Raises:
        ParameterError: n is not in 3..300, or x lies outside 0..L.
    """
    m = system_matrices(tactor, skin, n)
    N = m.B_F * 2 if x is None else output_rows(tactor, x, n)
    return modal_form(m.M, m.C, m.K, m.B if excitation == "voltage" else m.B_F, N)


def system_matrices(tactor: Tactor, skin: Skin | None = None, n: int = 7) -> Matrices:
    """M, C, K, B of Eqs. (13)-(14) for one tactor, shapes (n, n) and (n,)."""
    skin = skin or NO_SKIN
    return matrices(tactor.beam, skin.k_s, skin.c_s, n)


def poles(tactor: Tactor, skin: Skin | None = None, n: int = 7) -> Complex:
    """The 2n poles s (rad/s) of Eq. (13), slowest first, the conjugate with positive imaginary part leading.

    |s| / 2 pi is the undamped frequency of the pole in Hz and -Re s / |s| its damping ratio.
    """
    m = system_matrices(tactor, skin, n)
    # One set of many: NumPy's eigenvalues, without loading SciPy for a single question.
    s = modal_form(m.M[None], m.C[None], m.K[None], m.B[None], 2 * m.B_F[None]).poles[0]
    return np.asarray(s[np.lexsort((-s.imag, np.round(np.abs(s), 9)))])


def frequency_response(
    tactor: Tactor,
    frequency_hz: ArrayLike,
    skin: Skin | None = None,
    n: int = 7,
    x: ArrayLike | None = None,
    excitation: Excitation = "voltage",
) -> Complex:
    """Complex deflection at `x` (m, default the centre) per volt on the specimen, m/V; Eq. (13) in the steady state.

    Shape (F,) for x None or a float, (X, F) for X positions. `excitation="load"` gives m per newton at the centre instead.

    Raises:
        ParameterError: a frequency < 0, n not in 3..300, x outside 0..L.
    """
    f = check_frequency(frequency_hz)
    return receptance(tactor_modal_form(tactor, skin, n, x, excitation), 2 * np.pi * f)


def amplifier_response(
    tactor: Tactor,
    frequency_hz: ArrayLike,
    amplitude_v: float = 2.5,
    offset_v: float = 2.5,
    amplifier: AmplifierMap | None = None,
    skin: Skin | None = None,
    waveform: Waveform = "sine",
    n: int = 7,
    x: float | None = None,
) -> "PeriodicResponse":
    """Response to `offset_v + amplitude_v * waveform` (volts, peak) at the amplifier's *input*.

    Raises:
        ParameterError: as `frequency_response`; or a frequency of 0; or a drive outside the amplifier's input range.
    """
    f = check_frequency(frequency_hz)
    V = fourier_series(waveform, amplitude_v, offset_v, amplifier or AmplifierMap(), harmonic_orders(f))
    return periodic_response(tactor_modal_form(tactor, skin, n, x), f, V)


SEPARATE_HZ = (20.0, 40.0, 80.0, 160.0)
"""Bounds of the frequency ranges of a curve that are computed separately: harmonics are needed up to a fixed frequency, fewer for
a higher drive frequency."""


def driven_amplitudes(
    tactor: Tactor,
    frequency_hz: ArrayLike,
    amplitude_v: float,
    amplifier: AmplifierMap,
    skin: Skin | None = None,
    n: int = 7,
) -> tuple[Array, Array]:
    """Max - min and amplitude of the fundamental, m, (F,) each, under a sine around rest at the amplifier's input.

    Raises:
        ParameterError: as `amplifier_response`.
    """
    f = check_frequency(frequency_hz)
    form = tactor_modal_form(tactor, skin, n)
    whole, fundamental = np.empty(f.size), np.empty(f.size)
    group = np.searchsorted(SEPARATE_HZ, f, side="right")
    for number in np.unique(group):
        here = group == number
        V = fourier_series("sine", amplitude_v, amplifier.rest_v, amplifier, harmonic_orders(f[here]))
        response = periodic_response(form, f[here], V)
        whole[here], fundamental[here] = response.peak_to_peak, np.abs(response.fundamental)
    return whole, fundamental


def periodic_response(form: ModalForm, frequency_hz: Array, V: Complex) -> "PeriodicResponse":
    """Response of one `ModalForm` output to a series V_k (K + 1,) of specimen volts, at every frequency of `frequency_hz`."""
    from model.response.periodic_response import PeriodicResponse  # modal forms need it not

    f = PERIODIC_FREQUENCY_SPEC.check(frequency_hz)
    k = np.arange(V.size)
    H = receptance(form, np.outer(2 * np.pi * f, k).ravel()).reshape(f.size, k.size)
    W = H * V
    return PeriodicResponse(f, np.concatenate((W[:, :1], 1j * W[:, 1:]), axis=1), peak_to_peak(W))


def peak_to_peak(W: Complex) -> Array:
    """Max - min of Re sum_k W_k exp(i k theta) over a period; shape (...,) for W (..., K + 1).

    Sampled four times finer than its highest harmonic needs, then a parabola through the extreme sample.
    """
    points = samples_per_period(W.shape[-1])
    half = W / 2
    half[..., 0] = W[..., 0].real
    w = np.fft.irfft(half, points, axis=-1) * points
    return interpolated_maximum(w) + interpolated_maximum(-w)


def samples_per_period(orders: int) -> int:
    """Number of samples of one period that resolves `orders` harmonics, a power of two."""
    return max(1024, 8 << orders.bit_length())


def interpolated_maximum(w: Array) -> Array:
    """Return the maximum along the last axis, by a parabola through the largest sample and its neighbours."""
    top = w.argmax(-1, keepdims=True)
    a, b, c = (np.take_along_axis(w, (top + i) % w.shape[-1], -1)[..., 0] for i in (-1, 0, 1))
    curvature = np.maximum(2 * b - a - c, np.finfo(float).tiny)
    return np.asarray(b + (a - c) ** 2 / (8 * curvature))


def harmonic_orders(frequency_hz: Array) -> int:
    """Number of relevant harmonics of the lowest of the frequencies, (F,), Hz: up to 6 kHz, at least 32, at most 512."""
    positive = frequency_hz[frequency_hz > 0]
    lowest = float(positive.min()) if positive.size else MAX_HARMONIC_HZ
    return int(np.clip(np.ceil(MAX_HARMONIC_HZ / lowest), 32, 512))


def check_frequency(frequency_hz: ArrayLike) -> Array:
    """Frequencies in Hz as an array of at least one axis.

    Raises:
        ParameterError: one is below 0 or not finite.
    """
    f = FREQUENCY_SPEC.check(frequency_hz)
    return f if f.ndim else f[None]


def check_position(tactor: Tactor, x: ArrayLike) -> Array:
    """Positions along the beam in m, shape kept.

    Raises:
        ParameterError: one lies outside 0..L.
    """
    return ParameterSpec("x", "m", Interval(ge=0, le=tactor.L), "distance from the clamp", None).check(x)


def output_rows(tactor: Tactor, x: ArrayLike, n: int = 7) -> Array:
    """Rows that transform generalised coordinates into w(x), shape (*x.shape, n)."""
    l1, l2 = tactor.L1 / tactor.L, tactor.L2 / tactor.L
    N = shape_functions(check_position(tactor, x) / tactor.L, l1, l2, n)
    return np.moveaxis(N, 0, -1) @ gram(l1, l2, n).basis.T
