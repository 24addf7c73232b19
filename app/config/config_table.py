"""Base class of a bench file's tables: frozen, with units parsed and unknown keys rejected."""

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator

from app.common import read_value


class ConfigTable(BaseModel):
    """Base class of all tables."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _parse_unit(cls, value: Any, info: ValidationInfo) -> Any:
        return read_value(cls, info.field_name or "", value)
