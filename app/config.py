"""The bench file: what instruments stand on a bench, how they are wired, and what their calibrations are.

Validated whole: unknown keys are refused, and every fault is listed at once with its line and a remedy.
"""

import re
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Interval, Unit
from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator

from app.units import read_value
from drivers.amplifier import DriveLimits
from drivers.sensor import LaserSensor
from model.amplifier import AmplifierMap
from sim_hardware.truth import BenchTruth


class ConfigError(Exception):
    """A bench file is wrong. The text lists every fault with line and remedy."""


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _unit(cls, value: Any, info: ValidationInfo) -> Any:
        return read_value(cls, info.field_name or "", value)


class GeneratorTable(_Table):
    """The function generator."""

    driver: Literal["keysight-33500"] = "keysight-33500"
    resource: Annotated[str, "VISA resource string, e.g. TCPIP::192.0.2.7::5025::SOCKET"] = ""
    timeout_s: Annotated[float, Unit("s"), Interval(gt=0, le=60), "how long an answer may take"] = 2.0


class AmplifierTable(_Table):
    """The high-voltage amplifier."""

    name: str = "AMT2012-CE3"
    rest_v: Annotated[float, Unit("V"), "input that gives 0 V on the specimen"] = 2.5
    low_v: Annotated[float, Unit("V"), "lowest input"] = 0.0
    high_v: Annotated[float, Unit("V"), "highest input"] = 5.0
    slope_below: Annotated[float, Unit("1"), Interval(gt=0), "volts per volt under rest"] = 200.0
    slope_above: Annotated[float, Unit("1"), Interval(gt=0), "volts per volt over rest"] = 600.0
    slew_v_per_s: Annotated[float, Unit("V/s"), Interval(gt=0), "steepest drive admitted at the input"] = 10_000.0
    step_v: Annotated[float, Unit("V"), Interval(gt=0, le=0.5), "largest jump of a staircase at the input"] = 0.05
    ramp_v_per_s: Annotated[float, Unit("V/s"), Interval(gt=0), "slope between held levels at the input"] = 5.0

    @property
    def map(self) -> AmplifierMap:
        return AmplifierMap(self.rest_v, self.low_v, self.high_v, self.slope_below, self.slope_above)

    @property
    def limits(self) -> DriveLimits:
        return DriveLimits(self.slew_v_per_s, self.step_v, self.ramp_v_per_s)

    @model_validator(mode="after")
    def _map_holds(self) -> "AmplifierTable":
        self.map  # noqa: B018 - raises a sentence where rest lies outside the range
        return self


class CardTable(_Table):
    """The data acquisition card."""

    driver: Literal["ni"] = "ni"
    device: Annotated[str, "the card's name, e.g. Dev1"] = "Dev1"
    drive_channel: Annotated[str, "terminal that sees the amplifier's input"] = "ai0"
    displacement_channel: Annotated[str, "terminal that sees the displacement sensor"] = "ai1"
    server: Annotated[str, "host:port of NI's gRPC device server; empty for a local card"] = ""
    range_v: Annotated[float, Unit("V"), Interval(gt=0, le=10), "input range, plus and minus"] = 10.0
    terminal: Literal["DEFAULT", "DIFF", "RSE", "NRSE", "PSEUDO_DIFF"] = "DEFAULT"


