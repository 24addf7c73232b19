"""Units in what a person writes: `4 V`, `0.1 mm/V`, `25 Hz, 50 Hz`. Plain numbers are in the quantity's own unit."""

import re
from functools import cache
from math import pi
from typing import TYPE_CHECKING, Any, get_origin

from annotated_types import Interval, Unit

from model.parameter_spec import ParameterSpec

if TYPE_CHECKING:
    from pydantic import BaseModel

PLAIN_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")

PEAK_TO_PEAK = ParameterSpec("peak-to-peak", "V", Interval(gt=0), "drive at the amplifier's input", 5.0)

MAX_TEXT_LENGTH = 60
REPEATED_POWER = re.compile(r"(\*\*|\^)[^*^]*(\*\*|\^)|(\*\*|\^)\s*-?\d{3,}")
"""Powers of powers, which the unit library would compute to the last digit, for ever."""


DISPLAY_SCALES = {
    "µm": 1e6,
    "mm": 1e3,
    "ms": 1e3,
    "g": 1e3,
    "%": 1e2,
    "°": 180 / pi,
    "MPa": 1e-6,
    "µm/V": 1e6,
    "nm/V": 1e9,
    "µm/N": 1e6,
    "N mm/kV": 1e6,
    "krad/s": 1e-3,
}
"""Factor from SI to a display unit."""

DISPLAY_UNITS = {
    "m": "µm",
    "m/V": "µm/V",
    "m/N": "µm/N",
    "kg": "g",
    "s": "ms",
    "Pa": "MPa",
    "N m/V": "N mm/kV",
}
"""Display unit of an SI unit, where it is another one."""


def display_unit(unit: str) -> tuple[float, str]:
    """Return factor and unit in which a quantity is displayed; `1` has no unit."""
    shown = DISPLAY_UNITS.get(unit)
    return (1.0, "" if unit == "1" else unit) if shown is None else (DISPLAY_SCALES[shown], shown)


class UnitError(ValueError):
    """A text is no number in the unit wanted. The sentence says which and what would do."""


def to_number(text: str, unit: str) -> float:
    """The number that `text` means, in `unit`.

    Raises:
        UnitError: no number, an unknown unit, or a unit of another dimension.
    """
    for number in (
        text,
        text.removesuffix(unit) if unit.isalpha() and len(text) <= MAX_TEXT_LENGTH else "",
    ):  # in the unit itself: no library is needed
        try:
            return float(number)
        except ValueError:
            continue
    if len(text) > MAX_TEXT_LENGTH or REPEATED_POWER.search(text):
        raise UnitError(f"'{text[:MAX_TEXT_LENGTH]}' is no number; write for example '1 {unit}' or '1'")
    import pint  # takes half a second, so only where somebody writes a unit

    registry = _registry()
    try:
        return float(registry.Quantity(text).to("dimensionless" if unit == "1" else unit).magnitude)
    except pint.DimensionalityError as error:
        raise UnitError(f"'{text}' is no quantity in {unit}: {error}") from None
    except Exception:  # noqa: BLE001 - pint raises whatever its tokenizer trips over
        raise UnitError(f"'{text}' is no number; write for example '1 {unit}' or '1'") from None


def read_number(text: str, quantity: ParameterSpec) -> float:
    """Return the number that `text` means, in SI and admitted by `quantity`.

    Raises:
        UnitError, ParameterError: it is none, or not admitted.
    """
    try:
        number = to_number(text, quantity.unit or "1")
    except UnitError as error:
        raise UnitError(f"{quantity.name}: {error}") from None
    return float(quantity.check(number))


def unit_of(model: "type[BaseModel]", name: str) -> str | None:
    """The unit of a field, None where it has none (a text, a switch)."""
    return next((m.unit for m in model.model_fields[name].metadata if isinstance(m, Unit)), None)


def description_of(model: "type[BaseModel]", name: str) -> str:
    """What a field means, in words."""
    return next((m for m in model.model_fields[name].metadata if isinstance(m, str)), "")


def read_value(model: "type[BaseModel]", name: str, value: Any) -> Any:
    """A field's value with texts replaced by numbers where it has a unit; a list is separated by commas or spaces.

    Raises:
        UnitError: a text does not fit.
    """
    field = model.model_fields.get(name)
    unit = unit_of(model, name) if field else None
    if field is None or unit is None:
        return value
    if get_origin(field.annotation) is tuple:
        items = _split(value) if isinstance(value, str) else value
        return tuple(to_number(item, unit) if isinstance(item, str) else item for item in items)
    if isinstance(value, str):
        number = to_number(value, unit)
        return int(number) if field.annotation is int and number.is_integer() else number
    return value


def _split(text: str) -> list[str]:
    """Items between commas, or plain numbers between spaces: `100 Hz` is one number, not 100 and one hertz."""
    if "," in text:
        return [item.strip() for item in text.split(",") if item.strip()]
    words = text.split()
    return words if all(PLAIN_NUMBER.fullmatch(word) for word in words) else [text.strip()]


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()
