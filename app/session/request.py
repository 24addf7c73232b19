"""Bench, speed and protocol of a run as a user names them, checked."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from app.common import UnitError, UsageError, read_value, unit_of
from app.config import MAX_SPEED, BenchConfig, ConfigError, load_bench, validation_messages
from model import current_parameter
from protocols import PROTOCOLS, ProtocolFileError, load_plug_ins, load_protocol_file
from protocols.base import Protocol


def choose_bench(
    name: str, speed: str | float | None = None, seed: int | None = None, option: str = ""
) -> tuple[BenchConfig, float | None]:
    """Load a bench file, or a simulated bench by its name (`sim`, `ideal`), and choose its speed; None is the virtual clock (`max`).

    `option` is the prefix of option names in messages of this front end.

    Raises:
        UsageError: the bench file is wrong, or speed or seed do not fit it.
    """
    try:
        config = load_bench(name)
    except ConfigError as error:
        raise UsageError(str(error)) from None
    if not config.simulated:
        if speed is not None or seed is not None:
            raise UsageError(f"{option}speed and {option}seed are for a simulated bench; {name} is a real one")
        return config, 1.0
    if seed is not None:
        simulation = {name: value for name, value in (config.simulation or {}).items() if name != "noise_seed"}
        config = config.model_copy(update={"simulation": {**simulation, "seed": seed}})
    if speed == "max":
        return config, None
    if speed is None:
        return config, config.simulation_parameters.speed
    try:
        number = float(speed)
    except ValueError:
        number = 0.0
    if not 1 <= number <= MAX_SPEED:
        raise UsageError(f"{option}speed {speed}: give a number from 1 to {MAX_SPEED:g}, or 'max'")
    return config, number


def load_protocol_class(name: str, warn: Callable[[str], object] = lambda _: None) -> type[Protocol]:
    """Return the protocol of a name, of an installed package, or of a lab's own file (`./my_protocol.py`).

    `warn` is called with a sentence for each broken plug-in.

    Raises:
        UsageError: there is none, or the file is broken.
    """
    if name.endswith(".py") or "/" in name or "\\" in name:
        try:
            return load_protocol_file(Path(name))
        except ProtocolFileError as error:
            raise UsageError(str(error)) from None
    if name not in PROTOCOLS:
        for trouble in load_plug_ins():
            warn(trouble)
    if name not in PROTOCOLS:
        raise UsageError(
            f"there is no protocol '{name}'; the protocols are: {', '.join(PROTOCOLS)}; or give a file: ./my_protocol.py"
        )
    return PROTOCOLS[name]


def unknown_parameter(kind: type[Protocol], name: str) -> str:
    """Return that a protocol has no parameter of a name, which one may be meant, and all that it has."""
    from difflib import get_close_matches  # for an error only

    near = get_close_matches(name.lower().replace(" ", "_"), kind.model_fields, 1)
    meant = f"; {near[0]} may be meant" if near else ""
    return f"{kind.name} has no parameter '{name}'{meant}; it has: {', '.join(kind.model_fields)}"


def build_protocol(kind: type[Protocol], values: Mapping[str, Any]) -> Protocol:
    """Return the protocol with these parameters: numbers in SI, or texts with units.

    Raises:
        UsageError: an unknown parameter, or a value out of range; every fault is listed.
    """
    read: dict[str, Any] = {}
    wrong: list[str] = []
    for given, value in values.items():
        key = given if given in kind.model_fields else current_parameter(given, kind.model_fields)
        if key not in kind.model_fields:
            raise UsageError(unknown_parameter(kind, key))
        if key in read:
            raise UsageError(f"{kind.name}: {key} is given twice, once by its former name; give it once")
        try:
            read[key] = read_value(kind, key, value)
        except UnitError as error:
            wrong.append(f"  {key}: {error}")
    try:
        protocol = kind(**read)
    except ValidationError as error:
        wrong += validation_messages(error, unit_of_key=lambda key: (unit_of(kind, key) or "").removeprefix("1"))
    if wrong:
        raise UsageError(f"{kind.name} cannot be run so:\n" + "\n".join(wrong))
    return protocol
