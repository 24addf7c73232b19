"""A value and its error as figures: as many as the error allows."""

import math


def format_with_uncertainty(value: float, standard_error: float) -> str:
    """A value to the two figures its standard error has: `158.1203 ± 0.0041`; the value alone where there is none."""
    if not (standard_error > 0 and math.isfinite(standard_error)):
        return f"{value:.6g}"
    places = max(1 - math.floor(math.log10(standard_error)), 0)
    return f"{value:.{places}f} ± {standard_error:.{places}f}"
