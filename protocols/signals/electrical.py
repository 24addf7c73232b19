"""Electrical response of a specimen: admittance, capacitance, loss, charge loop and energy per cycle; leakage at a held voltage.

Voltage and current, or charge, are fitted by a sine and its harmonics. With the admittance Y = G + jB at the fundamental the
capacitance is B / omega, in parallel to the loss G, and the loss factor G / B. The energy per cycle is the area of the loop of
charge over voltage, with all harmonics. Errors of gains act on magnitudes, errors of delays on phases.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from model import Array, Complex
from protocols.signals.checks import check_positive
from protocols.signals.sine import SineFit, fit_sine, line_fit_samples

HARMONICS = 16
"""Components of voltage and current: the amplifier's two slopes make even harmonics, hysteresis odd ones."""
QUIET_SHARE, QUIET_RMS = 0.99, 0.9616
"""Share of the changes from cycle to cycle that are noise, not a jump between two samples; rms of that share of normal noise."""
LOOP_PHASES = 128
"""Phases of a loop."""


class Uncertain(NamedTuple):
    """A value with its standard uncertainties: by noise alone, and with the stated errors of gains and delays."""

    value: float
    statistical: float
    total: float


@dataclass(frozen=True, slots=True)
class InputErrors:
    """Calibration of the two inputs.

    Attributes:
        voltage_delay_s, flow_delay_s: delays behind the sample times.
        gain_relative: relative standard uncertainty of the ratio of their gains.
        delay_s: standard uncertainty of the difference of their delays.
        bleed_s: of a charge: time constant of the sense capacitor; 0: none.
    """

    voltage_delay_s: float = 0.0
    flow_delay_s: float = 0.0
    gain_relative: float = 0.0
    delay_s: float = 0.0
    bleed_s: float = 0.0


@dataclass(frozen=True, slots=True)
class ElectricalResponse:
    """The response to a sine.

    Attributes:
        frequency_hz: frequency of the fundamental.
        voltage, current: complex amplitudes of the harmonics at the first sample, V and A, (J,) each.
        voltage_error, current_error: standard error of each component.
        capacitance: parallel capacitance, F.
        loss: loss factor.
        energy: energy per cycle, J.
    """

    frequency_hz: float
    voltage: Complex
    current: Complex
    voltage_error: float
    current_error: float
    capacitance: Uncertain
    loss: Uncertain
    energy: Uncertain

    @property
    def admittance_s(self) -> complex:
        """Admittance at the fundamental, S."""
        return complex(self.current[0] / self.voltage[0])

    @property
    def is_seen(self) -> bool:
        """Whether the current is significant: five standard errors."""
        return bool(abs(self.current[0]) > 5 * self.current_error)

    def loop(self) -> tuple[Array, Array, float]:
        """Return voltage and charge around a closed loop from the first sample on, (LOOP_PHASES + 1,), and the charge's error."""
        turns = np.multiply.outer(np.arange(LOOP_PHASES + 1) / LOOP_PHASES, np.arange(1, self.voltage.size + 1))
        omegas = 2 * math.pi * self.frequency_hz * np.arange(1, self.voltage.size + 1)
        waves = np.exp(2j * np.pi * turns)
        error = self.current_error * math.sqrt(float(np.sum(omegas**-2.0)))
        return (waves @ self.voltage).imag, (waves @ (self.current / (1j * omegas))).imag, error


