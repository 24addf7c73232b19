"""A protocol's form without the form: what its annotated fields are called, what they admit, and what is wrong. No Qt."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args, get_origin

from annotated_types import Interval
from pydantic import ValidationError

from app.units import UnitError, read_value, unit_of, words_of
from protocols.protocol import Protocol


@dataclass(frozen=True, slots=True)
class Field:
    """One parameter as a person sees it."""

    name: str
    label: str
    unit: str
    """Empty for a count or a text."""
    words: str
    limits: str
    many: bool = False
    """Several numbers, separated by commas."""
    switch: bool = False
    choices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Checked:
    """What came of the texts of a form: the protocol, or a sentence per faulty field ("" for the form as a whole)."""

    protocol: Protocol | None
    faults: Mapping[str, str]


def fields_of(kind: type[Protocol]) -> tuple[Field, ...]:
    """The fields of a protocol in the order in which it writes them."""
    written = list(kind.__annotations__)
    names = sorted(kind.model_fields, key=lambda name: written.index(name) if name in written else -1)
    return tuple(_field(kind, name) for name in names)


def form_fields(kind: type[Protocol]) -> tuple[Field, ...]:
    """The fields of a form, whose words call the other fields by their labels."""

    def label(name: re.Match[str]) -> str:
        return f"'{_label(kind, name[0])}'" if name[0] in kind.model_fields else name[0]

    return tuple(replace(field, words=re.sub(r"\w+_\w+", label, field.words)) for field in fields_of(kind))


def text_of(value: Any) -> str:
    """A parameter's value as one types it."""
    if isinstance(value, tuple):
        return ", ".join(text_of(item) for item in value)
    return f"{value:.12g}" if isinstance(value, float | int) and not isinstance(value, bool) else str(value)


def check(kind: type[Protocol], texts: Mapping[str, Any]) -> Checked:
    """Read what was typed, in units or without."""
    faults: dict[str, str] = {}
    values: dict[str, Any] = {}
    for name, text in texts.items():
        try:
            if isinstance(text, str) and not text.strip():
                raise UnitError("give a value")
            values[name] = read_value(kind, name, text)
        except UnitError as error:
            faults[name] = str(error)
    try:
        protocol = kind(**values)  # unreadable fields stand at their defaults, so that the others are still judged
    except ValidationError as error:
        for fault in error.errors():
            name, words = _sentence(kind, fault)
            faults.setdefault(name, words)
        return Checked(None, faults)
    return Checked(None if faults else protocol, faults)


def _field(kind: type[Protocol], name: str) -> Field:
    info = kind.model_fields[name]
    unit = unit_of(kind, name) or ""
    annotation: Any = info.annotation
    many = get_origin(annotation) is tuple
    marks = list(info.metadata) + (list(getattr(get_args(annotation)[0], "__metadata__", ())) if many else [])
    interval = next((mark for mark in marks if isinstance(mark, Interval)), None)
    label = _label(kind, name)
    return Field(
        name=name,
        label=label,
        unit="" if unit == "1" else unit,
        words=words_of(kind, name),
        limits=_limits(interval, "" if unit == "1" else unit),
        many=many,
        switch=annotation is bool,
        choices=tuple(str(c) for c in get_args(annotation)) if get_origin(annotation) is Literal else (),
    )


def _label(kind: type[Protocol], name: str) -> str:
    unit = unit_of(kind, name) or ""
    return name.removesuffix(f"_{unit.lower()}").replace("_", " ")


def _limits(interval: Interval | None, unit: str) -> str:
    if interval is None:
        return ""
    low: Any = interval.ge if interval.ge is not None else interval.gt
    high: Any = interval.le if interval.le is not None else interval.lt
    over = "over " if interval.ge is None else ""
    under = "below " if interval.le is None else ""
    if low is None and high is None:
        return ""
    if high is None:
        words = f"{over or 'from '}{low:g}"
    elif low is None:
        words = f"{under or 'up to '}{high:g}"
    else:
        words = f"{over}{low:g} to {under}{high:g}"
    return f"{words} {unit}".strip()


def _sentence(kind: type[Protocol], fault: Any) -> tuple[str, str]:
    """The field a fault belongs to, and what to do about it."""
    place, words = fault["loc"], fault["msg"].removeprefix("Value error, ")
    if not place:  # fields that do not fit together: the sentence begins with the one to change
        name = next((name for name in kind.model_fields if words.startswith(name)), "")
        return name, words
    name = str(place[0])
    field = _field(kind, name)
    value = fault["input"]
    if fault["type"].startswith(("greater_than", "less_than")):
        return name, f"{text_of(value)} {field.unit}".strip() + f" is outside the range: {field.limits}"
    if fault["type"] in ("int_from_float", "int_type"):
        return name, f"{text_of(value)} is not a whole number"
    if fault["type"] in ("finite_number", "float_type"):
        return name, f"{value} is no number"
    return name, words[:1].lower() + words[1:]
