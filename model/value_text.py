"""Text of values with their standard uncertainty, rounded to two digits of it: the only place that writes `±`; text of times."""

import math

from model.quantities import EstimatedQuantity, find_quantity, quantity_label, shown_unit

COVERAGE_FACTOR_95 = 1.959964
"""Number of standard uncertainties on each side that covers 95 % of a normal distribution."""


def format_with_uncertainty(
    value: float, standard_error: float, unit: str = "1", signed: bool = False, digits: int = 6
) -> str:
    """Format a value to two digits of its standard error, `158.1203 ± 0.0041 Hz`; the value alone without an error.

    `signed` writes the sign of a positive value, too; `digits` is the number of significant digits of a value without an error.
    """
    sign = "+" if signed else ""
    text = f"{value:{sign}.{digits}g}"
    if standard_error > 0 and math.isfinite(standard_error):
        text = f"{value:{sign}z.{_decimal_places(standard_error)}f} {format_uncertainty(standard_error)}"
    return text if unit == "1" else f"{text} {unit}".rstrip()


def format_uncertainty(uncertainty: float, unit: str = "1") -> str:
    """Format an uncertainty alone to two digits: `± 0.45 µm`."""
    text = f"± {uncertainty:.{_decimal_places(uncertainty)}f}"
    return text if unit == "1" else f"{text} {unit}".rstrip()


def _decimal_places(uncertainty: float) -> int:
    """Return the number of decimal places of two digits of an uncertainty; 0 for none."""
    return max(1 - math.floor(math.log10(uncertainty)), 0) if 0 < uncertainty < math.inf else 0


def format_quantity(value: float, standard_error: float, unit: str, name: str = "", signed: bool = False) -> str:
    """Format an SI value and its standard error in bench units: 1.4e-4 m/V becomes `142.77 ± 0.10 µm/V`."""
    factor, shown = shown_unit(unit, name)
    quantity = find_quantity(name)
    digits = 6 if quantity is None else quantity.digits
    return format_with_uncertainty(factor * value, factor * standard_error, shown, signed, digits)


def format_value(estimate: EstimatedQuantity) -> str:
    """Format value and standard error of an estimate: `31.20 ± 0.40 N/m`."""
    return format_quantity(estimate.value, estimate.standard_error, estimate.unit, estimate.name)


def format_estimate(estimate: EstimatedQuantity) -> str:
    """Format name, value and standard error: `natural frequency 158.350 ± 0.010 Hz`."""
    return f"{quantity_label(estimate.name)} {format_value(estimate)}"


def format_time(utc: str, seconds: bool = False) -> str:
    """Format a stored time (ISO 8601, UTC) to the minute or second: `2026-11-28 03:18`."""
    return utc[: 19 if seconds else 16].replace("T", " ")
