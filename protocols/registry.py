"""The protocols this program knows, by name."""

from protocols.protocol import Protocol
from protocols.sine_dwell import SineDwell
from protocols.wiring_check import WiringCheck

PROTOCOLS: dict[str, type[Protocol]] = {protocol.name: protocol for protocol in (SineDwell, WiringCheck)}
