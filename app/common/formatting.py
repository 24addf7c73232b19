"""Formatting of durations, sizes, quantities with uncertainty, curves and points for operators."""

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import is_dataclass
from typing import TYPE_CHECKING, Any

from model import ERRORS, format_quantity, quantity_label, shown_unit
from protocols.base import Quality

if TYPE_CHECKING:
    from protocols.base import Series

LARGEST = 1e7
"""Larger numbers have a power of ten."""

SUBSCRIPTS = {"s": "ₛ", "m": "ₘ"}
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def typeset_unit(unit: str) -> str:
    """`N m^2` as `N m²`, `degC` as `°C`; the unit `1` is omitted."""
    return "" if unit == "1" else _raise_exponents(unit)


def typeset(text: str) -> str:
    """Return a line as a window shows it: `N m²`, `peak-to-peak displacement`, `−5` for `N m^2`, `max - min`, `-5`; `k_s` as `kₛ`."""
    text = re.sub(r"max ?- ?min", "peak-to-peak displacement", text)
    text = re.sub(r"\b([A-Za-z])_([sm])\b", lambda m: m[1] + SUBSCRIPTS[m[2]], text)
    return _raise_exponents(re.sub(r"(?<![\w.)\]-])-(?=\d)", "−", text))


def sentence_case(text: str) -> str:
    """Return a text with a capital first letter; a symbol stays, such as `c₀`."""
    return text[:1].upper() + text[1:] if text[:2].isalpha() or text.startswith("a ") else text


def _raise_exponents(text: str) -> str:
    text = re.sub(r"\bdegC\b", "°C", text)
    return re.sub(r"\^(-?\d+)", lambda m: m[1].translate(SUPERSCRIPTS), text)


def number_text(value: float, digits: int = 5) -> str:
    """Return a number as axes, read-outs and tables show it: true minus, spaces in five and more digits before the point."""
    if not math.isfinite(value):
        return "–"
    size = abs(value)
    if size >= LARGEST or 0 < size < 1e-5:
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa.rstrip('0').rstrip('.')} × 10{str(int(power)).translate(SUPERSCRIPTS)}".replace("-", "−")
    places = max(digits - 1 - (math.floor(math.log10(size)) if size else 0), 0)
    text = f"{value:,.{places}f}" if size >= 1e4 else f"{value:.{places}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text == "-0" else text.replace(",", "\u202f").replace("-", "−")


def format_duration(seconds: float) -> str:
    """Format a duration as `12 s`, `3 min 20 s`, `2 h 05 min`."""
    whole = max(round(seconds), 0)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def pluralize(count: int, noun: str) -> str:
    """Format a count as `1 run`, `3 runs`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def format_outcome(state: str, reason: str) -> str:
    """Format state and reason of a run without repetition: `stopped by the operator`."""
    return reason if reason.casefold().startswith(state.casefold()) else f"{state}: {reason}" if reason else state


def format_bytes(count: float) -> str:
    """Format bytes as `812 kB`, `1.4 GB`."""
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} GB"


def format_series(curve: "Series") -> str:
    """Format a curve by its highest point: `response: 251 lines, 25 to 525 Hz, highest 925.30 ± 0.12 µm/V at 151 Hz`.

    Empty for a curve without errors, which is a record of samples, and for a loop or a change over counts, whose points have the result.
    """
    x, y = curve.x, curve.plotted
    if curve.errors is None or not y.size or curve.x_axis.unit in ("s", "1") or (x[1:] <= x[:-1]).any():
        return ""
    top = int(abs(y).argmax())
    height = format_quantity(float(y[top]), float(curve.errors[top]), curve.y_axis.unit)
    factor, unit = shown_unit(curve.x_axis.unit)
    low, at, high = (f"{factor * x[i]:.5g}" for i in (0, top, -1))
    return f"{curve.title}: {y.size} lines, {low} to {high} {unit}, highest {height} at {at} {unit}"


def format_point(point: Any, units: Mapping[str, str] | None = None) -> str:
    """Format a point as one line with its quality flags.

    The line is the point's own summary. Without one, if it raises, and for an imported point, which lacks columns, the line has
    the finite values with their standard errors. `units` are the SI units of a point without a type.
    """
    quality = Quality(point.quality)
    flags, text = quality & ~Quality.SIMULATED, ""
    with suppress(ArithmeticError, AttributeError, LookupError, TypeError, ValueError):  # of a laboratory's own summary
        text = point.summary
    if not text or Quality.IMPORTED in quality:
        text = ", ".join(_format_values(point, units or {}))
    return f"{text}; {'' if quality.usable else 'not usable: '}{flags.description}" if flags else text


def _format_values(point: Any, units: Mapping[str, str]) -> Iterator[str]:
    from protocols.runfile import ENTRY_COLUMN, point_columns

    if is_dataclass(point):
        columns = point_columns(type(point))
        values, units = {name: getattr(point, name) for name in columns}, {name: of[0] for name, of in columns.items()}
    else:
        values = vars(point)
    for name, value in values.items():
        if name in (ENTRY_COLUMN, "quality") or name.endswith(ERRORS) or not isinstance(value, float | int):
            continue
        if math.isfinite(value):
            error = values.get(name + ERRORS, math.nan)
            yield f"{axis_name(name)} {format_quantity(value, error, units.get(name, '1'), name)}"


def axis_name(column: str) -> str:
    """Return the name of a column on an axis, or at the head of a table."""
    return quantity_label(column).replace("_", " ")
