"""Template of a first bench file, filled in with the discovered devices."""

import json
from collections.abc import Sequence
from importlib.resources import files

from app.config.discovery import FoundDevice
from app.config.driver_registry import serves_one_client

TEMPLATE = files("app.config").joinpath("bench.toml.template").read_text("utf-8")

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
driver = {driver}
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
            driver=_toml_string((card.driver if card else "") or "ni"),
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
