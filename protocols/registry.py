"""Protocol registry: built-in protocols, protocols of installed packages, and protocols of a laboratory's file.

An installed package provides protocols by entry points of the group `tactor_bench.protocols`; a lab's own file is given by its
path, or named in the environment variable `TACTOR_BENCH_PROTOCOLS` (docs/how-to-write-a-protocol.md). A broken protocol is
reported and left out. Both kinds are loaded at the first look-up of a name that no other protocol has.
"""

import importlib.util
import os
import re
import sys
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import fields, is_dataclass
from importlib.abc import InspectLoader
from inspect import getdoc
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, get_origin, get_type_hints

from protocols.base import Aspects

if TYPE_CHECKING:  # its library takes as long to import as all that a list of runs needs
    from protocols.base import Protocol

ENTRY_POINT_GROUP = "tactor_bench.protocols"
FILES_VARIABLE = "TACTOR_BENCH_PROTOCOLS"
"""Environment variable with the paths of protocol files, separated as in PATH."""

BUILT_IN_PROTOCOLS = {
    "static-loading": ("Static loading", "protocols.measurements.static_loading:StaticLoading"),
    "mass-resonance": ("Mass resonance", "protocols.measurements.mass_resonance:MassResonance"),
    "voltage-steps": ("Voltage steps", "protocols.measurements.voltage_steps:VoltageSteps"),
    "hysteresis": ("Hysteresis", "protocols.measurements.hysteresis:Hysteresis"),
    "square-dwell": ("Square dwell", "protocols.measurements.square_dwell:SquareDwell"),
    "sine-dwell": ("Sine dwell", "protocols.measurements.sine_dwell:SineDwell"),
    "membrane-series": ("Membrane series", "protocols.measurements.membrane_series:MembraneSeries"),
    "membrane-sag": ("Membrane sag", "protocols.measurements.membrane_sag:MembraneSag"),
    "sweep": ("Sweep", "protocols.measurements.sweep:Sweep"),
    "free-decay": ("Free decay", "protocols.measurements.free_decay:FreeDecay"),
    "latency": ("Latency", "protocols.measurements.latency:OnsetLatency"),
    "electrical": ("Electrical", "protocols.measurements.electrical:Electrical"),
    "endurance": ("Endurance", "protocols.measurements.endurance:Endurance"),
    "wiring-check": ("Wiring check", "protocols.measurements.wiring_check:WiringCheck"),
}
"""Title and location of the built-in protocols by name. Each is imported on first use, for a fast start."""

DEFAULT_PROTOCOL = "sine-dwell"
"""Protocol of a new form, of a command without a name, and of a run of a protocol that is not installed."""
ENDURANCE = "endurance"
"""Protocol whose runs count the cycles of a specimen."""
WIRING_CHECK, HELD_LEVELS, TONES = "wiring-check", "voltage-steps", "sine-dwell"
"""Protocols that the Bench page and the command `bench check` start: the check of a bench, levels and sines played by hand."""


class ProtocolRegistry(MutableMapping[str, "type[Protocol]"]):
    """Protocols by name."""

    def __init__(self, locations: Mapping[str, tuple[str, str]]) -> None:
        self._classes: dict[str, type[Protocol] | str] = {name: place for name, (_, place) in locations.items()}
        self._titles = {name: title for name, (title, _) in locations.items()}
        self.has_searched = False
        """Whether installed packages and the files in the environment have been loaded."""

    def title(self, name: str) -> str:
        """Return the title of a protocol without importing it."""
        kind = self._classes[name]
        return self._titles[name] if isinstance(kind, str) else kind.title

    def summary(self, name: str) -> str:
        """Return the first line of the description of a protocol; a built-in one is read from its source without importing it."""
        place = self._classes[name]
        if isinstance(place, str):
            module, _, attribute = place.partition(":")
            loader = getattr(importlib.util.find_spec(module), "loader", None)
            source = loader.get_source(module) or "" if isinstance(loader, InspectLoader) else ""
            if found := re.search(rf'^class {attribute}\b.*:\n +"""(.+?)(?:"""|$)', source, re.MULTILINE):
                return found[1]
        return (getdoc(self[name]) or self[name].title).splitlines()[0]

    def load_others(self) -> None:
        """Load the protocols of installed packages and of the files in the environment, once; broken ones are left out."""
        if not self.has_searched:
            load_plug_ins()

    def __getitem__(self, name: str) -> "type[Protocol]":
        if name not in self._classes:
            self.load_others()
        kind = self._classes[name]
        if isinstance(kind, str):
            module, _, attribute = kind.partition(":")
            kind = self._classes[name] = getattr(importlib.import_module(module), attribute)
        return kind

    def __setitem__(self, name: str, protocol_class: "type[Protocol]") -> None:
        self._classes[name] = protocol_class

    def __delitem__(self, name: str) -> None:
        del self._classes[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._classes)

    def __len__(self) -> int:
        return len(self._classes)


