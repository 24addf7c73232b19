"""The protocols this program knows, by name: its own, those of installed packages, and those of a lab's own file.

An installed package brings protocols by entry points of the group `tactor_bench.protocols`; a lab's own file is given
by its path (docs/how-to-write-a-protocol.md). What is broken is named and left out; it never stops what does without.
"""

import importlib.util
import sys
from importlib.metadata import entry_points
from pathlib import Path

from protocols.free_decay import FreeDecay
from protocols.hysteresis import Hysteresis
from protocols.mass_resonance import MassResonance
from protocols.membrane_sag import MembraneSag
from protocols.membrane_series import MembraneSeries
from protocols.protocol import Protocol
from protocols.sine_dwell import SineDwell
from protocols.static_loading import StaticLoading
from protocols.sweep import Sweep
from protocols.voltage_steps import VoltageSteps
from protocols.wiring_check import WiringCheck

GROUP = "tactor_bench.protocols"

PROTOCOLS: dict[str, type[Protocol]] = {
    protocol.name: protocol
    for protocol in (
        StaticLoading,
        MassResonance,
        VoltageSteps,
        Hysteresis,
        SineDwell,
        MembraneSeries,
        MembraneSag,
        Sweep,
        FreeDecay,
        WiringCheck,
    )
}


class ProtocolFileError(Exception):
    """A file gives no protocol. The sentence says which and why."""


def load_plug_ins() -> list[str]:
    """Add the protocols of installed packages; a sentence for each that is broken."""
    troubles = []
    for point in entry_points(group=GROUP):
        try:
            _add(point.load(), f"plug-in {point.name!r}")
        except Exception as error:  # noqa: BLE001 - whatever a plug-in raises, it is named and left out
            troubles.append(f"the protocol plug-in {point.name!r} is left out: {type(error).__name__}: {error}")
    return troubles


def load_file(path: Path) -> type[Protocol]:
    """Add the one protocol that a Python file defines.

    Raises:
        ProtocolFileError: the file is missing, does not run, or does not define exactly one protocol.
    """
    if not path.is_file():
        raise ProtocolFileError(f"there is no file {path}")
    name = f"tactor_bench_protocol_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ProtocolFileError(f"{path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # pydantic looks annotations up there
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ProtocolFileError(f"{path} does not run: {type(error).__name__}: {error}") from error
    kinds = [
        kind
        for kind in vars(module).values()
        if isinstance(kind, type) and issubclass(kind, Protocol) and kind.__module__ == name
    ]
    if len(kinds) != 1:
        found = ", ".join(kind.__name__ for kind in kinds) or "none"
        raise ProtocolFileError(f"{path} must define one subclass of Protocol; it defines {found}")
    _add(kinds[0], str(path))
    return kinds[0]


def _add(kind: type[Protocol], source: str) -> None:
    missing = [name for name in ("name", "title", "point_type", "axes") if not hasattr(kind, name)]
    missing += sorted(kind.__abstractmethods__)
    if missing:
        raise ProtocolFileError(f"{source}: {kind.__name__} lacks {', '.join(missing)}")
    known = PROTOCOLS.get(kind.name)
    if known is not None and known.__module__ != kind.__module__:
        raise ProtocolFileError(f"{source}: there is a protocol '{kind.name}' already; choose another name")
    PROTOCOLS[kind.name] = kind
