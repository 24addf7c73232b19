"""Rounding of a value to the digits its standard error allows."""

import math


def format_with_uncertainty(value: float, standard_error: float) -> str:
    """Format a value to two digits of its standard error, `158.1203 ± 0.0041`; the value alone without an error."""
    if not (standard_error > 0 and math.isfinite(standard_error)):
        return f"{value:.6g}"
    places = max(1 - math.floor(math.log10(standard_error)), 0)
    return f"{value:.{places}f} ± {standard_error:.{places}f}"
