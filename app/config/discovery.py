"""Finds what is connected: VISA instruments, NI cards, serial ports. Nothing is set, nothing is switched, only asked."""

import re
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass

from app.config.driver_registry import BUILT_IN, SOURCES, driver
from drivers.errors import BenchError
from drivers.interfaces import Identity
from drivers.supplies.dialects import DIALECTS

LAN_PORTS = (5025, 5555)
"""Where function generators listen: 5025 Keysight, Siglent, Tektronix; 5555 Rigol."""

ASK_S = 1.0


@dataclass(frozen=True, slots=True)
class Found:
    """One thing that is connected: what it can be on a bench, where it is, and who it says it is."""

    role: str
    """generator, supply, card, serial port, or instrument (of a kind no driver knows)."""
    where: str
    identity: str = ""
    serial: str = ""
    driver: str = ""


def find(hosts: Sequence[str] = (), server: str = "") -> tuple[list[Found], list[str]]:
    """What is connected, and sentences on what could not be looked for."""
    from drivers.transport.visa import resources

    names, notes = resources()
    for host in hosts:
        name, _, port = host.partition(":")
        names += [f"TCPIP::{name}::{p}::SOCKET" for p in ([port] if port else LAN_PORTS)]
    found = []
    for resource in names:
        if resource.startswith("ASRL"):
            continue  # a question at the wrong speed can disturb whatever hangs there; the ports are listed below
        try:
            found.append(_instrument(resource))
        except BenchError as error:
            notes.append(str(error))
    cards, trouble = _cards(server)
    return [*found, *cards, *_ports()], notes + trouble


def _instrument(resource: str) -> Found:
    from drivers.transport.scpi import Scpi
    from drivers.transport.visa import VisaLink

    with closing(VisaLink(resource, ASK_S)) as link:
        seen = Scpi(link, f"instrument at {resource}").identify()
    role, name = _role(seen)
    return Found(role, resource, str(seen), seen.serial, name)


def _role(seen: Identity) -> tuple[str, str]:
    """What an instrument can be on a bench, and the driver that knows it."""
    model = seen.model.upper()
    for name in BUILT_IN[SOURCES]:
        if model.startswith(tuple(getattr(driver(SOURCES, name), "MODELS", ())) or ("\0",)):
            return "generator", name
    if any(re.match(dialect.models, model, re.IGNORECASE) for dialect in DIALECTS):
        return "supply", ""
    return "instrument", ""


def _cards(server: str) -> tuple[list[Found], list[str]]:
    from drivers.nidaq.analog_input import cards

    try:
        return [Found("card", name, str(seen), seen.serial) for name, seen in cards(server or None)], []
    except BenchError as error:
        return [], [str(error)]


def _ports() -> list[Found]:
    from drivers.transport.serial_port import ports

    return [Found("serial port", name, words) for name, words in ports()]
