"""The bench file: what instruments stand on a bench, how they are wired, and what their calibrations are.

Validated whole: unknown keys are refused, and every fault is listed at once with its line and a remedy.
"""

import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import asdict
from datetime import date
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from annotated_types import Interval, Unit
from pydantic import Field, ValidationError, field_validator, model_validator

from app import drivers
from app.arguments import shortened
from app.config_source import MeterTable, SourceTable, SupplyTable
from app.table import Table
from drivers.amplifier import DriveLimits
from drivers.sensor import LaserSensor
from drivers.sensor_presets import PRESETS
from model.amplifier import AmplifierMap
from sim_hardware.truth import BenchTruth

FASTEST = 20.0
"""Times real speed at which the simulated bench still keeps up on its real wires."""

LARGEST = 1_000_000
"""Characters that a bench file may have: what is longer is something else."""


class ConfigError(Exception):
    """A bench file is wrong. The text lists every fault with line and remedy."""


SERIAL = "serial number; where it is given, another instrument at this address is refused"


class GeneratorTable(Table):
    """The function generator."""

    driver: Annotated[str, "which driver: auto asks the instrument who it is"] = drivers.AUTO
    resource: Annotated[str, "VISA resource string, e.g. TCPIP::192.0.2.7::5025::SOCKET"] = ""
    timeout_s: Annotated[float, Unit("s"), Interval(gt=0, le=60), "how long an answer may take"] = 2.0
    baud: Annotated[int, Unit("1/s"), Interval(ge=300, le=4_000_000), "bits per second of a serial line (ASRL...)"] = (
        9600
    )
    serial: Annotated[str, SERIAL] = ""

    @field_validator("driver")
    @classmethod
    def _driver_is_known(cls, name: str) -> str:
        return drivers.known(drivers.SOURCES, name)


class AmplifierTable(Table):
    """The high-voltage amplifier."""

    name: str = "AMT2012-CE3"
    serial: Annotated[str, "serial number, copied into every run"] = ""
    rest_v: Annotated[float, Unit("V"), "input that gives 0 V on the specimen"] = 2.5
    low_v: Annotated[float, Unit("V"), "lowest input"] = 0.0
    high_v: Annotated[float, Unit("V"), "highest input"] = 5.0
    slope_below: Annotated[float, Unit("1"), Interval(gt=0), "volts per volt under rest"] = 200.0
    slope_above: Annotated[float, Unit("1"), Interval(gt=0), "volts per volt over rest"] = 600.0
    slew_v_per_s: Annotated[float, Unit("V/s"), Interval(gt=0), "steepest drive admitted at the input"] = 10_000.0
    step_v: Annotated[float, Unit("V"), Interval(gt=0, le=0.5), "largest jump of a staircase at the input"] = 0.05
    ramp_v_per_s: Annotated[float, Unit("V/s"), Interval(gt=0), "slope between held levels at the input"] = 5.0

    current_limit_a: Annotated[
        float, Unit("A"), Interval(ge=0), "what it can push into the specimen; 0: not told, and not checked"
    ] = 0.0
    specimen_capacitance_f: Annotated[
        float, Unit("F"), Interval(ge=0), "of specimen and cable; 0: not told. A M2814-P1 has about 1.2 nF"
    ] = 0.0

    @classmethod
    def of(cls, configuration: Mapping[str, Any]) -> Self:
        """The amplifier as it was in a run: its table is copied into every run file's configuration."""
        return cls.model_validate(configuration.get("amplifier", {}))

    @property
    def map(self) -> AmplifierMap:
        return AmplifierMap(self.rest_v, self.low_v, self.high_v, self.slope_below, self.slope_above)

    @property
    def limits(self) -> DriveLimits:
        return DriveLimits(
            self.slew_v_per_s,
            self.step_v,
            self.ramp_v_per_s,
            self.current_limit_a,
            self.specimen_capacitance_f,
        )

    @model_validator(mode="after")
    def _map_holds(self) -> "AmplifierTable":
        self.map  # noqa: B018 - raises a sentence where rest lies outside the range
        return self


