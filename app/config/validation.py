"""Validation of TOML files by pydantic: base class of their tables, and messages with line, value and remedy."""

import re
from collections.abc import Callable
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from app.common import read_value, truncate_text
from protocols.base import parse_toml

Model = TypeVar("Model", bound=BaseModel)

BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


class ConfigTable(BaseModel):
    """Base class of all tables: frozen, with units parsed and unknown keys rejected."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _parse_unit(cls, value: Any, info: ValidationInfo) -> Any:
        return read_value(cls, info.field_name or "", value)


def read_toml(kind: type[Model], text: str, where: str, error_of: Callable[[str], Exception]) -> Model:
    """Return the values of a TOML text; `error_of` makes the exception of a message, which begins with `where`."""
    try:
        return kind.model_validate(parse_toml(text))
    except ValidationError as error:
        raise error_of(f"{where} has faults:\n" + "\n".join(validation_messages(error, text))) from error
    except ValueError as error:  # also numbers of thousands of digits, tables nested beyond reason
        raise error_of(f"{where} is not valid TOML: {error}") from error


def validation_messages(
    error: ValidationError, text: str = "", unit_of_key: Callable[[str], str] = lambda _: ""
) -> list[str]:
    """Return one line per error: place, value, and permitted values, in the unit of the key."""
    lines = []
    for fault in error.errors():
        path = [str(part) for part in fault["loc"]]
        line = _line_of(path, text)
        at = f"line {line}: " if line else ""
        lines.append(f"  {at}{'.'.join(path) + ': ' if path else ''}{_describe_error(fault, unit_of_key)}")
    return lines


def _describe_error(error: Any, unit_of_key: Callable[[str], str]) -> str:
    kind, context, value = error["type"], error.get("ctx", {}), error["input"]
    given = f"{value:.12g}" if isinstance(value, float) else truncate_text(repr(value))
    if kind == "extra_forbidden":
        return "unknown key; remove it or correct its spelling"
    if kind in BOUNDS:
        key, text = BOUNDS[kind]
        of = f" {unit}" if error["loc"] and (unit := unit_of_key(str(error["loc"][0]))) else ""
        return f"must be {text} {context[key]:g}{of}, not {given}{of}"
    message = error["msg"].removeprefix("Value error, ").replace("Input should be", "must be").replace("valid ", "")
    message = message[:1].lower() + message[1:]
    return str(message) if kind in ("value_error", "missing") else f"{message}, not {given}"


def _line_of(path: list[str], text: str) -> int:
    """Return the line of a key in a TOML text, 0 if it is missing."""
    tables, key = path[:-1], path[-1] if path else ""
    table: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        if header := re.match(r"\s*\[([^\[\]]+)\]", line):
            table = [part.strip().strip("\"'") for part in header[1].split(".")]
            if table == path:
                return number
        elif table == tables and re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=", line):
            return number
    return 0
