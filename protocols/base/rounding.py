"""Rounding of a value to the digits its standard error allows."""

import math


def format_with_uncertainty(value: float, standard_error: float, unit: str = "1") -> str:
    """Format a value to two digits of its standard error, `158.1203 ± 0.0041 Hz`; the value alone without an error."""
    text = f"{value:.6g}"
    if standard_error > 0 and math.isfinite(standard_error):
        places = max(1 - math.floor(math.log10(standard_error)), 0)
        text = f"{value:.{places}f} ± {standard_error:.{places}f}"
    return text if unit == "1" else f"{text} {unit}"
