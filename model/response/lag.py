"""Hysteresis and creep of the MFC in the response to a sine.

Creep is a compliance that grows with the logarithm of time, so that its factor of the response is complex and falls with the
frequency. Hysteresis follows Rayleigh's law: at full drive a share `hysteresis` of the deflection comes late, in proportion to
the drive. Stiffness and moment refer to the time of 100 Hz and a small drive, where both are zero.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import AmplifierMap, Array, Complex, Specimen
from model.drive_history import rayleigh_loop, rayleigh_response
from model.response.drive_spectrum import sine_harmonics

if TYPE_CHECKING:
    from model.response.periodic_response import PeriodicResponse

REFERENCE_S = 1 / (2 * np.pi * 100)
"""Time at which creep is zero by definition: the time constant of 100 Hz, near the resonance."""
LOOP_SAMPLES = 2048
"""Samples per period, for the harmonics of hysteresis."""


def crept_response(creep: Any, omega: Any) -> Any:
    """Return the factor of the response at `omega` (rad/s): a compliance that grows with the logarithm of time."""
    return 1 - creep * (np.log(1j * omega * REFERENCE_S) + np.euler_gamma) / np.log(10)


def loop_harmonics(amplifier: AmplifierMap, amplitude_v: ArrayLike, offset_v: ArrayLike) -> Complex:
    """Return V_k, k = 0..5, added by hysteresis under sines at the amplifier's input, per unit of hysteresis, (..., 6).

    Amplitudes and offsets, (...,), broadcast.
    """
    low, high = amplifier.specimen_v([amplifier.low_v, amplifier.high_v]).tolist()
    theta = 2 * np.pi * np.arange(LOOP_SAMPLES) / LOOP_SAMPLES
    amplitude, offset = (np.asarray(a, float)[..., None] for a in (amplitude_v, offset_v))
    loop = rayleigh_loop(amplifier.specimen_v(offset + amplitude * np.sin(theta))) / ((high - low) / 2)
    return np.asarray(2 * np.fft.rfft(loop)[..., :6] / LOOP_SAMPLES)


def loop_share(volts: Array, lines: NDArray[np.int_], amplifier: AmplifierMap) -> Complex:
    """Return the addition of a hysteresis of 1 to lines of the spectrum, (F,), as a share of the volts on the specimen.

    `volts` (N,) are one period at the amplifier's input, which begins at rest; line 1 has this period.
    """
    low, high = amplifier.specimen_v([amplifier.low_v, amplifier.high_v]).tolist()
    driven = amplifier.specimen_v(volts)
    loop = rayleigh_response(np.tile(driven, 2), low, high)[volts.size :] / ((high - low) / 2)
    return np.asarray(np.fft.rfft(loop)[lines] / np.fft.rfft(driven)[lines])


def lag_factor(
    hysteresis: ArrayLike,
    creep: ArrayLike,
    frequency_hz: ArrayLike,
    amplitude_v: float = 2.5,
    offset_v: float | None = None,
    amplifier: AmplifierMap | None = None,
) -> Complex:
    """Return the complex factor of the fundamental under a sine at the amplifier's input, (..., F).

    `hysteresis` and `creep` are numbers or arrays (...,) of parameter sets; the offset is rest by default. Max - min is larger by
    the magnitude of the factor, apart from the third harmonic of hysteresis, a fiftieth of its contribution.
    """
    map_ = amplifier or AmplifierMap()
    drive = (map_, float(amplitude_v), float(map_.rest_v if offset_v is None else offset_v))
    late = loop_harmonics(*drive)[1] / sine_harmonics(*drive[1:], map_, 1, 1)[0] if np.any(hysteresis) else 0.0
    f = np.maximum(np.atleast_1d(np.asarray(frequency_hz, float)), 1e-9)
    crept = crept_response(np.asarray(creep, float)[..., None], 2 * np.pi * f)
    return np.asarray((1 + np.asarray(hysteresis, float)[..., None] * late) * crept, complex)


def with_lag(
    response: "PeriodicResponse", specimen: Specimen, amplitude_v: float, offset_v: float, amplifier: AmplifierMap
) -> "PeriodicResponse":
    """Return the response of a specimen's beam with the hysteresis and creep of its MFC, as under a sine of this drive."""
    if not (specimen.hysteresis or specimen.creep):
        return response
    factor = lag_factor(specimen.hysteresis, specimen.creep, response.frequency_hz, amplitude_v, offset_v, amplifier)
    harmonics = response.harmonics.copy()
    harmonics[:, 1:] *= factor[:, None]
    return replace(response, harmonics=harmonics, peak_to_peak=response.peak_to_peak * np.abs(factor))
