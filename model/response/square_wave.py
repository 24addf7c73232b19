"""Response to a square wave with RC edges at the amplifier's input, with all its harmonics.

The wearable device is driven by an astable multivibrator (paper, Sec. II): a square wave of some duty cycle with the edges of an RC
circuit. Each half is an exponential, and the amplifier's two slopes meet where it crosses rest, so that the Fourier
series of the voltage on the specimen is a sum of integrals in closed form.
"""

import itertools
import math

import numpy as np
from numpy.typing import ArrayLike

from model import AmplifierMap, Complex, ParameterError, Skin, Tactor
from model.beam import receptance
from model.parameter_spec import PERIODIC_FREQUENCY_SPEC
from model.response.drive_spectrum import check_input_range
from model.response.harmonic_response import check_frequency, harmonic_orders, peak_to_peak, tactor_modal_form
from model.response.periodic_response import PeriodicResponse


def square_wave_response(
    tactor: Tactor,
    frequency_hz: ArrayLike,
    amplitude_v: float = 2.5,
    offset_v: float = 2.5,
    *,
    duty: float = 0.5,
    edge_s: float = 5e-4,
    amplifier: AmplifierMap | None = None,
    skin: Skin | None = None,
    n: int = 7,
) -> PeriodicResponse:
    """Response at the centre to a square wave with RC edges; time and phases begin where the wave rises through its offset.

    Args:
        tactor: the specimen.
        frequency_hz: (F,) or one.
        amplitude_v: distance of both final levels from `offset_v`, volts at the input.
        offset_v: mean of both final levels.
        duty: fraction of the period with relaxation to the upper level.
        edge_s: time constant of the edges in seconds.
        amplifier: static map of the amplifier.
        skin: skin on the tactor, if any.
        n: number of shape functions.

    Raises:
        ParameterError: a value is out of range, the wave does not cross its offset, or it leaves the amplifier's range.
    """
    f = PERIODIC_FREQUENCY_SPEC.check(check_frequency(frequency_hz))
    form, orders = tactor_modal_form(tactor, skin, n), harmonic_orders(f)
    k = np.arange(orders + 1)
    W = np.empty((f.size, orders + 1), complex)
    for row, one in enumerate(f.tolist()):
        V = square_wave_series(one, amplitude_v, offset_v, duty, edge_s, amplifier or AmplifierMap(), orders)
        W[row] = receptance(form, 2 * np.pi * one * k) * V
    return PeriodicResponse(f, np.concatenate((W[:, :1], 1j * W[:, 1:]), axis=1), peak_to_peak(W))


def square_wave_series(
    frequency_hz: float,
    amplitude_v: float,
    offset_v: float,
    duty: float,
    edge_s: float,
    amplifier: AmplifierMap,
    orders: int = 64,
) -> Complex:
    """V_k, k = 0..orders, of the specimen's voltage Re sum_k V_k exp(i k omega t); exact, no sampling.

    Raises:
        ParameterError: as `square_wave_response`.
    """
    if not 0 < duty < 1:
        raise ParameterError(f"duty is {duty}: it must lie between 0 and 1; 0.5 is a symmetric square")
    if not (edge_s > 0 and math.isfinite(edge_s)):
        raise ParameterError(f"edge_s is {edge_s}: it must be a positive number of seconds")
    period = 1 / frequency_hz
    rise, fall = math.exp(-duty * period / edge_s), math.exp(-(1 - duty) * period / edge_s)
    lowest = -amplitude_v * (1 - 2 * fall + rise * fall) / (1 - rise * fall)
    highest = amplitude_v * (1 - 2 * rise + rise * fall) / (1 - rise * fall)
    if not lowest < 0 < highest:
        raise ParameterError(
            f"a square wave of {frequency_hz:g} Hz with a duty of {duty:g} and edges of {edge_s:g} s does not cross its offset: "
            "lower the frequency or shorten the edges"
        )
    check_input_range(offset_v + lowest, offset_v + highest, amplifier)
    V = np.zeros(orders + 1, complex)
    begin = -edge_s * math.log(1 - lowest / amplitude_v)  # time of the rising edge
    for start, length, level, at_start in (
        (begin, duty * period, amplitude_v, lowest),
        (begin + duty * period, (1 - duty) * period, -amplitude_v, highest),
    ):
        # offset + level + (at_start - level) exp(-s / edge_s), s from 0 to length; cut where it crosses rest.
        ratio = (amplifier.rest_v - offset_v - level) / (at_start - level)
        crossing = -edge_s * math.log(ratio) if 0 < ratio < 1 else 0.0
        cuts = [0.0, crossing, length] if 0 < crossing < length else [0.0, length]
        for first, last in itertools.pairwise(cuts):
            middle = offset_v + level + (at_start - level) * math.exp(-(first + last) / 2 / edge_s)
            slope = amplifier.slope_below if middle < amplifier.rest_v else amplifier.slope_above
            constant, falling = slope * (offset_v + level - amplifier.rest_v), slope * (at_start - level)
            V += _coefficients(frequency_hz, orders, start, first, last, constant, falling, edge_s)
    V[1:] *= 2
    return V


def _coefficients(
    frequency_hz: float,
    orders: int,
    start: float,
    first: float,
    last: float,
    constant: float,
    falling: float,
    edge_s: float,
) -> Complex:
    """Mean over a period of (constant + falling exp(-s / edge_s)) exp(-i k omega (start + s)), s from first to last."""
    omega = 2j * np.pi * frequency_hz * np.arange(orders + 1)
    safe = np.where(omega == 0, 1, omega)
    flat = np.where(omega == 0, last - first, (np.exp(-safe * first) - np.exp(-safe * last)) / safe)
    rate = omega + 1 / edge_s
    fading = (np.exp(-rate * first) - np.exp(-rate * last)) / rate
    return np.asarray(frequency_hz * np.exp(-omega * start) * (constant * flat + falling * fading))
