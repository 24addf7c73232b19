"""Registry of instrument drivers: built-in drivers and plug-ins of other packages.

A plug-in is an entry point of the group `tactor_bench.sources`, `tactor_bench.digitizers` or `tactor_bench.environment_sensors`
(docs/how-to-write-a-driver.md).
It is imported only when it is needed. A broken one is reported and skipped; it never stops a bench that does not use it.
"""

import inspect
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import drivers
from drivers import BenchError, Clock, InstrumentError, Link, ScpiSession, Source, generator_families

AUTO = "auto"
SOURCES, DIGITIZERS = "tactor_bench.sources", "tactor_bench.digitizers"
ENVIRONMENT_SENSORS = "tactor_bench.environment_sensors"

BUILT_IN = {
    DIGITIZERS: {"ni": "drivers.nidaq.analog_input:NiDigitizer", "labjack-t7": "drivers.labjack.digitizer:T7Digitizer"},
    ENVIRONMENT_SENSORS: {
        "text": "drivers.sensors.environment:TextEnvironmentSensor",
        "espec": "drivers.sensors.espec:EspecChamber",
    },
}
"""Drivers that are not of generators; digitizers are called like `drivers.nidaq.analog_input.NiDigitizer`, environment sensors with
(port, request), and generators with (link, clock, *, step_v)."""

SIMULATED_CARDS = {"labjack-t7": "T7"}
"""Product of the simulated card, by driver, where it is not the usual one."""

INTERFACES = {SOURCES: "Source", DIGITIZERS: "Digitizer", ENVIRONMENT_SENSORS: "EnvironmentSensor"}

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class PlugIn:
    """A driver of another package, and why it cannot be used (empty: it can)."""

    name: str
    driver: Any = None
    problem: str = ""


def built_in_names(group: str) -> tuple[str, ...]:
    """Return the names of the drivers of this program, without imports."""
    return tuple(generator_families() if group == SOURCES else BUILT_IN[group])


def driver_names(group: str) -> list[str]:
    """Return the valid driver names of a bench file, without imports."""
    chosen = [AUTO] if group == SOURCES else []
    return [*chosen, *built_in_names(group), *(point.name for point in _entry_points(group))]


def check_driver_name(group: str, name: str) -> str:
    """Return the name itself.

    Raises:
        ValueError: there is no such driver; the message lists the drivers.
    """
    ours = (group == SOURCES and name == AUTO) or name in built_in_names(group)
    if not ours and name not in driver_names(group):  # looking for plug-ins takes a while
        raise ValueError(
            f"there is no driver {name!r}; choose from {', '.join(driver_names(group))}, or install the package that brings it"
        )
    return name


def load_plug_ins(group: str) -> list[PlugIn]:
    """Return all plug-ins of a group, each loaded or with its problem."""
    return [_load_plug_in(point) for point in _entry_points(group)]


def load_driver(group: str, name: str) -> Callable[..., Any]:
    """Return the driver of that name.

    Raises:
        BenchError: there is no such driver, or it is a broken plug-in.
    """
    if name in built_in_names(group):
        return _load_built_in(group, name)
    for point in _entry_points(group):
        if point.name == name:
            plug_in = _load_plug_in(point)
            if plug_in.problem:
                raise BenchError(plug_in.problem)
            driver: Callable[..., Any] = plug_in.driver
            return driver
    raise BenchError(f"there is no driver '{name}'; choose from {', '.join(driver_names(group))}")


def _load_built_in(group: str, name: str) -> Callable[..., Any]:
    driver: Callable[..., Any]
    if group == SOURCES:
        driver = import_module(f"drivers.generators.{generator_families()[name].module}").DRIVERS[name]
    else:
        driver = EntryPoint(name, BUILT_IN[group][name], group).load()
    return driver


def open_generator(name: str, link: Link, clock: Clock, step_v: float) -> Source:
    """Open the driver of that name on a link; `auto` chooses it by the instrument's identity.

    Raises:
        InstrumentError: nothing answers, another instrument answers, or none of the drivers supports it.
        BenchError: the driver is a broken plug-in.
    """
    chosen = load_driver(SOURCES, name) if name != AUTO else _detect_driver(link)
    source: Source = chosen(link, clock, step_v=step_v)
    return source


def _detect_driver(link: Link) -> Callable[..., Source]:
    seen = ScpiSession(link, f"function generator at {link.name}").identify()
    for candidate in _source_drivers():
        if supports_model(candidate, seen.model):
            return candidate
    if why := drivers.reason_unsuitable(seen):
        raise InstrumentError(f"{link.name} answered as '{seen}'; {why}")
    raise InstrumentError(
        f"{link.name} answered as '{seen}', a model for which there is no driver; name one in the bench file "
        f"(generator.driver: {', '.join(driver_names(SOURCES)[1:])}), or install a package that brings one"
    )


def supports_model(driver: Any, model: str) -> bool:
    """Return whether a driver is for a model, by its own method or by its prefixes."""
    if supports := getattr(driver, "supports_model", None):
        return bool(supports(model))
    return model.upper().startswith(tuple(getattr(driver, "MODELS", ())) or ("\0",))


def serves_one_client(name: str) -> bool:
    """Return whether the instruments of a driver of sources answer one LAN client at a time; empty for no driver."""
    return bool(name) and bool(getattr(load_driver(SOURCES, name), "single_session", False))


def _source_drivers() -> Iterator[Callable[..., Source]]:
    """Yield the built-in drivers and every plug-in that works."""
    for name in built_in_names(SOURCES):
        yield load_driver(SOURCES, name)
    for plug_in in load_plug_ins(SOURCES):
        if plug_in.problem:
            log.warning("%s. It was skipped", plug_in.problem)
        else:
            yield plug_in.driver


def _entry_points(group: str) -> Sequence[EntryPoint]:
    """Return the entry points whose names are not names of built-in drivers."""
    return [p for p in sorted(entry_points(group=group)) if p.name not in built_in_names(group) and p.name != AUTO]


def _load_plug_in(entry_point: EntryPoint) -> PlugIn:
    package = f"{entry_point.dist.name} {entry_point.dist.version}" if entry_point.dist else "an unknown package"
    begin, driver, problem = f"the plug-in driver '{entry_point.name}' ({package})", None, ""
    interface: type = getattr(drivers, INTERFACES[entry_point.group])
    try:
        driver = entry_point.load()
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        reason = f"{type(error).__name__}: {error}".strip(": ")
        problem = f"{begin} cannot be loaded: {reason}. Update or remove the package {package}"
    else:
        if inspect.isclass(driver):
            if missing := _missing_methods(driver, interface):
                problem = f"{begin} is not a {interface.__name__}: it lacks {', '.join(missing)}"
        elif not callable(driver):
            problem = f"{begin} is not a driver: {entry_point.value} cannot be called"
    return PlugIn(entry_point.name, None if problem else driver, problem)


def _missing_methods(driver_class: type, interface: type) -> list[str]:
    """Return the methods of the interface that the class lacks."""
    names = [n for n, member in vars(interface).items() if inspect.isfunction(member) and not n.startswith("_")]
    return [f"{name}()" for name in names if not callable(getattr(driver_class, name, None))]
