"""Discovery of connected devices: VISA instruments, NI cards, LabJacks at given addresses, serial ports. Devices are only queried, never set."""

import re
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass

from app.config.driver_registry import SOURCES, built_in_names, load_driver, supports_model
from drivers import SUPPLY_DIALECTS, BenchError, Identity, reason_unsuitable

LAN_PORTS = (5025, 5555)
"""Ports of function generators for messages."""

QUERY_TIMEOUT_S = 1.0


@dataclass(frozen=True, slots=True)
class FoundDevice:
    """A connected device: its possible role on a bench, its address and its identity."""

    role: str
    """generator, supply, card, serial port, or instrument (of a kind without a driver)."""
    where: str
    identity: str = ""
    serial: str = ""
    driver: str = ""


def find_devices(hosts: Sequence[str] = (), server: str = "") -> tuple[list[FoundDevice], list[str]]:
    """Return the connected devices, and messages on searches that failed."""
    from drivers import list_devices, list_resources, list_serial_ports

    names, notes = list_resources()
    devices = []
    for host in hosts:
        if (labjack := _query_labjack(host)) is not None:
            devices.append(labjack)
            continue
        name, _, port = host.partition(":")
        names += [f"TCPIP::{name}::{p}::SOCKET" for p in ([port] if port else LAN_PORTS)]
    for resource in names:
        if resource.startswith("ASRL"):
            continue  # a query at the wrong baud rate can disturb the device; the ports are listed below
        try:
            device, warning = _query_instrument(resource)
            devices.append(device)
            notes += [warning] if warning else []
        except BenchError as error:
            notes.append(str(error))
    try:
        devices += [FoundDevice("card", name, str(seen), seen.serial) for name, seen in list_devices(server or None)]
    except BenchError as error:
        notes.append(str(error))
    devices += [FoundDevice("serial port", name, description) for name, description in list_serial_ports()]
    return devices, notes


def _query_labjack(host: str) -> FoundDevice | None:
    """Return the LabJack at an address, or None if none answers."""
    from drivers.labjack import T7Registers

    if host.count(":") == 1:  # the port of an instrument with messages
        return None
    with suppress(BenchError), closing(T7Registers(host, QUERY_TIMEOUT_S)) as registers:
        seen = registers.identity
        return FoundDevice("card", host, str(seen), seen.serial, "labjack-t7")
    return None


def _query_instrument(resource: str) -> tuple[FoundDevice, str]:
    """Return the instrument, and a warning if it is advised against."""
    from drivers import ScpiSession, VisaLink

    with closing(VisaLink(resource, QUERY_TIMEOUT_S)) as link:
        seen = ScpiSession(link, f"instrument at {resource}").identify()
    role, name = _role_of(seen)
    why = reason_unsuitable(seen) if role == "instrument" else ""
    return FoundDevice(
        role, resource, str(seen), seen.serial, name
    ), f"{resource} answered as '{seen}'; {why}" if why else ""


def _role_of(identity: Identity) -> tuple[str, str]:
    """Return an instrument's possible role on a bench, and its driver."""
    model = identity.model.upper()
    for name in built_in_names(SOURCES):
        if supports_model(load_driver(SOURCES, name), model):
            return "generator", name
    if any(re.match(dialect.model_pattern, model, re.IGNORECASE) for dialect in SUPPLY_DIALECTS):
        return "supply", ""
    return "instrument", ""
