"""Characteristics of thermometers: platinum resistance, thermistor, or a table, such as of a thermocouple, to degrees Celsius."""

import numpy as np
from numpy.typing import NDArray

COEFFICIENTS = {"callendar-van-dusen": 4, "steinhart-hart": 3}
"""Number of coefficients of each formula; a table has pairs."""

ZERO_C_K = 273.15
NEWTON_STEPS = 8
"""Steps of Newton's method: from -200 °C on, four give the last digit."""


def read_coefficients(curve: str, text: str) -> tuple[float, ...]:
    """Parse the coefficients of a characteristic, numbers separated by commas.

    Raises:
        ValueError: they are not numbers, too few or too many, or the values of a table do not rise.
    """
    try:
        found = tuple(float(each) for each in text.split(",") if each.strip())
    except ValueError:
        raise ValueError(f"must be numbers separated by commas, not '{text[:40]}'") from None
    if curve == "table":
        if len(found) < 4 or len(found) % 2 or not (np.diff(found[::2]) > 0).all():
            raise ValueError("must be at least two pairs of a value and its temperature in degC, with rising values")
    elif len(found) != COEFFICIENTS.get(curve, 0):
        raise ValueError(f"must be {COEFFICIENTS.get(curve, 0)} numbers for the curve {curve}, not {len(found)}")
    return found


def temperature_c(curve: str, coefficients: tuple[float, ...], value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return temperatures, degrees Celsius, of values of a thermometer, same shape; NaN outside its characteristic.

    - `line`: the values themselves.
    - `table`: linear between pairs of value and temperature.
    - `callendar-van-dusen` (IEC 60751): R0, A, B, C of R = R0 (1 + A t + B t^2 + C (t - 100) t^3), C below 0 °C only.
    - `steinhart-hart`: A, B, C of 1 / T = A + B ln R + C (ln R)^3, T in kelvins.
    """
    value = np.asarray(value, float)
    match curve:
        case "table":
            return np.interp(value, coefficients[::2], coefficients[1::2], left=np.nan, right=np.nan)
        case "callendar-van-dusen":
            r0, a, b, c = coefficients
            t = (value / r0 - 1) / a
            for _ in range(NEWTON_STEPS):
                below = np.where(t < 0, c, 0.0)
                excess = 1 + a * t + b * t**2 + below * (t - 100) * t**3 - value / r0
                t = t - excess / (a + 2 * b * t + below * (4 * t**3 - 300 * t**2))
            return np.asarray(t)
        case "steinhart-hart":
            log = np.log(np.where(value > 0, value, np.nan))
            return np.asarray(1 / np.polyval([coefficients[2], 0.0, *coefficients[1::-1]], log) - ZERO_C_K)
    return value
