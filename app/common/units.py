"""Parsing of numbers with units, such as `4 V` or `25 Hz, 50 Hz`, and display units.

Numbers without a unit are in the unit of their quantity.
"""

import re
from functools import cache
from math import copysign, floor, isfinite, tau
from typing import TYPE_CHECKING, Any, get_origin

from annotated_types import Interval, Unit

from model import ParameterSpec

if TYPE_CHECKING:
    from pydantic import BaseModel

PLAIN_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")

TRUE_MINUS = "−"

RANGE = re.compile(r"(.+?)\s*(?:\.\.\.?|…)\s*(.+?)\s+step\s+(.+)")
RANGE_SIGN = re.compile(r"\.\.|…|:")
RANGE_REMEDY = "write for example '100...200 step 5', or a list: '25, 50, 75'"
MAX_RANGE_VALUES = 10_000

PEAK_TO_PEAK = ParameterSpec("peak-to-peak", "V", Interval(gt=0), "drive at the amplifier's input", 5.0)

MAX_TEXT_LENGTH = 60
REPEATED_POWER = re.compile(r"(\*\*|\^)[^*^]*(\*\*|\^)|(\*\*|\^)\s*-?\d{3,}")
"""Powers of powers, which the unit library would evaluate exactly, without end."""


PREFIXES = {"": 0, "n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "c": -2, "k": 3, "M": 6, "G": 9}
BASES: dict[str, tuple[int, dict[str, int]]] = {
    "m": (0, {"m": 1}),
    "g": (-3, {"kg": 1}),
    "s": (0, {"s": 1}),
    "N": (0, {"kg": 1, "m": 1, "s": -2}),
    "Pa": (0, {"kg": 1, "m": -1, "s": -2}),
    "V": (0, {"V": 1}),
    "Hz": (0, {"Hz": 1}),
}
"""Power of ten and powers of base units; conversions between volts or hertz and other units are left to the unit library."""
PREFIXED = re.compile(r"([nuµμmckMG]??)(m|g|s|N|Pa|V|Hz)")
NUMBER_AND_UNIT = re.compile(
    rf"({PLAIN_NUMBER.pattern})\s*([A-Za-zµμ1].*)".replace("(\\d", "(?:\\d").replace("([eE]", "(?:[eE]")
)
DENOMINATOR = re.compile(r"/\(([^()/]+)\)$")


class UnitError(ValueError):
    """A text is not a number in the required unit; the message names the text and the remedy."""


def to_number(text: str, unit: str) -> float:
    """Return the number that `text` means, in `unit`.

    Raises:
        UnitError: no number, an unknown unit, or a unit of another dimension.
    """
    text = text.replace(TRUE_MINUS, "-")  # what a field shows
    for plain in (
        text,
        text.removesuffix(unit) if unit.isalpha() and len(text) <= MAX_TEXT_LENGTH else "",
    ):  # a number in the unit itself needs no library
        try:
            return float(plain)
        except ValueError:
            continue
    if len(text) > MAX_TEXT_LENGTH or REPEATED_POWER.search(text):
        raise UnitError(f"'{text[:MAX_TEXT_LENGTH]}' is not a number; write for example '1 {unit}' or '1'")
    if (usual := _usual_number(text, unit)) is not None:
        return usual
    import pint  # takes half a second, so only if another unit is written

    registry = _registry()
    try:
        quantity, target = registry.Quantity(text), registry.Unit("dimensionless" if unit == "1" else unit)
        number = float(quantity.to(target).magnitude)
        cycles = _cycle_exponent(quantity.units, target)
    except pint.DimensionalityError as error:
        raise UnitError(f"'{text}' is not a quantity in {unit}: {error}") from None
    except Exception:  # noqa: BLE001 - pint raises exceptions of any type from its tokenizer
        raise UnitError(f"'{text}' is not a number; write for example '1 {unit}' or '1'") from None
    if cycles is None:
        remedy = "write a plain number" if unit == "1" else f"write it in {unit}"
        raise UnitError(f"'{text}' is not a quantity in {unit}: an angle or a count is not a pure number; {remedy}")
    return float(number * tau**cycles)


def _usual_number(text: str, unit: str) -> float | None:
    """Return a number in powers of ten of `unit`, such as `69 GPa` in Pa; None for other units, which need the unit library."""
    parts = NUMBER_AND_UNIT.fullmatch(text.strip())
    given, wanted = _powers(parts[2]) if parts else None, _powers(unit)
    if parts is None or given is None or wanted is None or given[1] != wanted[1]:
        return None
    mantissa, _, exponent = parts[1].lower().partition("e")
    return float(f"{mantissa}e{int(exponent or 0) + given[0] - wanted[0]}")  # correctly rounded


@cache
def _powers(unit: str) -> tuple[int, dict[str, int]] | None:
    """Return the power of ten and the powers of base units of a unit such as `kg/m^2`; None if it has others."""
    if group := DENOMINATOR.search(unit):
        unit = unit[: group.start()] + "".join(f"/{each}" for each in re.split(r"[ *]+", group[1]))
    terms = re.findall(r"(^|[ *]+|/)([^ */^]+)(?:(?:\^|\*\*)(-?\d\d?))?", unit.strip())
    if "".join(f"{sign}{name}" for sign, name, _ in terms) != re.sub(r"(\^|\*\*)-?\d\d?", "", unit.strip()):
        return None
    ten, powers = 0, dict[str, int]()
    for sign, name, exponent in terms:
        prefixed = PREFIXED.fullmatch(name)
        if prefixed is None and name != "1":
            return None
        power = int(exponent or 1) * (-1 if "/" in sign else 1)
        if prefixed is not None:
            size, bases = BASES[prefixed[2]]
            ten += power * (PREFIXES[prefixed[1]] + size)
            for base, of in bases.items():
                powers[base] = powers.get(base, 0) + power * of
    return ten, {base: power for base, power in powers.items() if power}


def _cycle_exponent(given: Any, target: Any) -> int | None:
    """Return the power of 2 pi that the unit library leaves out of a conversion; None where angles do not match.

    The library takes radian, cycle and count as pure numbers, and Hz as 1/s. Here 1 Hz is one cycle, 2 pi radian, a
    second; 1/s without an angle is taken as Hz.
    """
    (have, have_hertz), (want, want_hertz) = _angle_units(given), _angle_units(target)
    if have == want:
        return have_hertz - want_hertz
    return 0 if not have and want == {"radian": 1} and want_hertz == 1 else None


def _angle_units(unit: Any) -> tuple[dict[str, int], int]:
    """Return the powers of a unit's units without dimension, and how many of its radians are a hertz."""
    registry = _registry()
    roots = registry.get_root_units(unit)[1]
    powers = {name: int(power) for name, power in roots._units.items() if registry.Unit(name).dimensionless}  # noqa: SLF001
    hertz = sum(int(power) for name, power in unit._units.items() if name.endswith("hertz"))  # noqa: SLF001
    powers["radian"] = powers.get("radian", 0) + hertz
    return {name: power for name, power in powers.items() if power}, hertz


def read_number(text: str, quantity: ParameterSpec) -> float:
    """Return the number that `text` means, in SI and admitted by `quantity`.

    Raises:
        UnitError, ParameterError: it is not a number, or out of range.
    """
    try:
        number = to_number(text, quantity.unit or "1")
    except UnitError as error:
        raise UnitError(f"{quantity.name}: {error}") from None
    return float(quantity.check(number))


def read_stated(text: str, quantity: ParameterSpec) -> tuple[float, float]:
    """Return value and standard uncertainty, SI, of `22.1 mm +- 0.05 mm` or `22.1 mm +- 1 %`.

    Raises:
        UnitError, ParameterError: it is not a value with its uncertainty, or out of range.
    """
    value, plus_minus, error = (part.strip() for part in text.replace("±", "+-").partition("+-"))
    if not (plus_minus and value and error):
        raise UnitError("write NAME=VALUE+-ERROR, for example 'h_Al=0.20 mm +- 0.01 mm'")
    unit = quantity.unit or "1"
    number = float(quantity.check(to_number(value, unit)))
    size = abs(number) * to_number(error[:-1], "1") / 100 if error.endswith("%") else to_number(error, unit)
    if not 0 < size < float("inf"):
        raise UnitError("the uncertainty must be positive; no instrument is exact")
    return number, size


def unit_of(model: "type[BaseModel]", name: str) -> str | None:
    """Return the unit of a field, None if it has none (a text, a switch)."""
    return next((m.unit for m in model.model_fields[name].metadata if isinstance(m, Unit)), None)


def description_of(model: "type[BaseModel]", name: str) -> str:
    """Return the description of a field."""
    return next((m for m in model.model_fields[name].metadata if isinstance(m, str)), "")


def read_value(model: "type[BaseModel]", name: str, value: Any, shown: tuple[float, str] = (1.0, "")) -> Any:
    """Return a field's value with texts replaced by numbers if it has a unit.

    Lists are separated by commas or spaces, and may have ranges: `25, 50, 100...200 step 5`.

    Args:
        model: has the field.
        name: of the field.
        value: a text, a number, or several.
        shown: factor from SI to the unit of numbers without one, and that unit; the field's own by default.

    Raises:
        UnitError: a text does not fit.
    """
    field = model.model_fields.get(name)
    unit = unit_of(model, name) if field else None
    if field is None or unit is None:
        return value
    if get_origin(field.annotation) is tuple:
        items = (value,) if isinstance(value, str) else value
        return tuple(
            number
            for item in items
            for number in (read_numbers(item, unit, shown) if isinstance(item, str) else (item,))
        )
    if isinstance(value, str):
        (number,) = _to_si((to_number(value, shown[1] or unit),), shown)
        return int(number) if field.annotation is int and number.is_integer() else number
    return value


def field_label(model: "type[BaseModel]", name: str) -> str:
    """Return the name of a field in words, without its unit: `peak to peak` for `peak_to_peak_v`."""
    unit = unit_of(model, name) or ""
    suffix = "c" if unit == "degC" else unit.lower().replace("/", "_per_")
    return name.removesuffix(f"_{suffix}").replace("_", " ")


def read_numbers(text: str, unit: str, shown: tuple[float, str] = (1.0, "")) -> tuple[float, ...]:
    """Return the numbers of a list in SI: `25, 50, 100...200 step 5`; for `shown` see `read_value`.

    Raises:
        UnitError: an entry is neither a number nor a range.
    """
    return tuple(number for item in _split(text) for number in _to_si(read_range(item, shown[1] or unit), shown))


def _to_si(values: tuple[float, ...], shown: tuple[float, str]) -> tuple[float, ...]:
    """Return values in SI, rounded to the digits that are shown, so that 7.73 g is 7.73e-3 kg exactly."""
    return values if shown[0] == 1.0 else tuple(float(f"{value / shown[0]:.12g}") for value in values)


def read_range(text: str, unit: str) -> tuple[float, ...]:
    """Return the values of `100...200 step 5`, both ends included where a step ends there; one value for a number.

    Raises:
        UnitError: the text is neither a number nor a range, or has too many values.
    """
    parts = RANGE.fullmatch(text.strip())
    if parts is None:
        if RANGE_SIGN.search(text):
            raise UnitError(f"'{text[:MAX_TEXT_LENGTH]}' is no range; {RANGE_REMEDY}")
        return (to_number(text, unit),)
    start, stop, step = (to_number(part.strip(), unit) for part in parts.groups())
    if not step > 0 or not isfinite(start) or not isfinite(stop):
        raise UnitError(f"'{text}' is no range: its step must be greater than 0; {RANGE_REMEDY}")
    length = abs(stop - start) / step * (1 + 1e-12) + 1e-9
    if not isfinite(length):
        raise UnitError(f"'{text}' is no range: it has too many values; {RANGE_REMEDY}")
    steps = floor(length)
    if steps >= MAX_RANGE_VALUES:
        raise UnitError(f"'{text}' has {steps + 1} values; a range may have {MAX_RANGE_VALUES}; choose a larger step")
    step = copysign(step, stop - start)
    return tuple(round(start + k * step, 12) for k in range(steps + 1))


def _split(text: str) -> list[str]:
    """Split at commas, or plain numbers at spaces: `100 Hz` is one number."""
    if "," in text:
        return [item.strip() for item in text.split(",") if item.strip()]
    parts = text.replace(TRUE_MINUS, "-").split()
    return parts if all(PLAIN_NUMBER.fullmatch(word) for word in parts) else [text.strip()]


@cache
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry()
    for names in ("@alias turn = rev = revs", "@alias revolutions_per_minute = RPM"):
        registry.define(names)
    return registry
