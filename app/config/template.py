"""Template of a first bench file, filled in with the discovered devices."""

import json
from collections.abc import Sequence

from app.config.discovery import FoundDevice
from app.config.driver_registry import serves_one_client

TEMPLATE = """\
# Bench file, written by 'tactor-bench bench new'. A value may carry a unit, in quotes: gain_m_per_v = "0.1 mm/V".
# Go through it line by line, then 'tactor-bench check --bench <this file>' with the specimen disconnected.
# Read docs/safety.md first: 0 V at the amplifier's input is -500 V on the specimen.

name = "my bench"

{source}

[amplifier]
name = "AMT2012-CE3"
serial = ""             # copied into every run
rest_v = 2.5            # 0 V on the specimen
low_v = 0.0             # -500 V on the specimen
high_v = 5.0            # +1500 V on the specimen
slope_below = 200.0     # volts on the specimen per volt at the input, under rest
slope_above = 600.0     # over rest
# slope_relative_uncertainty = 0.005   # standard uncertainty of both; without it the slopes count as exact
slew_v_per_s = 10000.0  # steepest drive admitted at the input
step_v = 0.05           # largest jump of a staircase at the input
ramp_v_per_s = 5.0      # slope between held levels at the input

[card]
{card}
drive_channel = "ai0"           # the amplifier's input, by a T piece
displacement_channel = "ai1"    # the laser sensor's output
range_v = 10.0

[sensor]                # from its data sheet and its calibration certificate
name = "laser displacement sensor"
serial = ""
gain_m_per_v = "0.1 mm/V"       # negative where closer gives more volts
gain_relative_uncertainty = "1 %"
zero_v = 0.0
valid_low_v = -10.0     # outside this band it reports "out of range"
valid_high_v = 10.0
delay_s = "0 s"         # from the motion to the voltage
calibrated = ""         # for example "2026-01-31"
expires = ""            # after this day every run is flagged

[specimen]
gap_m = "0.77 mm"       # clear distance from the specimen at rest to the nearest obstacle: the stroke level

[levels]                # beyond each: "off", "warning", "ask" (at rest, the operator decides) or "rest" (the run ends)
stroke = "ask"
rate = "ask"
rate_m_per_s = 2.0
laser_lost = "ask"
drive = "rest"          # the drive read back is not the commanded one

[watchdog]              # brings the source to rest if the program is killed or hangs while the bench is live
enabled = true
own_connection = {own}   # {own_why}

[backup]
folder = ""             # second folder into which each finished run file is copied; "" for none
{ports}"""

GENERATOR = """\
[generator]{comment}
driver = "auto"         # by the identity that the instrument answers
resource = {resource}
serial = {serial}  # another instrument at this address is rejected; "" accepts any
timeout_s = 2.0"""

SUPPLY = """\
[source]
kind = "dc-supply"      # no generator was found: static tests only, it plays no sine

[supply]                # {identity}
resource = {resource}
serial = {serial}
channel = 1
current_limit_a = "100 mA"
fall_time_s = "2 s"     # 1 kohm across its output shortens it"""

CARD = """\
device = {device}         # {identity}
serial = {serial}
server = {server}  # host:port of NI's gRPC device server; "" where the card is in this computer"""


def bench_template(devices: Sequence[FoundDevice], server: str = "") -> str:
    """Return the text of a bench file for the discovered devices."""
    generator = next((f for f in devices if f.role == "generator"), None)
    supply = next((f for f in devices if f.role == "supply"), None)
    card = next((f for f in devices if f.role == "card"), None)
    source = generator or supply
    lan = source is None or (source.where.startswith("TCPIP") and not serves_one_client(source.driver))
    ports = "".join(f"# serial port found: {f.where} {f.identity}\n" for f in devices if f.role == "serial port")
    hint = (
        '# [meters.display]      # a laser sensor read over its serial port\n# driver = "keyence-lkg"\n# port = "..."\n'
    )
    return TEMPLATE.format(
        source=_source_section(generator, supply),
        card=CARD.format(
            device=_toml_string(card.where if card else "Dev1"),
            identity=card.identity if card else "no card was found: its name in NI MAX",
            serial=_toml_string(card.serial if card else ""),
            server=_toml_string(server),
        ),
        own="true" if lan else "false",
        own_why="LAN takes a second connection"
        if lan
        else "this instrument takes one connection only: a program that hangs is ended",
        ports=f"\n{ports}{hint}" if ports else "",
    )


def _source_section(generator: FoundDevice | None, supply: FoundDevice | None) -> str:
    if generator is None and supply is not None:
        return SUPPLY.format(
            identity=supply.identity, resource=_toml_string(supply.where), serial=_toml_string(supply.serial)
        )
    return GENERATOR.format(
        comment=f"             # {generator.identity}"
        if generator
        else "             # none was found: write its address",
        resource=_toml_string(generator.where if generator else "TCPIP::192.0.2.7::5025::SOCKET"),
        serial=_toml_string(generator.serial if generator else ""),
    )


def _toml_string(value: str) -> str:
    return json.dumps(value)  # a TOML basic string is written as JSON writes one