def electrical_response(
    voltage: Array,
    flow: Array,
    rate_hz: float,
    frequency_hz: float,
    errors: InputErrors | None = None,
    is_charge: bool = False,
) -> ElectricalResponse:
    """Return the electrical response to a sine of known frequency.

    Args:
        voltage: volts on the specimen, (N,).
        flow: current into the specimen, A, or its charge, C, (N,).
        rate_hz: samples per second.
        frequency_hz: of the fundamental.
        errors: delays and uncertainties of the inputs; None: exact.
        is_charge: whether `flow` is a charge.

    Raises:
        ValueError: too few samples, or a voltage without the sine.
    """
    check_positive(rate_hz=rate_hz, frequency_hz=frequency_hz)
    errors = errors or InputErrors()
    fits = [fit_sine(samples, rate_hz, frequency_hz, HARMONICS) for samples in (voltage, flow)]
    jw = 2j * math.pi * fits[0].frequencies_hz
    v, i = (
        fit.components * np.exp(jw * delay_s)
        for fit, delay_s in zip(fits, (errors.voltage_delay_s, errors.flow_delay_s), strict=True)
    )
    v_error, i_error = (_error(samples, fit, rate_hz) for samples, fit in zip((voltage, flow), fits, strict=True))
    if is_charge:
        charge_to_current = jw + (1 / errors.bleed_s if errors.bleed_s else 0.0)
        i, i_error = i * charge_to_current, i_error * abs(charge_to_current[0])
    if not abs(v[0]) > 5 * v_error:
        raise ValueError(
            f"the voltage on the specimen has no sine of {frequency_hz:g} Hz; check that high voltage is on"
        )
    omega, y = float(jw[0].imag), complex(i[0] / v[0])
    noise = math.hypot(v_error / abs(v[0]), i_error / max(abs(i[0]), 1e-300))
    turned = omega * errors.delay_s
    capacitance, loss = y.imag / omega, y.real / y.imag if y.imag else math.inf
    energy = 0.5 * float(np.sum((np.conj(v) * i).real)) / frequency_hz
    energy_error = 0.5 / frequency_hz * math.hypot(_norm(v) * i_error, _norm(i) * v_error)
    turning = 0.5 * float(np.sum(jw.imag * (np.conj(v) * i).imag)) / frequency_hz  # harmonics turn farther
    c_error, loss_error = abs(y) * noise / omega, (1 + loss**2) * noise
    return ElectricalResponse(
        frequency_hz,
        v,
        i,
        v_error,
        i_error,
        Uncertain(
            capacitance, c_error, math.hypot(c_error, capacitance * errors.gain_relative, y.real / omega * turned)
        ),
        Uncertain(loss, loss_error, math.hypot(loss_error, (1 + loss**2) * turned)),
        Uncertain(
            energy, energy_error, math.hypot(energy_error, energy * errors.gain_relative, turning * errors.delay_s)
        ),
    )


def leakage_current(held: Array, rest: Array, rate_hz: float, errors: InputErrors, is_charge: bool) -> Uncertain:
    """Return the current at a held voltage, less the reading at rest, A.

    Args:
        held: current, A, or charge, C, at the held voltage, (N,).
        rest: likewise at rest, (M,).
        rate_hz: samples per second.
        errors: uncertainties of the inputs.
        is_charge: whether both are charges: their current is the slope, and what flows through the bleed resistor.
    """
    value = float(held.mean() - rest.mean())
    error = math.hypot(*(float(x.std(ddof=1)) / math.sqrt(x.size) for x in (held, rest)))
    if is_charge:
        (slope, slope_error), (at_rest, rest_error) = (_slope(x, rate_hz) for x in (held, rest))
        share = 1 / errors.bleed_s if errors.bleed_s else 0.0
        value, error = slope - at_rest + share * value, math.hypot(slope_error, rest_error, share * error)
    return Uncertain(value, error, math.hypot(error, value * errors.gain_relative))


def _slope(samples: Array, rate_hz: float) -> tuple[float, float]:
    """Return the slope of a line through samples, per second, and its standard error."""
    t = np.arange(samples.size) / rate_hz
    (slope, _), covariance = np.polyfit(t - t.mean(), samples, 1, cov=True)
    return float(slope), math.sqrt(float(covariance[0, 0]))


def _error(samples: Array, fit: SineFit, rate_hz: float) -> float:
    """Return the standard error of each component of a fit, by what does not repeat after some cycles.

    The amplifier's two slopes make harmonics beyond the fitted ones: in a current they fall off slowly and are larger than its noise.
    """
    period = rate_hz / fit.frequency_hz
    cycles = np.arange(1, int(0.5 * samples.size / period) + 1)
    if not cycles.size:
        return fit.standard_error
    lags = np.rint(cycles * period).astype(int)
    lag = lags[np.argmin(np.abs(lags - cycles * period))]
    residual = samples - line_fit_samples(fit, samples.size, rate_hz)
    change = np.abs(residual[lag:] - residual[:-lag])
    change = change[change <= np.quantile(change, QUIET_SHARE)]
    return float(np.sqrt(np.mean(change**2))) / (QUIET_RMS * math.sqrt(samples.size))


def _norm(components: Complex) -> float:
    return float(np.sqrt(np.sum(np.abs(components) ** 2)))
