"""Number formatting of the report: rounding to the uncertainty, powers of ten, unit exponents."""

import math

from app.common import SUPERSCRIPTS, typeset_unit
from model import format_with_uncertainty, shown_unit

MINUS = "−"
SPACE = "\N{NO-BREAK SPACE}"
"""Keeps number, error and unit on one line."""


def typeset_measurement(value: float, error: float, unit: str, name: str = "") -> str:
    """Format an SI value with its standard error in its display unit: `(−13.300 ± 0.025) × 10⁻⁶ N m/V`.

    Without an error, to six digits.
    """
    factor, unit = shown_unit(unit, name)
    text = typeset_with_error(factor * value, factor * error)
    return f"{text}{SPACE}{typeset_unit(unit).replace(' ', SPACE)}".rstrip()


def typeset_with_error(value: float, error: float) -> str:
    """Round a number to two digits of its error."""
    if not math.isfinite(value):
        return "none"
    if not (error > 0 and math.isfinite(error)):
        return typeset_number(value)
    if abs(value) > error >= 100:  # format_with_uncertainty rounds decimals only
        value, error = (round(each, 1 - math.floor(math.log10(error))) for each in (value, error))
    power = _engineering_exponent(max(abs(value), error))
    text = format_with_uncertainty(value / 10.0**power, error / 10.0**power).replace("-", MINUS)
    return _append_power(f"({text})" if power else text, power).replace(" ", SPACE)


def typeset_number(value: float, figures: int = 6) -> str:
    """Format a number without an error to significant digits."""
    if not math.isfinite(value):
        return "none"
    power = _engineering_exponent(abs(value))
    text = f"{value / 10.0**power:.{figures}g}".replace("-", MINUS)
    return _append_power(text, power)


def typeset_probability(p: float) -> str:
    """Format a p value: `0.31`, `4 × 10⁻⁸`, `< 10⁻¹⁰`."""
    if not math.isfinite(p):
        return "none"
    if p < 1e-10:
        return "< 10⁻¹⁰"
    if p >= 1e-3:
        return f"{p:.2g}"
    power = math.floor(math.log10(p))
    return _append_power(f"{p / 10.0**power:.0f}", power)


def _append_power(text: str, power: int) -> str:
    return f"{text} × 10{str(power).translate(SUPERSCRIPTS)}" if power else text


def _engineering_exponent(size: float) -> int:
    """Return a power of ten that is a multiple of three; 0 from 0.01 to 100 000."""
    if not size or 0.01 <= size < 1e5:
        return 0
    return 3 * math.floor(math.log10(size) / 3)