class CardTable(Table):
    """The data acquisition card."""

    driver: str = "ni"
    device: Annotated[str, "the card's name, e.g. Dev1"] = "Dev1"
    serial: Annotated[str, SERIAL] = ""
    drive_channel: Annotated[str, "terminal that sees the amplifier's input"] = "ai0"
    displacement_channel: Annotated[str, "terminal that sees the displacement sensor"] = "ai1"
    server: Annotated[str, "host:port of NI's gRPC device server; empty for a local card"] = ""
    range_v: Annotated[float, Unit("V"), Interval(gt=0, le=10), "input range, plus and minus"] = 10.0
    terminal: Literal["DEFAULT", "DIFF", "RSE", "NRSE", "PSEUDO_DIFF"] = "DEFAULT"

    @field_validator("driver")
    @classmethod
    def _driver_is_known(cls, name: str) -> str:
        return drivers.known(drivers.DIGITIZERS, name)


class SensorTable(Table):
    """The laser displacement sensor's calibration."""

    preset: Annotated[str, "a sensor by name; what is written here besides wins over it"] = ""
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
    expires: Annotated[str, "last day on which the calibration holds, YYYY-MM-DD; later every run is flagged"] = ""

    @field_validator("calibrated", "expires", mode="before")
    @classmethod
    def _is_a_day(cls, day: Any) -> Any:
        if isinstance(day, date):  # TOML has dates of its own
            return day.isoformat()
        if isinstance(day, str) and day:
            try:
                date.fromisoformat(day)
            except ValueError:
                raise ValueError(f"must be a day, for example 2026-11-21, not {day!r}") from None
        return day

    @property
    def sensor(self) -> LaserSensor:
        return LaserSensor(**self.model_dump(exclude={"preset"}))

    @model_validator(mode="before")
    @classmethod
    def _preset_fills_in(cls, data: Any) -> Any:
        name = data.get("preset") if isinstance(data, dict) else None
        if not name:
            return data
        if name not in PRESETS:
            raise ValueError(
                f"there is no preset {name!r}; choose from {', '.join(PRESETS)}, or write the values yourself"
            )
        filled = asdict(PRESETS[name])
        del filled["confirmed"]
        return {**filled, **data}

    @model_validator(mode="after")
    def _band_is_open(self) -> "SensorTable":
        if self.gain_m_per_v == 0:
            raise ValueError("gain_m_per_v must not be 0")
        if self.valid_low_v >= self.valid_high_v:
            raise ValueError(f"valid_low_v {self.valid_low_v:g} V must lie below valid_high_v {self.valid_high_v:g} V")
        return self


class WatchdogTable(Table):
    """The process that brings the source to rest if the program dies or hangs while the bench is live."""

    enabled: bool = True
    silence_s: Annotated[
        float, Unit("s"), Interval(ge=0.2, le=10), "the program counts as dead when it says nothing for so long"
    ] = 0.4
    own_connection: Annotated[
        bool,
        "whether the source takes a second connection (LAN: yes; USB and serial: no, a program that hangs is ended)",
    ] = True
    patience_s: Annotated[
        float, Unit("s"), Interval(ge=1, le=600), "how long it goes on trying where the source does not answer"
    ] = 30.0


