"""Bench file tables [[channels]]: further inputs of the card, such as the amplifier's monitors."""

import re
from typing import Annotated, Any, Literal

from annotated_types import Interval
from pydantic import field_validator

from app.config.config_table import ConfigTable
from drivers import InputChannel

RESERVED_NAMES = ("drive", "displacement", "sample_rate", "time")
"""Names in the trace of a run file."""


class ChannelTable(ConfigTable):
    """A further input of the card. Its value is gain times the volts at the terminal, plus offset."""

    name: Annotated[str, "letters, digits and _; its data is trace/<name> in the run file"]
    channel: Annotated[str, "terminal of the card, e.g. ai2"]
    unit: Annotated[str, "of its values, e.g. V or A"] = "V"
    gain: Annotated[float, Interval(ge=-1e12, le=1e12), "units per volt at the terminal"] = 1.0
    offset: Annotated[float, Interval(ge=-1e12, le=1e12), "value at 0 V, in the unit"] = 0.0
    kind: Annotated[
        Literal["voltage-monitor", "current-monitor", "other"],
        "monitors of the amplifier have the abort levels voltage and current; in V and A at the specimen",
    ] = "other"

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if not re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name):
            raise ValueError(f"must be up to 40 small letters, digits and _, beginning with a letter, not {name!r}")
        if name in RESERVED_NAMES or name.startswith(("drive_", "displacement_")):
            raise ValueError(f"{name!r} is a name of the run file; choose another one, e.g. amplifier_voltage")
        return name

    @field_validator("gain")
    @classmethod
    def _check_gain(cls, gain: float) -> float:
        if gain == 0:
            raise ValueError("must not be 0")
        return gain

    @field_validator("unit")
    @classmethod
    def _check_unit(cls, unit: Any) -> Any:
        if not unit.isprintable() or not 0 < len(unit) <= 20:
            raise ValueError(f"must be a unit of at most 20 characters, not {unit!r}")
        return unit

    @property
    def input_channel(self) -> InputChannel:
        return InputChannel(self.name, self.channel, self.unit, self.gain, self.offset, self.kind)


def check_channels(tables: "list[ChannelTable]", used_terminals: tuple[str, ...]) -> None:
    """Check that names and terminals of the channels differ.

    Raises:
        ValueError: two have the same name, data of one would overwrite another's, or a terminal is used twice.
    """
    names = [table.name for table in tables]
    for at, table in enumerate(tables):
        if table.name in names[:at]:
            raise ValueError(f"two channels are named {table.name!r}; each needs a name of its own")
        if clash := next((other for other in names if table.name.startswith(f"{other}_")), None):
            raise ValueError(
                f"channels.name {table.name!r} begins with the name of another channel, {clash!r}; rename one"
            )
        if table.channel in (*used_terminals, *(other.channel for other in tables[:at])):
            raise ValueError(f"the terminal {table.channel} is used twice; each channel needs its own")
        if table.unit != {"voltage-monitor": "V", "current-monitor": "A"}.get(table.kind, table.unit):
            raise ValueError(f"channels.unit of {table.name!r} must be V or A, as the kind {table.kind} requires")
