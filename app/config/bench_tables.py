"""Bench file tables: kind, wiring and calibration of each instrument, further inputs of the card, specimen and abort levels."""

import re
from dataclasses import asdict, fields
from datetime import date
from functools import partial
from typing import Annotated, Any, Literal, get_type_hints

import numpy as np
from annotated_types import Interval, Unit
from pydantic import AfterValidator, create_model, field_validator, model_validator

from app.config import driver_registry as drivers
from app.config.validation import ConfigTable
from drivers import DriveLimits, InputChannel, LaserSensor, LevelSettings, read_coefficients
from drivers.sensors import BLOCK_DIALECTS, PRESETS
from model import AmplifierMap

SerialNumber = Annotated[str, "serial number; where it is given, another instrument at this address is rejected"]
ReplyTimeout = Annotated[float, Unit("s"), Interval(gt=0, le=60), "how long an answer may take"]
BaudRate = Annotated[int, Unit("1/s"), Interval(ge=300, le=4_000_000), "bits per second of a serial line (ASRL...)"]
VisaLibrary = Annotated[
    Literal["@py", "@ivi"], "VISA library: @py is built in; @ivi is a vendor's, for GPIB, and for USB on Windows"
]


class GeneratorTable(ConfigTable):
    """The function generator."""

    driver: Annotated[
        str,
        AfterValidator(partial(drivers.check_driver_name, drivers.SOURCES)),
        "which driver: auto asks the instrument who it is",
    ] = drivers.AUTO
    resource: Annotated[str, "VISA resource string, e.g. TCPIP::192.0.2.7::5025::SOCKET"] = ""
    timeout_s: ReplyTimeout = 2.0
    baud: BaudRate = 9600
    backend: VisaLibrary = "@py"
    serial: SerialNumber = ""
    panel_lock: Annotated[bool, "lock the front panel while the bench is open, where the generator can"] = False


class AmplifierTable(ConfigTable):
    """The high-voltage amplifier."""

    name: str = "AMT2012-CE3"
    serial: Annotated[str, "serial number, copied into every run"] = ""
    rest_v: Annotated[float, Unit("V"), "input that gives 0 V on the specimen"] = 2.5
    low_v: Annotated[float, Unit("V"), "lowest input"] = 0.0
    high_v: Annotated[float, Unit("V"), "highest input"] = 5.0
    slope_below: Annotated[float, Unit("V/V"), Interval(gt=0), "volts per volt under rest"] = 200.0
    slope_above: Annotated[float, Unit("V/V"), Interval(gt=0), "volts per volt over rest"] = 600.0
    slope_relative_uncertainty: Annotated[
        float, Unit("1"), Interval(ge=0, le=1), "standard uncertainty common to both slopes, relative; 0: not stated"
    ] = 0.0
    slew_v_per_s: Annotated[float, Unit("V/s"), Interval(gt=0), "steepest drive admitted at the input"] = 10_000.0
    step_v: Annotated[float, Unit("V"), Interval(gt=0, le=0.5), "largest jump of a staircase at the input"] = 0.05
    ramp_v_per_s: Annotated[float, Unit("V/s"), Interval(gt=0), "slope between held levels at the input"] = 5.0
    way_to_rest_s: Annotated[
        float, Unit("s"), Interval(gt=0, le=60), "longest way to rest, predicted at arming from the source's reply time"
    ] = 4.0

    current_limit_a: Annotated[
        float, Unit("A"), Interval(ge=0), "largest current into the specimen; 0: not given, and not checked"
    ] = 0.0
    specimen_capacitance_f: Annotated[
        float, Unit("F"), Interval(ge=0), "of specimen and cable; 0: not given. A M2814-P1 has about 1.2 nF"
    ] = 0.0

    @property
    def amplifier_map(self) -> AmplifierMap:
        return AmplifierMap(self.rest_v, self.low_v, self.high_v, self.slope_below, self.slope_above)

    @property
    def drive_limits(self) -> DriveLimits:
        return DriveLimits(**{each.name: getattr(self, each.name) for each in fields(DriveLimits)})

    @model_validator(mode="after")
    def _check_map(self) -> "AmplifierTable":
        self.amplifier_map  # noqa: B018 - raises ValueError if rest is outside the range
        return self


