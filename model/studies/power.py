"""Electrical power of a periodic drive: lost in the specimen, and delivered by a driver; the drive with the least power.

The specimen takes the charge Q = (C - iD + q(omega)) V: a clamped capacitance C, a dielectric loss D, the same at all frequencies, and
the charge q of its bending, which follows by reciprocity from the moment `mu` per volt. A driver without recovery delivers the positive
part of volts times current; the negative part it turns into heat. A sine of volts Vpp takes pi f C tan(delta) Vpp^2 / 4 in the
specimen, and a driver delivers f C Vpp^2 / 4 for it; a symmetric square through a resistance R delivers
f C Vpp^2 / 4 tanh^2(1 / 4 f R C).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from annotated_types import Interval

from model import AmplifierMap, Array, Complex, ParameterError, ParameterSpec, Specimen, replace_variables
from model.beam import modal_form, receptance
from model.response import (
    fourier_series,
    frequency_response,
    harmonic_orders,
    peak_to_peak,
    square_wave_series,
    system_matrices,
)
from model.studies.design import FULL_AMPLITUDE_V, DesignAnswer
from model.studies.uncertainty import EstimateSet, linear_band

PowerWaveform = Literal["sine", "square", "belt"]
EDGES_S: Mapping[PowerWaveform, float] = {"square": 2e-5, "belt": 5e-4}
"""Time constants of the edges of a square: of the bench's amplifier, and of the belt's multivibrator (`square_wave_response`)."""

LOAD_HZ = 20.0
"""Frequency of capacitance and loss factor of a load, far below resonance."""

ORDERS = 2048
"""Number of harmonics: the current of an edge of 20 µs is resolved from 20 Hz on."""

LOAD_SPECS = {
    spec.name: spec
    for spec in (
        ParameterSpec.listed("capacitance", Interval(gt=0, lt=1e-6), None),
        ParameterSpec.listed("loss_factor", Interval(ge=0, lt=1), None),
        ParameterSpec("efficiency", "1", Interval(gt=0, le=1), "share of the driver's input that it delivers", 1.0),
    )
}
"""Electrical load of a drive, and efficiency of the driver: parameters beside those of the model."""


@dataclass(frozen=True, slots=True)
class DrivePower:
    """A drive for an amplitude; standard errors are None without estimates.

    Attributes:
        frequency_hz: frequency of the drive.
        drive_v: volts peak to peak at the amplifier's input.
        specimen_w: power lost in the specimen: dielectric loss, and friction of the bending.
        driver_w: power into the driver, its output divided by its efficiency, without recovery.
    """

    waveform: PowerWaveform
    frequency_hz: float
    drive_v: DesignAnswer
    specimen_w: DesignAnswer
    driver_w: DesignAnswer

    @property
    def can_be_played(self) -> bool:
        """Whether the amplifier's input range admits the drive."""
        return self.drive_v.value <= 2 * FULL_AMPLITUDE_V


def drive_power(
    specimen: Specimen,
    waveform: PowerWaveform,
    frequency_hz: float,
    peak_to_peak_m: float,
    load: EstimateSet,
    estimates: EstimateSet | None = None,
    amplifier: AmplifierMap | None = None,
    n: int = 7,
) -> DrivePower:
    """Return drive and powers for a max - min of the displacement; the drive swings around rest.

    Args:
        specimen: the specimen, free or on a skin.
        waveform: sine, square with the edges of the bench's amplifier, or square of the belt.
        frequency_hz: frequency of the drive.
        peak_to_peak_m: max - min of the displacement.
        load: `capacitance` in F and `loss_factor` at `LOAD_HZ`, with the charge of the bending, and `efficiency`, with covariance.
        estimates: estimates of the specimen's parameters with covariance, independent of the load.
        amplifier: static map of the amplifier.
        n: number of shape functions.

    Raises:
        ParameterError: a value out of range, or a capacitance that is less than the bending takes.
    """
    if not peak_to_peak_m > 0:
        raise ParameterError(f"amplitude is {peak_to_peak_m:g} m: it must be greater than 0")
    both = load if estimates is None else _joined(estimates, load)
    volts = _voltage(waveform, frequency_hz, amplifier or AmplifierMap())

    def answers(values: Mapping[str, Array]) -> Array:
        rows = [dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True)]
        return np.array([_figures(specimen, row, frequency_hz, volts, peak_to_peak_m, n) for row in rows])

    band = linear_band(answers, both)
    is_stated = bool(np.diag(both.covariance).any())
    drive, lost, delivered = (
        DesignAnswer(float(value), float(error) if is_stated else None)
        for value, error in zip(band.centre, band.standard_error, strict=True)
    )
    return DrivePower(waveform, frequency_hz, drive, lost, delivered)


