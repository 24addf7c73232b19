"""Conversion of values to JSON types, for the events of a run file and for `--json`."""

import math
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np


def to_jsonable(value: Any) -> Any:
    """Return the value as dicts, lists, numbers and texts; NaN and infinity become None."""
    match value:
        case None | bool() | str() | int() if not isinstance(value, Enum):
            return value
        case float():
            return float(value) if math.isfinite(value) else None
        case dict():
            return {str(name): to_jsonable(item) for name, item in value.items()}
        case list() | tuple():
            return [to_jsonable(item) for item in value]
        case Enum():
            return to_jsonable(value.value)
        case np.generic() | np.ndarray():
            return to_jsonable(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_jsonable(getattr(value, field.name)) for field in fields(value)}
    return str(value)
