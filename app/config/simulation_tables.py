"""Tables of [simulation] in a bench file as forms show them: true parameters of the simulated bench with units."""

import re
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import Field, fields, is_dataclass
from functools import cache
from inspect import cleandoc
from typing import Annotated, Any, ClassVar, Literal, get_args, get_type_hints

from annotated_types import Unit
from pydantic import create_model, model_validator

from app.config.validation import ConfigTable
from model import parameter_specs
from sim_hardware.plant import SimulationParameters

Keys = tuple[str, ...]
"""Where a table is: keys below [simulation]; none for its own values."""

EDITED_ELSEWHERE: Mapping[Keys, Keys] = {(): ("source",)}
"""Fields that follow from other tables."""

UNITS_OF_SUFFIXES = {
    "_m_per_v": "m/V",
    "_m_per_s": "m/s",
    "_m_per_n": "m/N",
    "_v_per_s": "V/s",
    "_v_per_v": "1",
    "_v_per_a": "V/A",
    "_per_decade": "1",
    "_share": "1",
    "_hz": "Hz",
    "_s": "s",
    "_v": "V",
    "_m": "m",
    "_f": "F",
    "_ohm": "Ω",
}
"""Units of values without a stated one, by how their names end; the longest first."""


class SimulationTable(ConfigTable):
    """Base class of the tables; a value that may be left open is a text, empty where it is."""

    open_values: ClassVar[Mapping[str, type]] = {}
    """Types of the values that may be left open, by name."""

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "SimulationTable":
        """Return the table of a part of a bench file; missing keys have their defaults."""
        return cls.model_validate({name: cls.shown(name, record[name]) for name in cls.model_fields if name in record})

    @classmethod
    def shown(cls, name: str, value: Any) -> Any:
        """Return a value of the file as the form has it."""
        if name in cls.open_values:
            return "" if value is None else {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)
        return tuple(value) if isinstance(value, list) else value

    def stored(self, name: str) -> Any:
        """Return a value as the file has it; None where it is left open."""
        value = getattr(self, name)
        if name not in self.open_values:
            return list(value) if isinstance(value, tuple) else value
        if value == "" or self.open_values[name] is bool:
            return {"": None, "yes": True, "no": False}[value]
        if not value.isdigit():
            raise ValueError(f"{name} must be a whole number, or empty where it is left open, not {value!r}")
        return int(value)


@cache
def simulation_tables() -> Mapping[Keys, type[SimulationTable]]:
    """Return the tables of [simulation] by their keys."""
    return dict(_tables(SimulationParameters, ()))


def table_at(simulation: Mapping[str, Any], keys: Keys) -> Mapping[str, Any]:
    """Return the part of [simulation] at some keys; empty where the file leaves it out."""
    part: Mapping[str, Any] = simulation
    for key in keys:
        part = part.get(key) or {}
    return part


def with_simulation_tables(simulation: Mapping[str, Any], tables: Mapping[Keys, SimulationTable]) -> dict[str, Any]:
    """Return [simulation] with the values of some tables; a default that the file leaves out stays out."""
    result = deepcopy(dict(simulation))
    for keys, table in tables.items():
        for name, info in type(table).model_fields.items():
            present, value = table_at(result, keys), table.stored(name)
            unchanged = table.shown(name, present[name]) if name in present else info.get_default()
            if getattr(table, name) == unchanged:
                continue
            part = result
            for key in keys:
                part[key] = part = part.get(key) or {}
            if value is None:
                part.pop(name, None)
            else:
                part[name] = value
    return result


def _tables(kind: Any, keys: Keys) -> list[tuple[Keys, type[SimulationTable]]]:
    hints, plain = get_type_hints(kind, include_extras=True), get_type_hints(kind)
    described, listed = _descriptions(kind), {spec.name: spec for spec in parameter_specs(kind)}
    for name, spec in listed.items():
        hints[name] = Annotated[hints[name], Unit(spec.unit), spec.description]
    own: dict[str, Any] = {}
    nested: list[tuple[Keys, type[SimulationTable]]] = []
    for each in fields(kind):
        inner = next((part for part in (plain[each.name], *get_args(plain[each.name])) if is_dataclass(part)), None)
        if inner is not None:
            nested += _tables(inner, (*keys, each.name))
        elif each.name not in EDITED_ELSEWHERE.get(keys, ()):
            own[each.name] = _field(each, hints[each.name], plain[each.name], described.get(each.name, ""))
    title = "".join(part.title() for part in ("simulation", *keys))
    validators: dict[str, Any] = {"check": model_validator(mode="after")(_make_check(kind, keys))}
    table = create_model(title, __base__=SimulationTable, __validators__=validators, **own)
    table.open_values = {
        name: bool if bool in get_args(plain[name]) else int for name in own if type(None) in get_args(plain[name])
    }
    return [(keys, table), *nested]


def _field(each: Field[Any], hint: Any, plain: Any, description: str) -> tuple[Any, Any]:
    if type(None) in get_args(plain):
        return Annotated[Literal["", "yes", "no"] if bool in get_args(plain) else str, description], ""
    default = each.default_factory() if callable(each.default_factory) else each.default
    if hint != plain:  # the model's own, with unit, limits and description
        return hint, default
    unit = next((unit for suffix, unit in UNITS_OF_SUFFIXES.items() if each.name.endswith(suffix)), "1")
    marks = (description,) if plain in (str, bool) else (Unit(unit), description)
    return Annotated[(plain, *marks)], default


def _make_check(kind: Any, keys: Keys) -> Any:
    """Return a validator that the parameters themselves accept a table."""

    def check(table: SimulationTable) -> SimulationTable:
        try:
            stored = {name: table.stored(name) for name in type(table).model_fields}
            kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in stored.items()})
        except ValueError as error:
            raise ValueError(str(error).removeprefix(f"{keys[-1] if keys else 'simulation'}.")) from None
        return table

    return check


def _descriptions(kind: Any) -> dict[str, str]:
    """Return the descriptions of attributes in the docstring of a class."""
    lines = re.split(r"\n\s{4}(?=\w[\w, ]*: )", cleandoc(kind.__doc__ or "").partition("Attributes:")[2])
    pairs = (line.strip().partition(": ") for line in lines)
    return {
        name.strip(): re.sub(r"\s+", " ", text).strip().rstrip(".")
        for names, _, text in pairs
        for name in names.split(",")
    }