class CardTable(ConfigTable):
    """The data acquisition card."""

    driver: Annotated[
        str,
        AfterValidator(partial(drivers.check_driver_name, drivers.DIGITIZERS)),
        "ni: an NI card; labjack-t7: a LabJack T7 in the network",
    ] = "ni"
    device: Annotated[str, "the card's name, e.g. Dev1; of a LabJack its IP address"] = "Dev1"
    serial: SerialNumber = ""
    drive_channel: Annotated[str, "terminal that sees the amplifier's input"] = "ai0"
    displacement_channel: Annotated[str, "terminal that sees the displacement sensor"] = "ai1"
    server: Annotated[str, "host:port of NI's gRPC device server; empty for a local card"] = ""
    range_v: Annotated[float, Unit("V"), Interval(gt=0, le=10), "input range, plus and minus"] = 10.0
    terminal: Literal["DEFAULT", "DIFF", "RSE", "NRSE", "PSEUDO_DIFF"] = "DEFAULT"


class SensorTable(ConfigTable):
    """The calibration of the displacement sensor, or of a vibrometer."""

    preset: Annotated[str, "a sensor by name; values written in this table take precedence"] = ""
    name: str = "laser displacement sensor"
    quantity: Annotated[
        Literal["displacement", "velocity"],
        "velocity: a vibrometer, whose gain is in (m/s)/V; vibrations are integrated, static protocols are refused",
    ] = "displacement"
    gain_m_per_v: Annotated[float, Unit("m/V"), "displacement per volt; negative where closer gives more volts"] = 1e-4
    zero_v: Annotated[float, Unit("V"), "volts at zero displacement"] = 0.0
    valid_low_v: Annotated[float, Unit("V"), "below this the sensor reports 'out of range'"] = -10.0
    valid_high_v: Annotated[float, Unit("V"), "above this the sensor reports 'out of range'"] = 10.0
    delay_s: Annotated[float, Unit("s"), Interval(ge=0, le=0.1), "from the motion to the voltage"] = 0.0
    delay_uncertainty_s: Annotated[
        float, Unit("s"), Interval(ge=0, le=0.1), "standard uncertainty of the delay; 0: not stated"
    ] = 0.0
    gain_relative_uncertainty: Annotated[
        float, Unit("1"), Interval(ge=0, le=1), "standard uncertainty of the gain, relative"
    ] = 0.0
    corner_hz: Annotated[
        float, Unit("Hz"), Interval(ge=0, le=100), "velocity: corner of the vibrometer's high pass; 0: down to 0 Hz"
    ] = 0.0
    use_curve: Annotated[
        bool, "convert by calibration_points, linear between them, in place of gain and zero: capacitive probes"
    ] = False
    calibration_points: Annotated[
        tuple[tuple[float, float], ...], "points of the calibration: position in m and volts, written by the Bench page"
    ] = ()
    certificate: Annotated[str, "number of the certificate that these values are from"] = ""
    serial: str = ""
    calibrated: Annotated[str, "date of calibration, YYYY-MM-DD"] = ""
    expires: Annotated[str, "last day of the calibration's validity, YYYY-MM-DD; later runs are flagged"] = ""

    @field_validator("calibrated", "expires", mode="before")
    @classmethod
    def _check_date(cls, day: Any) -> Any:
        if isinstance(day, date):  # TOML has a type for dates
            return day.isoformat()
        if isinstance(day, str) and day:
            try:
                date.fromisoformat(day)
            except ValueError:
                raise ValueError(f"must be a day, for example 2026-11-21, not {day!r}") from None
        return day

    @property
    def laser_sensor(self) -> LaserSensor:
        curve = sorted(self.calibration_points, key=lambda point: point[1]) if self.use_curve else ()
        return LaserSensor(
            **self.model_dump(exclude={"preset", "calibration_points", "use_curve", "certificate"}), curve=tuple(curve)
        )

    @model_validator(mode="before")
    @classmethod
    def _apply_preset(cls, data: Any) -> Any:
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
    def _check_valid_band(self) -> "SensorTable":
        if self.gain_m_per_v == 0:
            raise ValueError("gain_m_per_v must not be 0")
        if self.valid_low_v >= self.valid_high_v:
            raise ValueError(f"valid_low_v {self.valid_low_v:g} V must lie below valid_high_v {self.valid_high_v:g} V")
        if self.use_curve:
            steps = np.diff([m for m, _ in sorted(self.calibration_points, key=lambda point: point[1])])
            if self.quantity == "velocity" or steps.size < 2 or not (np.all(steps > 0) or np.all(steps < 0)):
                raise ValueError(
                    "use_curve needs three or more calibration_points of a displacement that rises or falls with the volts throughout"
                )
        return self


class BackupTable(ConfigTable):
    """Copies of finished run files."""

    folder: Annotated[str, "second folder, best on another disk or a share; empty: no copies"] = ""


