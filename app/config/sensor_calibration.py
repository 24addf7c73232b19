"""Calibration of the displacement sensor: a line through two or more positions and the volts read there."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from app.common import UnitError, to_number
from app.config.certificate import Certificate, CertificateColumn
from model import misfit_factor

MIN_VOLTS_OVER_NOISE = 10.0
"""Least span of the volts, in standard errors of one reading, through which a line is drawn."""


POLYNOMIAL_POINTS = 2001
"""Volts at which the polynomial of a certificate is compared with its line."""
HIGHEST_ORDER = 9


class SensorCalibrationError(ValueError):
    """No line can be drawn; the message names the reason and the remedy."""


@dataclass(frozen=True, slots=True)
class CalibrationPoint:
    """A position by gauge block or micrometer and the sensor's volts there.

    Args:
        position_m: the position.
        position_uncertainty_m: its standard uncertainty, independent from point to point.
        volts: mean of the sensor's output.
        volts_error: standard error of this mean.
    """

    position_m: float
    position_uncertainty_m: float
    volts: float
    volts_error: float


@dataclass(frozen=True, slots=True)
class SensorCalibration:
    """The line position = gain * (volts - zero).

    Attributes:
        gain_m_per_v: its slope.
        zero_v: volts at position 0.
        gain_relative_uncertainty: standard uncertainty of the gain, relative: from the stated uncertainties, or from the scatter
            about the line where that is larger.
        residuals_m: position less line, point by point.
    """

    gain_m_per_v: float
    zero_v: float
    gain_relative_uncertainty: float
    residuals_m: tuple[float, ...]

    @property
    def is_gain_alone(self) -> bool:
        """Whether it is a stated gain, without points and zero."""
        return not self.residuals_m

    def rounded(self) -> dict[str, float]:
        """Return the values of the table [sensor] with the digits that their uncertainty leaves, and one more."""
        gain_error = abs(self.gain_m_per_v) * self.gain_relative_uncertainty
        digits = 6 if gain_error <= 0 else max(math.ceil(math.log10(abs(self.gain_m_per_v) / gain_error)) + 2, 3)
        return {
            "gain_m_per_v": float(f"{self.gain_m_per_v:.{digits}g}"),
            "zero_v": round(self.zero_v, 6),
            "gain_relative_uncertainty": float(f"{self.gain_relative_uncertainty:.2g}"),
        }


def calibrate_sensor(points: Sequence[CalibrationPoint]) -> SensorCalibration:
    """Fit a line to positions and volts, weighted with their uncertainties.

    Raises:
        SensorCalibrationError: there are fewer than two points, or their positions or volts do not differ.
    """
    if len(points) < 2:
        raise SensorCalibrationError(
            f"a line needs two points, and there {'is one' if points else 'are none'}; take another"
        )
    x = np.array([p.position_m for p in points])
    v = np.array([p.volts for p in points])
    noise_v = np.array([p.volts_error for p in points])
    gauge_m = np.array([p.position_uncertainty_m for p in points])
    if np.ptp(x) == 0:
        raise SensorCalibrationError("all points have the same position; move the target and take another")
    if np.ptp(v) <= max(MIN_VOLTS_OVER_NOISE * noise_v.max(), 1e-6):
        raise SensorCalibrationError(
            f"the volts of all points agree within {np.ptp(v):.2g} V; move the target further, and look whether the sensor is in "
            "range and its output reaches the card"
        )
    gain = np.polyfit(v, x, 1)[0]
    variance = gauge_m**2 + (gain * noise_v) ** 2
    stated = bool((variance > 0).all())
    weights = 1 / variance if stated else np.ones_like(x)
    for _ in range(3):  # the volts' share of the variance depends on the gain
        v_mean, x_mean = np.average(v, weights=weights), np.average(x, weights=weights)
        spread = np.sum(weights * (v - v_mean) ** 2)
        gain = np.sum(weights * (v - v_mean) * (x - x_mean)) / spread
        if stated:
            weights = 1 / (gauge_m**2 + (gain * noise_v) ** 2)
    if gain == 0:
        raise SensorCalibrationError(
            "the line is flat: the volts do not follow the positions; check the order of the points"
        )
    residuals = x - x_mean - gain * (v - v_mean)
    chi2, freedom = float(np.sum(weights * residuals**2)), len(points) - 2
    scatter = misfit_factor(chi2, freedom) ** 2 if stated else chi2 / max(freedom, 1)
    gain_variance = scatter / spread
    return SensorCalibration(
        float(gain),
        float(v_mean - x_mean / gain),
        math.sqrt(gain_variance) / abs(float(gain)),
        tuple(residuals.tolist()),
    )


def calibration_of_certificate(
    certificate: Certificate, valid_v: tuple[float, float] = (-10.0, 10.0)
) -> SensorCalibration:
    """Return the line of a displacement sensor's certificate: of its gain, of its polynomial, or through its table of displacements and voltages.

    What is not a line has its residuals in the uncertainty of the gain. The coefficients of a polynomial are columns of one value in mm, mm/V,
    mm/V^2 ...; its line is the best one between the volts `valid_v`, the sensor's valid range.

    Raises:
        SensorCalibrationError: the certificate has neither, or no line fits.
    """
    if len(terms := _polynomial(certificate)) > 2:
        return _line_of_polynomial(terms, valid_v)
    named: dict[str, tuple[CertificateColumn, float]] = {}
    for column in certificate.columns:
        for unit in ("m/V", "m", "V"):
            with suppress(UnitError):
                named.setdefault(unit, (column, to_number(f"1 {column.unit}", unit)))
                break
    if gain := named.get("m/V"):
        column, factor = gain
        if len(set(column.values)) == 1 and column.values[0]:
            errors = column.standard_uncertainties or (0.0,)
            return SensorCalibration(factor * column.values[0], 0.0, max(errors) / abs(column.values[0]), ())
    if not ("m" in named and "V" in named):
        units = ", ".join(f"{each.name} [{each.unit}]" for each in certificate.columns) or "no table"
        raise SensorCalibrationError(
            f"certificate {certificate.number} has {units}; a gain (mm/V), or displacements (mm) with voltages (V) are needed"
        )
    (position, metres), (volts, per_volt) = named["m"], named["V"]
    none = (0.0,) * len(position.values)
    rows = zip(
        position.values,
        position.standard_uncertainties or none,
        volts.values,
        volts.standard_uncertainties or none,
        strict=False,
    )
    return calibrate_sensor(
        [CalibrationPoint(metres * x, metres * u, per_volt * v, per_volt * e) for x, u, v, e in rows]
    )


def _polynomial(certificate: Certificate) -> list[tuple[float, float]]:
    """Return the coefficients of a polynomial with their standard uncertainties, m/V^n, by their order; at most two are a gain and a zero."""
    found: dict[int, tuple[float, float]] = {}
    for column in certificate.columns:
        for order in range(HIGHEST_ORDER + 1) if len(set(column.values)) == 1 else ():
            with suppress(UnitError):
                factor = to_number(f"1 {column.unit}", f"m/V**{order}" if order else "m")
                found[order] = factor * column.values[0], factor * max(column.standard_uncertainties or (0.0,))
                break
    return [found.get(order, (0.0, 0.0)) for order in range(max(found, default=-1) + 1)]


def _line_of_polynomial(terms: Sequence[tuple[float, float]], valid_v: tuple[float, float]) -> SensorCalibration:
    v = np.linspace(*valid_v, POLYNOMIAL_POINTS)
    powers = v[:, None] ** np.arange(len(terms))
    coefficients, errors = np.transpose(terms)
    x = powers @ coefficients
    gain, offset = np.polyfit(v, x, 1)
    if gain == 0:
        raise SensorCalibrationError("the polynomial has no slope: check the coefficients and their units")
    slopes = np.polyfit(v, powers, 1)[0]  # of the line, by each coefficient
    residuals = x - gain * v - offset
    misfit = float(np.std(residuals) / np.std(gain * v))
    stated = float(np.sqrt(np.sum((slopes * errors) ** 2))) / abs(float(gain))
    return SensorCalibration(float(gain), float(-offset / gain), math.hypot(stated, misfit), tuple(residuals.tolist()))