class BenchConfig(Table):
    """One bench file."""

    name: Annotated[str, "what the lab calls this bench"] = "bench"
    source: SourceTable = Field(default_factory=SourceTable)
    generator: GeneratorTable = Field(default_factory=GeneratorTable)
    supply: SupplyTable = Field(default_factory=SupplyTable)
    amplifier: AmplifierTable = Field(default_factory=AmplifierTable)
    card: CardTable = Field(default_factory=CardTable)
    sensor: SensorTable = Field(default_factory=SensorTable)
    meters: Annotated[dict[str, MeterTable], "serial sensors by a name of your own: [meters.laser]"] = Field(
        default_factory=dict
    )
    watchdog: WatchdogTable = Field(default_factory=WatchdogTable)
    simulation: Annotated[dict[str, Any] | None, "the truth of a simulated bench; a real bench has no such table"] = (
        None
    )

    @property
    def simulated(self) -> bool:
        return self.simulation is not None

    @property
    def truth(self) -> BenchTruth:
        """The simulated bench's truth."""
        at_the_cable = {"generator": "generator", "card-output": self.source.channel, "dc-supply": "supply"}
        return BenchTruth.from_record({"source": at_the_cable[self.source.kind], **(self.simulation or {})})

    @property
    def wire(self) -> GeneratorTable | SupplyTable:
        """The table that names the source's own wire."""
        return self.supply if self.source.kind == "dc-supply" else self.generator

    @model_validator(mode="after")
    def _kind_is_clear(self) -> "BenchConfig":
        if self.simulated:
            speed = self.truth.speed  # raises a sentence where the truth is malformed
            if not 1 <= speed <= FASTEST:
                raise ValueError(f"simulation.speed must be from 1 to {FASTEST:g}, not {speed:g}")
            return self
        if self.source.kind != "card-output" and not self.wire.resource:
            table = "supply" if self.source.kind == "dc-supply" else "generator"
            raise ValueError(
                f"{table}.resource is missing; give the VISA resource of the {table}, "
                "or a [simulation] table for a simulated bench"
            )
        if silent := [name for name, meter in self.meters.items() if not meter.port]:
            raise ValueError(f"meters.{silent[0]}.port is missing; give the name of its serial port, e.g. COM3")
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
            with Path(name).open(encoding="utf-8") as file:
                text = file.read(LARGEST + 1)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it is no UTF-8 text"
            where = shortened(name)
            raise ConfigError(f"bench file {where!r} cannot be read: {reason}; give a bench file or 'sim'") from error
        if len(text) > LARGEST:
            raise ConfigError(
                f"{name} is longer than {LARGEST / 1e6:g} MB and no bench file; give another one or 'sim'"
            )
    try:
        return BenchConfig.model_validate(tomllib.loads(text))
    except ValidationError as error:
        raise ConfigError(f"{where} has faults:\n" + "\n".join(faults(error, text))) from error
    except (ValueError, RecursionError) as error:  # also numbers of thousands of digits, tables nested beyond reason
        raise ConfigError(f"{where} is not valid TOML: {error}") from error


def faults(error: ValidationError, text: str = "", unit: Callable[[str], str] = lambda _: "") -> list[str]:
    """One line a fault: where it stands, what is there, and what would do; in the unit that a key has."""
    lines = []
    for fault in error.errors():
        path = [str(part) for part in fault["loc"]]
        line = _line_of(path, text)
        at = f"line {line}: " if line else ""
        lines.append(f"  {at}{'.'.join(path) + ': ' if path else ''}{_words(fault, unit)}")
    return lines


def _words(fault: Any, unit: Callable[[str], str]) -> str:
    kind, context, value = fault["type"], fault.get("ctx", {}), fault["input"]
    given = f"{value:.12g}" if isinstance(value, float) else shortened(repr(value))
    if kind == "extra_forbidden":
        return "unknown key; remove it or correct its spelling"
    if kind in BOUNDS:
        key, words = BOUNDS[kind]
        of = f" {known}" if fault["loc"] and (known := unit(str(fault["loc"][0]))) else ""
        return f"must be {words} {context[key]:g}{of}, not {given}{of}"
    message = fault["msg"].removeprefix("Value error, ").replace("Input should be", "must be").replace("valid ", "")
    message = message[:1].lower() + message[1:]
    return str(message) if kind in ("value_error", "missing") else f"{message}, not {given}"


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