class WatchdogTable(ConfigTable):
    """The watchdog process, which brings the source to rest if the program is killed or hangs while the bench is live."""

    enabled: bool = True
    silence_s: Annotated[
        float, Unit("s"), Interval(ge=0.2, le=10), "the program counts as dead after this time without a heartbeat"
    ] = 0.4
    own_connection: Annotated[
        bool,
        "whether the source takes a second connection (LAN: yes, with most instruments; USB and serial: no, a program that hangs is ended)",
    ] = True
    patience_s: Annotated[
        float, Unit("s"), Interval(ge=1, le=600), "how long it retries where the source does not answer"
    ] = 30.0


class InterlockTable(ConfigTable):
    """The interlock: a heartbeat, without which a monostable at the card takes the high voltage away (docs/how-to/build-an-interlock.md)."""

    line: Annotated[
        str, "digital line of the card with the heartbeat, e.g. port0/line0; empty: there is no interlock"
    ] = ""
    state_line: Annotated[
        str, "digital line at the second contact of the interlock's relay, e.g. port0/line1; empty: not wired"
    ] = ""
    monostable_s: Annotated[
        float,
        Unit("s"),
        Interval(ge=0.2, le=5),
        "time of the monostable: high voltage goes off this long after the last heartbeat",
    ] = 0.5

    @field_validator("line", "state_line")
    @classmethod
    def _check_line(cls, line: str) -> str:
        if line and not re.fullmatch(r"port\d+/line\d+", line.lower()):
            raise ValueError(f"must be one digital line of the card, for example port0/line0, not {line!r}")
        return line.lower()

    @model_validator(mode="after")
    def _check_lines(self) -> "InterlockTable":
        if self.state_line and self.line in ("", self.state_line):
            raise ValueError("state_line needs line, the line of the heartbeat, which must be another one")
        return self


LABJACK_OUTPUTS = ("DAC0", "DAC1")


class SourceTable(ConfigTable):
    """The instrument at the amplifier's input."""

    kind: Annotated[
        Literal["generator", "card-output", "dc-supply", "labjack-output"],
        "generator: see [generator]; card-output: an analogue output of the card in [card]; dc-supply: see [supply]; labjack-output: an "
        "output of a LabJack T7 of its own",
    ] = "generator"
    channel: Annotated[str, "which output: ao0, ao1 of the card; DAC0, DAC1 of a LabJack; empty: the first"] = ""
    device: Annotated[str, "labjack-output: IP address of the LabJack, another one than that of [card]"] = ""
    serial: SerialNumber = ""
    external_power: Annotated[
        bool,
        "labjack-output: whether the LabJack has a power supply of its own that outlasts the computer's; else it needs the interlock",
    ] = False
    start_trigger: Annotated[
        Literal["", "ai/SampleClock"],
        "card-output: start trigger of a drive; with ai/SampleClock its first sample coincides with a scan of the input",
    ] = ""
    record_messages: Annotated[
        str, "file for every message of a session with times, for the instrument's vendor; empty: none is recorded"
    ] = ""

    @property
    def output(self) -> str:
        """The chosen output of a card or a LabJack."""
        return self.channel or ("DAC0" if self.kind == "labjack-output" else "ao0")

    @model_validator(mode="after")
    def _check_output(self) -> "SourceTable":
        if self.kind == "labjack-output" and self.output not in LABJACK_OUTPUTS:
            raise ValueError(f"channel of a LabJack must be DAC0 or DAC1, not {self.channel!r}")
        return self


class SupplyTable(ConfigTable):
    """The programmable DC supply: it can hold and step, and it falls slowly."""

    resource: Annotated[str, "VISA resource string, e.g. TCPIP::192.0.2.8::5025::SOCKET"] = ""
    timeout_s: ReplyTimeout = 2.0
    baud: BaudRate = 9600
    backend: VisaLibrary = "@py"
    serial: SerialNumber = ""
    channel: Annotated[int, Interval(ge=1, le=4), "number of its output"] = 1
    current_limit_a: Annotated[float, Unit("A"), Interval(gt=0, le=1), "largest current of the amplifier's input"] = 0.1
    fall_time_s: Annotated[
        float, Unit("s"), Interval(gt=0, le=60), "how long its output may take to fall; 1 kohm across it shortens that"
    ] = 2.0


