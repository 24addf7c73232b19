"""Form fields of annotated parameters without Qt: labels, units, limits, and validation of the entries."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Generic, Literal, TypeVar, get_args, get_origin

from annotated_types import Interval
from pydantic import BaseModel, ValidationError

from app.common import UnitError, description_of, field_label, read_value, unit_of
from model import SCALES
from protocols.base import Protocol


@dataclass(frozen=True, slots=True)
class FormField:
    """One parameter as the form shows it."""

    name: str
    label: str
    unit: str
    """Empty for a count or a text."""
    description: str
    limits: str
    is_list: bool = False
    """Several numbers, separated by commas."""
    is_switch: bool = False
    choices: tuple[str, ...] = ()
    factor: float = 1.0
    """From SI to `unit`."""


M = TypeVar("M", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class FormResult(Generic[M]):
    """Result of checking a form: the model, or a message per faulty field ("" for the whole form)."""

    value: M | None
    errors: Mapping[str, str]


def protocol_fields(kind: type[BaseModel]) -> tuple[FormField, ...]:
    """Return the fields of a protocol in the order of its class, the common ones of all protocols last."""
    common = [name for name in Protocol.model_fields if name not in kind.__annotations__ and issubclass(kind, Protocol)]
    written = [*kind.__annotations__, *common]
    names = sorted(kind.model_fields, key=lambda name: written.index(name) if name in written else -1)
    return tuple(make_field(kind, name) for name in names)


def bench_fields(kind: type[BaseModel]) -> tuple[FormField, ...]:
    """Return the fields of a form in the units in which people at a bench think of them."""
    return tuple(_in_bench_unit(kind, field) for field in protocol_fields(kind))


def form_fields(kind: type[BaseModel]) -> tuple[FormField, ...]:
    """Return the fields of a form in bench units; descriptions refer to other fields by their labels."""

    def label(name: re.Match[str]) -> str:
        return f"'{field_label(kind, name[0])}'" if name[0] in kind.model_fields else name[0]

    return tuple(
        replace(field, description=re.sub(r"\w+_\w+", label, field.description)) for field in bench_fields(kind)
    )


FORM_UNITS = {
    "kg": ("g", "mg"), "m": ("mm", "µm"), "m/V": ("µm/V",), "m/N": ("µm/N",), "kg/m": ("g/m",), "Pa": ("GPa", "MPa"), "F": ("nF",),
}  # fmt: skip
"""Units in which a form shows values of an SI unit, the larger unit first."""

LEAST_SHOWN = 0.01
"""A unit is used whose smallest default is at least this; it does not change with the entry."""

UNLIMITED = 1e9
"""A count's limit from here on is not worth telling."""


def _in_bench_unit(kind: type[BaseModel], field: FormField) -> FormField:
    """Return a field in bench units."""
    if field.unit not in FORM_UNITS:
        return field
    default = kind.model_fields[field.name].get_default()
    sizes = [abs(value) for value in (default if isinstance(default, tuple) else (default,)) if value]
    units = FORM_UNITS[field.unit]
    unit = next((unit for unit in units if min(sizes, default=1.0) * SCALES[unit] >= LEAST_SHOWN), units[-1])
    factor = SCALES[unit]
    return replace(field, unit=unit, factor=factor, limits=_format_limits(_interval_of(kind, field.name), unit, factor))