PROTOCOLS = ProtocolRegistry(BUILT_IN_PROTOCOLS)


def aspects_of(name: str) -> Aspects:
    """Return the aspects of a protocol by name, of installed packages too; the defaults if it is not registered.

    A method of a laboratory's aspects that fails raises AspectsError, which readers of runs and imports report.
    """
    kind = PROTOCOLS.get(name)
    if kind is None:
        return Aspects()
    if name in BUILT_IN_PROTOCOLS:
        return kind.aspects
    from protocols.aspects import guarded_aspects  # reads run files, which a start does not need

    return guarded_aspects(kind.aspects, name)


class ProtocolFileError(Exception):
    """A file defines no protocol; the message names the file and the reason."""


def load_plug_ins() -> list[str]:
    """Register the protocols of installed packages and of the files in the environment; return a message for each broken one."""
    from importlib.metadata import entry_points

    PROTOCOLS.has_searched = True
    troubles = []
    for point in entry_points(group=ENTRY_POINT_GROUP):
        try:
            _register(point.load(), f"plug-in {point.name!r}")
        except Exception as error:  # noqa: BLE001 - a plug-in may raise anything; it is reported and left out
            troubles.append(f"the protocol plug-in {point.name!r} is left out: {type(error).__name__}: {error}")
    for path in filter(None, os.environ.get(FILES_VARIABLE, "").split(os.pathsep)):
        try:
            load_protocol_file(Path(path))
        except ProtocolFileError as error:
            troubles.append(f"a protocol of {FILES_VARIABLE} is left out: {error}")
    return troubles


def load_protocol_file(path: Path) -> "type[Protocol]":
    """Register the one protocol that a Python file defines.

    Raises:
        ProtocolFileError: the file is missing, does not run, or does not define exactly one protocol.
    """
    from protocols.base import Protocol

    if not path.is_file():
        raise ProtocolFileError(f"there is no file {path}")
    name = f"tactor_bench_protocol_{path.stem}"
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # pydantic looks annotations up in sys.modules
    try:
        # Always compiled from the text: Python's cache mistakes a file of equal size and second for the same file.
        exec(compile(path.read_bytes(), path, "exec"), vars(module))  # noqa: S102 - the operator's own file
    except (Exception, SystemExit) as error:
        raise ProtocolFileError(f"{path} does not run: {type(error).__name__}: {error}") from error
    kinds = [
        kind
        for kind in vars(module).values()
        if isinstance(kind, type) and issubclass(kind, Protocol) and kind.__module__ == name
    ]
    if len(kinds) != 1:
        names = ", ".join(kind.__name__ for kind in kinds) or "none"
        raise ProtocolFileError(f"{path} must define one subclass of Protocol; it defines {names}")
    _register(kinds[0], str(path))
    return kinds[0]


def _register(protocol_class: "type[Protocol]", source: str) -> None:
    missing = [name for name in ("name", "title", "point_type", "axes") if not hasattr(protocol_class, name)]
    missing += sorted(protocol_class.__abstractmethods__)
    if missing:
        raise ProtocolFileError(f"{source}: {protocol_class.__name__} lacks {', '.join(missing)}")
    if fault := _fault(protocol_class):
        raise ProtocolFileError(f"{source}: {fault}")
    registered = PROTOCOLS.get(protocol_class.name)
    if registered is not None and registered.__module__ != protocol_class.__module__:
        raise ProtocolFileError(f"{source}: there is a protocol '{protocol_class.name}' already; choose another name")
    PROTOCOLS[protocol_class.name] = protocol_class


def _fault(protocol_class: "type[Protocol]") -> str:
    """Return why no run file can store runs of a protocol; empty if one can."""
    name, points = protocol_class.name, protocol_class.point_type
    if not re.fullmatch(r"[\w-]+", name, re.ASCII):
        return f"the name {name!r} is a part of file names; use only letters, digits, '-' and '_'"
    if not is_dataclass(points):
        return f"point_type {points.__name__} is not a dataclass; write @dataclass(frozen=True, slots=True) above it"
    kinds = get_type_hints(points, include_extras=True)
    columns = [field.name for field in fields(points)]
    for column in columns:
        if get_origin(kinds[column]) is not Annotated:
            return (
                f'{column} of {points.__name__} has no unit; write {column}: Annotated[float, Unit("m"), "description"]'
            )
    if "quality" not in columns:
        return f'{points.__name__} lacks quality: Annotated[int, Unit("1"), "flags, see protocols.Quality"]'
    if "entry" in columns:
        return f"entry of {points.__name__} is the name of a column that every run has; choose another name"
    if unknown := [axis for axis in protocol_class.axes if axis not in columns]:
        return f"{points.__name__} has no {unknown[0]}, which axes names; it has {', '.join(columns)}"
    return ""
