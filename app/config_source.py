"""What drives the amplifier, and what else is read: the tables [source], [supply] and [meters] of a bench file."""

from typing import Annotated, Literal

from annotated_types import Interval, Unit

from app.table import Table


class SourceTable(Table):
    """Which instrument stands at the amplifier's input."""

    kind: Annotated[
        Literal["generator", "card-output", "dc-supply"],
        "generator: see [generator]; card-output: an analogue output of the card in [card]; dc-supply: see [supply]",
    ] = "generator"
    channel: Annotated[str, "card-output: which output of the card"] = "ao0"
    start_trigger: Annotated[
        Literal["", "ai/SampleClock"],
        "card-output: what starts a drive; ai/SampleClock lets its first sample fall on a scan of the input",
    ] = ""


class SupplyTable(Table):
    """The programmable DC supply: it can hold and step, and it falls slowly."""

    resource: Annotated[str, "VISA resource string, e.g. TCPIP::192.0.2.8::5025::SOCKET"] = ""
    timeout_s: Annotated[float, Unit("s"), Interval(gt=0, le=60), "how long an answer may take"] = 2.0
    baud: Annotated[int, Unit("1/s"), Interval(ge=300, le=4_000_000), "bits per second of a serial line (ASRL...)"] = (
        9600
    )
    serial: Annotated[str, "serial number; where it is given, another instrument at this address is refused"] = ""
    channel: Annotated[int, Interval(ge=1, le=4), "number of its output"] = 1
    current_limit_a: Annotated[float, Unit("A"), Interval(gt=0, le=1), "what the amplifier's input may draw"] = 0.1
    fall_time_s: Annotated[
        float, Unit("s"), Interval(gt=0, le=60), "how long its output may take to fall; 1 kohm across it shortens that"
    ] = 2.0


class MeterTable(Table):
    """A laser sensor read over its serial port, one value at a time, for static tests."""

    driver: Literal["keyence-lkg", "optoncdt"]
    port: Annotated[str, "COM3, /dev/ttyUSB0, or a pyserial URL; empty on a simulated bench"] = ""
    baud: Annotated[int, Interval(ge=0, le=4_000_000), "bits per second; 0 is the sensor's factory setting"] = 0
    timeout_s: Annotated[float, Unit("s"), Interval(gt=0, le=60), "how long an answer may take"] = 1.0
    output: Annotated[int, Interval(ge=1, le=2), "keyence-lkg: which output of the controller"] = 1
    range_m: Annotated[float, Unit("m"), Interval(gt=0, le=1), "optoncdt: its measuring range"] = 0.01