def format_parameter(value: Any) -> str:
    """Format a parameter's value as it is typed."""
    if isinstance(value, tuple):
        return ", ".join(format_parameter(item) for item in value)
    return f"{value:.12g}" if isinstance(value, float | int) and not isinstance(value, bool) else str(value)


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or each of several, times a factor; anything else unchanged."""
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    if factor == 1.0 or isinstance(value, bool) or not isinstance(value, float | int):
        return value
    return factor * value


def check_form(
    kind: type[M],
    texts: Mapping[str, Any],
    shown: Mapping[str, FormField] | None = None,
    given: Mapping[str, Any] | None = None,
) -> FormResult[M]:
    """Read and validate the texts of a form, with or without units.

    Args:
        kind: the model.
        texts: of its fields, by name.
        shown: fields in other units than SI, by name.
        given: values in place of unreadable texts; with them a text may be empty. Otherwise these fields have their defaults,
            so that the others are still checked.
    """
    units = {name: (field.factor, field.unit) for name, field in (shown or {}).items() if field.factor != 1.0}
    faults: dict[str, str] = {}
    values: dict[str, Any] = dict(given or {})
    for name, text in texts.items():
        try:
            may_be_empty = name in kind.model_fields and kind.model_fields[name].annotation is str
            if given is None and isinstance(text, str) and not text.strip() and not may_be_empty:
                raise UnitError("give a value")
            values[name] = read_value(kind, name, text, units.get(name, (1.0, "")))
        except UnitError as error:
            faults[name] = str(error)
    try:
        value = kind(**values)
    except ValidationError as error:
        for fault in error.errors():
            faults.setdefault(*field_error(kind, fault, shown))
        return FormResult(None, faults)
    return FormResult(None if faults else value, faults)


def make_field(kind: type[BaseModel], name: str) -> FormField:
    """Return a parameter as a form shows it."""
    given = unit_of(kind, name) or ""
    unit = "" if given == "1" else given
    annotation: Any = kind.model_fields[name].annotation
    many = get_origin(annotation) is tuple
    return FormField(
        name=name,
        label=field_label(kind, name),
        unit=unit,
        description=description_of(kind, name),
        limits=_format_limits(_interval_of(kind, name), unit),
        is_list=many,
        is_switch=annotation is bool,
        choices=_choices(annotation),
    )


def _choices(annotation: Any) -> tuple[str, ...]:
    if isinstance(annotation, type) and issubclass(annotation, StrEnum):
        return tuple(annotation)
    return tuple(str(c) for c in get_args(annotation)) if get_origin(annotation) is Literal else ()


def _interval_of(kind: type[BaseModel], name: str) -> Interval | None:
    """Return the limits of a field, or of the numbers in its list."""
    info = kind.model_fields[name]
    annotation: Any = info.annotation
    many = get_origin(annotation) is tuple
    marks = list(info.metadata) + (list(getattr(get_args(annotation)[0], "__metadata__", ())) if many else [])
    return next((mark for mark in marks if isinstance(mark, Interval)), None)


def _format_limits(interval: Interval | None, unit: str, factor: float = 1.0) -> str:
    if interval is None:
        return ""
    low: Any = interval.ge if interval.ge is not None else interval.gt
    high: Any = interval.le if interval.le is not None else interval.lt
    if not unit and high is not None and high >= UNLIMITED:
        high = None
    lower = "" if low is None else f"over {factor * low:g}" if interval.ge is None else f"{factor * low:g}"
    upper = "" if high is None else f"below {factor * high:g}" if interval.le is None else f"{factor * high:g}"
    if lower and not upper and interval.ge is not None:
        lower = f"from {lower}"
    if upper and not lower and interval.le is not None:
        upper = f"up to {upper}"
    bounds = list(filter(None, (lower, upper)))
    between = " … " if len(bounds) > 1 and not any(bound[0].isalpha() for bound in bounds) else " to "
    return f"{between.join(bounds)} {unit}".strip()


def field_error(kind: type[BaseModel], error: Any, shown: Mapping[str, FormField] | None = None) -> tuple[str, str]:
    """Return the field of a validation error, and the message."""
    place, message = error["loc"], error["msg"].removeprefix("Value error, ")
    if not place:  # contradicting fields: the message begins with the field to change
        first = re.match(r"\w*", message)
        return first[0] if first is not None and first[0] in kind.model_fields else "", message
    name = str(place[0])
    field = (shown or {}).get(name) or make_field(kind, name)
    value = error["input"]
    if error["type"].startswith(("greater_than", "less_than")):
        return (
            name,
            f"{format_parameter(scaled(value, field.factor))} {field.unit}".strip()
            + f" is outside the range: {field.limits}",
        )
    if error["type"] in ("int_from_float", "int_type"):
        return name, f"{format_parameter(value)} is not a whole number"
    if error["type"] in ("finite_number", "float_type"):
        return name, f"{value} is not a number"
    return name, message[:1].lower() + message[1:]
