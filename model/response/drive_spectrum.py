"""Fourier series of the voltage on the specimen for a periodic input of the two-slope amplifier.

The drive on the specimen is v(t) = Re sum_k V_k exp(i k omega t). A sine around rest arrives as 1000 sin + 500 |sin| at full
scale, so a series, not one number, excites the tactor.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import AmplifierMap, Array, Complex, ParameterError

Waveform = Literal["sine", "square"]


def fourier_series(
    waveform: Waveform,
    amplitude_v: float,
    offset_v: float,
    amplifier: AmplifierMap,
    orders: int = 64,
    duty: float = 0.5,
) -> Complex:
    """V_k, k = 0..orders, of `offset + amplitude * waveform` at the amplifier's input; exact, no sampling.

    The square starts high and is high for the fraction `duty` of its period.

    Raises:
        ParameterError: the input would leave the amplifier's range, or a value is not finite, or duty is outside 0..1.
    """
    check_input_range(offset_v - abs(amplitude_v), offset_v + abs(amplitude_v), amplifier)
    match waveform:
        case "sine":
            return sine_harmonics(amplitude_v, offset_v, amplifier, 0, orders)
        case "square":
            if not 0 < duty < 1:
                raise ParameterError(f"duty is {duty}: it must lie between 0 and 1; 0.5 is a symmetric square")
            high, low = amplifier.specimen_v([offset_v + amplitude_v, offset_v - amplitude_v])
            return _square(float(high), float(low), duty, orders)
    raise ParameterError(f"waveform is {waveform!r}: choose sine or square")


def check_input_range(lowest_v: float, highest_v: float, amplifier: AmplifierMap) -> None:
    """Reject a drive that leaves the amplifier's input range.

    Raises:
        ParameterError: lowest..highest, in volts at the input, does not lie within it.
    """
    slack = 1e-9 * (amplifier.high_v - amplifier.low_v)
    if not (lowest_v >= amplifier.low_v - slack and highest_v <= amplifier.high_v + slack):
        raise ParameterError(
            f"drive of {lowest_v:g}..{highest_v:g} V leaves the amplifier's input range "
            f"{amplifier.low_v:g}..{amplifier.high_v:g} V: lower the amplitude or move the offset"
        )


def sine_harmonics(
    amplitude_v: ArrayLike, offset_v: ArrayLike, amplifier: AmplifierMap, first: int, last: int
) -> Complex:
    """V_k, k = first..last, of sines at the amplifier's input, (..., last - first + 1), for amplitudes and offsets (...,).

    Piecewise a + b sin(theta) between the angles where the input crosses rest.
    """
    amplitude, offset = (np.asarray(a, float)[..., None] for a in (amplitude_v, offset_v))
    above = amplifier.rest_v - offset
    level = np.clip(np.divide(above, amplitude, out=np.zeros_like(above + amplitude), where=amplitude != 0), -1, 1)
    crossings = np.arcsin(level)
    ends = np.zeros_like(crossings)
    edges = np.sort(np.mod(np.concatenate((ends, crossings, np.pi - crossings), axis=-1), 2 * np.pi), axis=-1)
    edges = np.concatenate((edges, ends + 2 * np.pi), axis=-1)  # without a crossing one piece is empty
    middle = offset + amplitude * np.sin((edges[..., 1:] + edges[..., :-1]) / 2)
    slope = np.where(middle < amplifier.rest_v, amplifier.slope_below, amplifier.slope_above)
    E = _integral(np.arange(first - 1, last + 2), edges)  # integral of exp(-i k theta) over each piece
    a, b = (slope * (offset - amplifier.rest_v))[..., None, :], (slope * amplitude)[..., None, :]
    V = (a @ E[..., 1:-1] + b @ (E[..., :-2] - E[..., 2:]) / 2j)[..., 0, :] / np.pi
    if first == 0:
        V[..., 0] /= 2
    return np.asarray(V)


def _square(high: float, low: float, duty: float, orders: int) -> Complex:
    E = _integral(np.arange(orders + 1), 2 * np.pi * np.array([0.0, duty, 1.0]))
    V = np.array([high, low]) @ E / np.pi
    V[0] /= 2
    return np.asarray(V)


def _integral(k: NDArray[np.int64], edges: Array) -> Complex:
    """Integral of exp(-i k theta) over each interval of `edges`, shape (..., pieces, k.size)."""
    safe = np.where(k == 0, 1, k)
    phase = np.exp(-1j * edges[..., None] * k)
    return np.where(k == 0, np.diff(edges)[..., None], np.diff(phase, axis=-2) * 1j / safe)
