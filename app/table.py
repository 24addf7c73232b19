"""A table of a bench file: frozen, units understood, unknown keys refused."""

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator

from app.units import read_value


class Table(BaseModel):
    """What every table has in common."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _unit(cls, value: Any, info: ValidationInfo) -> Any:
        return read_value(cls, info.field_name or "", value)