class MeterTable(ConfigTable):
    """A displacement sensor read over its serial port or Ethernet, one value at a time, for static tests."""

    driver: Literal["keyence-lkg", "keyence-lkg5000", "keyence-il", "optoncdt", "optoncdt-2300", "capancdt-6200"]
    port: Annotated[
        str, "COM3, /dev/ttyUSB0, or on Ethernet socket://192.0.2.5:1024, its data port; empty on a simulated bench"
    ] = ""
    command_port: Annotated[
        str, "optoncdt-2300, capancdt-6200: its other port, for commands, e.g. socket://192.0.2.5:23"
    ] = ""
    baud: Annotated[int, Interval(ge=0, le=4_000_000), "bits per second; 0 is the sensor's factory setting"] = 0
    timeout_s: ReplyTimeout = 1.0
    output: Annotated[
        int,
        Interval(ge=1, le=12),
        "which output of the controller (keyence-il: amplifier; capancdt-6200: channel), from 1",
    ] = 1
    range_m: Annotated[
        float, Unit("m"), Interval(gt=0, le=1), "optoncdt, capancdt: its measuring range, checked against the sensor's"
    ] = 0.01

    @property
    def on_two_ports(self) -> bool:
        """Whether its values and its commands have different ports."""
        return self.driver in BLOCK_DIALECTS


class EnvironmentTable(ConfigTable):
    """The sensor of temperature and humidity of the air, or a climate chamber, on a serial port; read through each run."""

    port: Annotated[str, "COM3, /dev/ttyUSB0, or a pyserial URL; simulated: that of a simulated bench; empty: none"] = (
        ""
    )
    driver: Annotated[str, AfterValidator(partial(drivers.check_driver_name, drivers.ENVIRONMENT_SENSORS))] = "text"
    request: Annotated[str, "line that asks for a reading, e.g. SEND; empty for a sensor that sends by itself"] = ""
    baud: Annotated[int, Unit("1/s"), Interval(ge=300, le=4_000_000), "bits per second"] = 9600
    timeout_s: ReplyTimeout = 2.0
    uncertainty_k: Annotated[
        float, Unit("K"), Interval(ge=0, le=10), "standard uncertainty of its temperature, with its resolution"
    ] = 0.1


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
        Literal["voltage-monitor", "current-monitor", "charge", "temperature", "humidity", "other"],
        "monitors of the amplifier have the abort levels voltage and current; in V and A at the specimen; charge, in C: a sense "
        "capacitor in the return; temperature in degC and humidity in 1, of the air, are in the conditions of the run",
    ] = "other"
    gain_relative_uncertainty: Annotated[
        float, Unit("1"), Interval(ge=0, le=1), "standard uncertainty of the gain, relative; 0: not stated"
    ] = 0.0
    delay_s: Annotated[float, Unit("s"), Interval(ge=0, le=0.1), "from the specimen to the volts at the terminal"] = 0.0
    delay_uncertainty_s: Annotated[
        float, Unit("s"), Interval(ge=0, le=0.1), "standard uncertainty of the delay; 0: not stated"
    ] = 0.0
    bleed_s: Annotated[
        float, Unit("s"), Interval(ge=0, le=1e6), "charge: sense capacitance times bleed resistance; 0: no resistor"
    ] = 0.0

    curve: Annotated[
        Literal["line", "table", "callendar-van-dusen", "steinhart-hart"],
        "temperature: characteristic of a thermometer from the value (in ohm or V, by gain and offset) to degC; line: none",
    ] = "line"
    coefficients: Annotated[
        str, "of the curve, separated by commas: R0, A, B, C; A, B, C; pairs of value and degC; empty for a line"
    ] = ""

    @model_validator(mode="after")
    def _check_curve(self) -> "ChannelTable":
        read_coefficients(self.curve, self.coefficients)
        if self.curve != "line" and self.kind != "temperature":
            raise ValueError(
                f"curve is of thermometers, and the kind is {self.kind}: leave it out, or make it 'temperature'"
            )
        return self

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
        return InputChannel(terminal=self.channel, **self.model_dump(exclude={"channel"}))


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
        units = {"voltage-monitor": "V", "current-monitor": "A", "charge": "C", "temperature": "degC", "humidity": "1"}
        unit = units.get(table.kind, table.unit) if table.curve == "line" else table.unit
        if table.unit != unit:
            raise ValueError(f"channels.unit of {table.name!r} must be {unit}, as the kind {table.kind} requires")


def _fields_of_levels(*names: str) -> Any:
    """Return a base class with some fields of `LevelSettings`."""
    hints, default = get_type_hints(LevelSettings, include_extras=True), LevelSettings()
    columns: dict[str, Any] = {name: (hints[name], getattr(default, name)) for name in names}
    return create_model("_Levels", __base__=ConfigTable, **columns)


class SpecimenTable(_fields_of_levels("gap_m")):  # type: ignore[misc]
    """The specimen as it is mounted."""


class LevelsTable(_fields_of_levels(*(each.name for each in fields(LevelSettings)[1:]))):  # type: ignore[misc]
    """Abort levels, evaluated in every block. Actions: off, warning (points are flagged), ask (at rest), rest (the run ends)."""
