"""Values as JSON has them: for the rows of a run file and for every `--json`."""

import math
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np


def to_jsonable(value: Any) -> Any:
    """The value as dicts, lists, numbers and texts. A number that is none (NaN, infinite) is None: JSON has no such."""
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
