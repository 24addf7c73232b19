"""The protocols this program knows, by name: its own, those of installed packages, and those of a lab's own file.

An installed package brings protocols by entry points of the group `tactor_bench.protocols`; a lab's own file is given
by its path (docs/how-to-write-a-protocol.md). What is broken is named and left out; it never stops what does without.
"""

import importlib
import sys
from collections.abc import Iterator, Mapping, MutableMapping
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

from protocols.base.protocol import Protocol

GROUP = "tactor_bench.protocols"

OWN = {
    "static-loading": ("Static loading", "protocols.measurements.static_loading:StaticLoading"),
    "mass-resonance": ("Mass resonance", "protocols.measurements.mass_resonance:MassResonance"),
    "voltage-steps": ("Voltage steps", "protocols.measurements.voltage_steps:VoltageSteps"),
    "hysteresis": ("Hysteresis", "protocols.measurements.hysteresis:Hysteresis"),
    "sine-dwell": ("Sine dwell", "protocols.measurements.sine_dwell:SineDwell"),
    "membrane-series": ("Membrane series", "protocols.measurements.membrane_series:MembraneSeries"),
    "membrane-sag": ("Membrane sag", "protocols.measurements.membrane_sag:MembraneSag"),
    "sweep": ("Sweep", "protocols.measurements.sweep:Sweep"),
    "free-decay": ("Free decay", "protocols.measurements.free_decay:FreeDecay"),
    "wiring-check": ("Wiring check", "protocols.measurements.wiring_check:WiringCheck"),
}
"""Title and place of the program's own protocols by name. Each is imported when it is asked for: a window opens with one."""


class Known(MutableMapping[str, type[Protocol]]):
    """Protocols by name."""

    def __init__(self, places: Mapping[str, tuple[str, str]]) -> None:
        self._kinds: dict[str, type[Protocol] | str] = {name: place for name, (_, place) in places.items()}
        self._titles = {name: title for name, (title, _) in places.items()}

    def title(self, name: str) -> str:
        """The title of one; nothing is imported for it."""
        kind = self._kinds[name]
        return self._titles[name] if isinstance(kind, str) else kind.title

    def __getitem__(self, name: str) -> type[Protocol]:
        kind = self._kinds[name]
        if isinstance(kind, str):
            module, _, attribute = kind.partition(":")
            kind = self._kinds[name] = getattr(importlib.import_module(module), attribute)
        return kind

    def __setitem__(self, name: str, kind: type[Protocol]) -> None:
        self._kinds[name] = kind

    def __delitem__(self, name: str) -> None:
        del self._kinds[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._kinds)

    def __len__(self) -> int:
        return len(self._kinds)


PROTOCOLS = Known(OWN)


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
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # pydantic looks annotations up there
    try:
        # From its text, always: Python's cache takes a file of the same size and second for the same file.
        exec(compile(path.read_bytes(), path, "exec"), vars(module))  # noqa: S102 - the operator's own file
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