class SensorTable(_Table):
    """The laser displacement sensor's calibration."""

    name: str = "laser displacement sensor"
    gain_m_per_v: Annotated[float, Unit("m/V"), "displacement per volt; negative where closer gives more volts"] = 1e-4
    zero_v: Annotated[float, Unit("V"), "volts at zero displacement"] = 0.0
    valid_low_v: Annotated[float, Unit("V"), "below this the sensor tells 'out of range'"] = -10.0
    valid_high_v: Annotated[float, Unit("V"), "above this the sensor tells 'out of range'"] = 10.0
    delay_s: Annotated[float, Unit("s"), Interval(ge=0, le=0.1), "from the motion to the voltage"] = 0.0
    gain_relative_uncertainty: Annotated[
        float, Unit("1"), Interval(ge=0, le=1), "standard uncertainty of the gain, relative"
    ] = 0.0
    serial: str = ""
    calibrated: Annotated[str, "date of calibration, YYYY-MM-DD"] = ""

    @property
    def sensor(self) -> LaserSensor:
        return LaserSensor(**self.model_dump())

    @model_validator(mode="after")
    def _band_is_open(self) -> "SensorTable":
        if self.gain_m_per_v == 0:
            raise ValueError("gain_m_per_v must not be 0")
        if self.valid_low_v >= self.valid_high_v:
            raise ValueError(f"valid_low_v {self.valid_low_v:g} V must lie below valid_high_v {self.valid_high_v:g} V")
        return self


class BenchConfig(_Table):
    """One bench file."""

    name: Annotated[str, "what the lab calls this bench"] = "bench"
    generator: GeneratorTable = Field(default_factory=GeneratorTable)
    amplifier: AmplifierTable = Field(default_factory=AmplifierTable)
    card: CardTable = Field(default_factory=CardTable)
    sensor: SensorTable = Field(default_factory=SensorTable)
    simulation: Annotated[dict[str, Any] | None, "the truth of a simulated bench; a real bench has no such table"] = (
        None
    )

    @property
    def simulated(self) -> bool:
        return self.simulation is not None

    @property
    def truth(self) -> BenchTruth:
        """The simulated bench's truth."""
        return BenchTruth.from_record(dict(self.simulation or {}))

    @model_validator(mode="after")
    def _kind_is_clear(self) -> "BenchConfig":
        if self.simulated:
            self.truth  # noqa: B018 - raises a sentence where the truth is malformed
        elif not self.generator.resource:
            raise ValueError(
                "generator.resource is missing; give the VISA resource of the generator, "
                "or a [simulation] table for a simulated bench"
            )
        return self


BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def load_bench(name: str) -> BenchConfig:
    """The bench of a file, or `sim` for the simulated bench that comes with the program.

    Raises:
        ConfigError: the file is missing or wrong.
    """
    if name == "sim":
        text, where = resources.files("sim_hardware").joinpath("bench.toml").read_text(), "the simulated bench"
    else:
        where = name
        try:
            text = Path(name).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "it is no UTF-8 text"
            raise ConfigError(f"bench file {name} cannot be read: {reason}; give a bench file or 'sim'") from error
    try:
        return BenchConfig.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{where} is not valid TOML: {error}") from error
    except ValidationError as error:
        raise ConfigError(f"{where} has faults:\n" + "\n".join(faults(error, text))) from error


def faults(error: ValidationError, text: str = "") -> list[str]:
    """One line a fault: where it stands, what is there, and what would do."""
    lines = []
    for fault in error.errors():
        path = [str(part) for part in fault["loc"]]
        line = _line_of(path, text)
        at = f"line {line}: " if line else ""
        lines.append(f"  {at}{'.'.join(path) + ': ' if path else ''}{_words(fault)}")
    return lines


def _words(fault: Any) -> str:
    kind, context = fault["type"], fault.get("ctx", {})
    if kind == "extra_forbidden":
        return "unknown key; remove it or correct its spelling"
    if kind in BOUNDS:
        key, words = BOUNDS[kind]
        return f"must be {words} {context[key]:g}, not {fault['input']!r}"
    message = fault["msg"].removeprefix("Value error, ").replace("Input should be", "must be").replace("valid ", "")
    message = message[:1].lower() + message[1:]
    return str(message) if kind in ("value_error", "missing") else f"{message}, not {fault['input']!r}"


def _line_of(path: list[str], text: str) -> int:
    """The line of a key in a TOML text, 0 where it is not found."""
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