def least_power(
    specimen: Specimen,
    waveform: PowerWaveform,
    frequencies_hz: Sequence[float],
    peak_to_peak_m: float,
    load: EstimateSet,
    estimates: EstimateSet | None = None,
    amplifier: AmplifierMap | None = None,
    n: int = 7,
) -> DrivePower:
    """Return the drive whose driver takes the least power among some frequencies, with the errors at its frequency.

    Raises:
        ParameterError: as `drive_power`; or the amplifier's range suffices at no frequency.
    """
    known = EstimateSet(load.names, load.values, np.zeros((len(load.names),) * 2), load.specs)
    tried = [drive_power(specimen, waveform, f, peak_to_peak_m, known, None, amplifier, n) for f in frequencies_hz]
    if not (played := [each for each in tried if each.can_be_played]):
        nearest = min(tried, key=lambda each: each.drive_v.value)
        raise ParameterError(
            f"a {waveform} gives {1e6 * peak_to_peak_m:g} µm at none of the frequencies: {nearest.frequency_hz:.4g} Hz needs "
            f"{nearest.drive_v.value:.3g} V peak to peak of {2 * FULL_AMPLITUDE_V:g} V; ask for less"
        )
    best = min(played, key=lambda each: each.driver_w.value)
    return drive_power(specimen, waveform, best.frequency_hz, peak_to_peak_m, load, estimates, amplifier, n)


def battery_life(battery_wh: float, driver_w: DesignAnswer, on_share: float = 1.0, idle_w: float = 0.0) -> DesignAnswer:
    """Return the time that a battery lasts, h.

    Args:
        battery_wh: its usable energy.
        driver_w: power into the driver while it drives.
        on_share: share of the time in which it drives.
        idle_w: power that the driver takes at all times.
    """
    power_w = on_share * driver_w.value + idle_w
    life_h = battery_wh / power_w
    error = driver_w.standard_error
    return DesignAnswer(life_h, None if error is None else life_h * on_share * error / power_w)


def load_set(
    capacitance: tuple[float, float], loss_factor: tuple[float, float], efficiency: tuple[float, float] = (1.0, 0.0)
) -> EstimateSet:
    """Return a load of independent values, each with its standard uncertainty. Raises ParameterError."""
    pairs = (capacitance, loss_factor, efficiency)
    return EstimateSet(
        tuple(LOAD_SPECS), tuple(value for value, _ in pairs), np.diag([error**2 for _, error in pairs]), LOAD_SPECS
    )


def _joined(estimates: EstimateSet, load: EstimateSet) -> EstimateSet:
    first, names = len(estimates.names), (*estimates.names, *load.names)
    covariance = np.zeros((len(names),) * 2)
    covariance[:first, :first], covariance[first:, first:] = estimates.covariance, load.covariance
    return EstimateSet(names, (*estimates.values, *load.values), covariance, {**estimates.specs, **load.specs})


def _voltage(waveform: PowerWaveform, frequency_hz: float, amplifier: AmplifierMap) -> Complex:
    """Return the harmonics of the volts on the specimen under the largest drive, (ORDERS + 1,)."""
    if waveform == "sine":
        return fourier_series("sine", FULL_AMPLITUDE_V, amplifier.rest_v, amplifier, ORDERS)
    return square_wave_series(
        frequency_hz, FULL_AMPLITUDE_V, amplifier.rest_v, 0.5, EDGES_S[waveform], amplifier, ORDERS
    )


def _figures(
    specimen: Specimen, values: Mapping[str, float], frequency_hz: float, volts: Complex, peak_to_peak_m: float, n: int
) -> tuple[float, float, float]:
    """Return drive, V peak to peak, and power in the specimen and into the driver, W; a drive around rest scales all volts."""
    at = replace_variables(specimen, {name: v for name, v in values.items() if name not in LOAD_SPECS})
    tactor, skin = at.acting_tactor, at.skin
    k = np.arange(volts.size)
    moving = k[: harmonic_orders(np.array([frequency_hz])) + 1]
    w = frequency_response(tactor, frequency_hz * moving, skin, n) * volts[moving]
    share = peak_to_peak_m / float(peak_to_peak(w))
    m = system_matrices(tactor, skin, n)
    charge = modal_form(m.M, m.C, m.K, m.B, 2 * m.B)
    bent = complex(receptance(charge, np.array([2 * np.pi * LOAD_HZ]))[0])
    clamped = values["capacitance"] - bent.real
    if clamped <= 0:
        raise ParameterError(
            f"capacitance is {1e9 * values['capacitance']:.4g} nF: the bending alone takes {1e9 * bent.real:.4g} nF; measure it at {LOAD_HZ:g} Hz"
        )
    lost = max(values["capacitance"] * values["loss_factor"] + bent.imag, 0.0)
    farads = np.full(volts.size, clamped - 1j * lost)
    omega = np.asarray(2 * np.pi * frequency_hz * moving, float)
    farads[moving] = farads[moving] + receptance(charge, omega)
    current = 2j * np.pi * frequency_hz * k * farads * volts
    specimen_w = 0.5 * float(np.sum((np.conj(volts) * current).real))
    v, i = (_samples(each) for each in (volts, current))
    delivered_w = float(np.maximum(v * i, 0.0).mean()) / values["efficiency"]
    return 2 * FULL_AMPLITUDE_V * share, share**2 * specimen_w, share**2 * delivered_w


def _samples(series: Complex) -> Array:
    """Return one period of Re sum_k series_k exp(i k theta), (8 ORDERS,).

    Lanczos' factors keep edges from ringing, which would count as power to and fro.
    """
    half = series * np.sinc(np.arange(series.size) / series.size) / 2
    half[0] = series[0].real
    points = 8 * ORDERS
    return np.asarray(np.fft.irfft(half, points) * points)
