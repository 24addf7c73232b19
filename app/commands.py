"""What the commands do. Each takes the parsed options and returns an exit code."""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from app.config import FASTEST, BenchConfig, ConfigError, load_bench
from app.exits import DONE, UsageError
from app.units import UnitError, read_value, unit_of
from app.validation import faults
from protocols.plain import plain
from protocols.protocol import Protocol
from protocols.registry import PROTOCOLS, ProtocolFileError, load_file, load_plug_ins

if TYPE_CHECKING:
    from protocols.continuation import Earlier


def protocol_names() -> str:
    """The protocols, for a help text."""
    return ", ".join(PROTOCOLS)


def run(options: argparse.Namespace) -> int:
    """`tactor-bench run PROTOCOL`."""
    config, speed = chosen_bench(options)
    protocol = make_protocol(options.protocol, options.settings)
    return run_headless(config, speed, options, protocol, planned=options.faults)[0]


def window(options: argparse.Namespace) -> int:
    """`tactor-bench [window]`."""
    from app.screen import why_no_window

    config, speed = chosen_bench(options)
    protocol = make_protocol(options.protocol, options.settings)
    if why := why_no_window():
        raise UsageError(f"no window can be opened: {why}. The same work without one: 'tactor-bench run sine-dwell'")
    return _open_window(config, speed, options, protocol, options.autostart)


def demo(options: argparse.Namespace) -> int:
    """`tactor-bench demo`: the main job, with or without a screen."""
    from app.screen import why_no_window

    config, speed = chosen_bench(options)
    protocol = make_protocol("sine-dwell", [])
    why = "" if not options.no_window else "--no-window was given"
    why = why or why_no_window()
    if not why:
        return _open_window(config, speed, options, protocol, autostart=True)
    sys.stderr.write(f"No window: {why}. The same job follows without one.\n")
    options.json = False
    code, path = run_headless(config, speed, options, protocol)
    if path is not None and path.exists():
        _draw(path, path.with_suffix(".png"))
    return code


def show(options: argparse.Namespace) -> int:
    """`tactor-bench show RUN`."""
    from app.answer import PICTURES, check_file
    from app.showing import run_record, run_text
    from protocols.runreader import Run, RunError, intact

    if options.picture:
        check_file(options.picture, PICTURES)
    try:
        with Run(options.run) as run, intact(options.run):
            told = json.dumps(plain(run_record(run)), allow_nan=False) if options.json else run_text(run)
    except RunError as error:
        raise UsageError(str(error)) from None
    print(told)  # noqa: T201 - the command line speaks here
    if options.picture:
        return _draw(options.run, options.picture)
    return DONE


def protocol_kind(name: str) -> type[Protocol]:
    """The protocol of a name, of an installed package, or of a lab's own file (`./my_protocol.py`).

    Raises:
        UsageError: there is none, or the file is broken.
    """
    if name.endswith(".py") or "/" in name or "\\" in name:
        try:
            return load_file(Path(name))
        except ProtocolFileError as error:
            raise UsageError(str(error)) from None
    if name not in PROTOCOLS:
        for trouble in load_plug_ins():
            sys.stderr.write(f"{trouble}\n")
    if name not in PROTOCOLS:
        raise UsageError(
            f"there is no protocol '{name}'; known are: {protocol_names()}; or give a file: ./my_protocol.py"
        )
    return PROTOCOLS[name]


def make_protocol(name: str, settings: list[str]) -> Protocol:
    """The protocol `name` with `NAME=VALUE` settings.

    Raises:
        UsageError: an unknown protocol or parameter, or a value out of range; every fault is listed.
    """
    kind = protocol_kind(name)
    name = kind.name
    values: dict[str, Any] = {}
    wrong: list[str] = []
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals:
            raise UsageError(f"--set {setting}: write NAME=VALUE, for example --set peak_to_peak_v=4")
        if key.strip() not in kind.model_fields:
            raise UsageError(f"{name} has no parameter '{key}'; it has: {', '.join(kind.model_fields)}")
        try:
            values[key.strip()] = read_value(kind, key.strip(), value.strip())
        except UnitError as error:
            wrong.append(f"  {key.strip()}: {error}")
    try:
        protocol = kind(**values)
    except ValidationError as error:
        wrong += faults(error, unit=lambda key: (unit_of(kind, key) or "").removeprefix("1"))
    if wrong:
        raise UsageError(f"{name} cannot be run so:\n" + "\n".join(wrong))
    return protocol


def chosen_bench(options: argparse.Namespace) -> tuple[BenchConfig, float | None]:
    """The bench and its speed; None is the virtual clock."""
    try:
        config = load_bench(options.bench)
    except ConfigError as error:
        raise UsageError(str(error)) from None
    speed, seed = options.speed, options.seed
    if not config.simulated:
        if speed is not None or seed is not None:
            raise UsageError(f"--speed and --seed are for a simulated bench; {options.bench} is a real one")
        return config, 1.0
    if seed is not None:
        config = config.model_copy(update={"simulation": {**(config.simulation or {}), "seed": seed}})
    if speed == "max":
        return config, None
    if speed is None:
        return config, config.truth.speed
    try:
        number = float(speed)
    except ValueError:
        number = 0.0
    if not 1 <= number <= FASTEST:
        raise UsageError(f"--speed {speed}: give a number from 1 to {FASTEST:g}, or 'max'")
    return config, number


def run_headless(
    config: BenchConfig,
    speed: float | None,
    options: argparse.Namespace,
    protocol: Protocol,
    listeners: Sequence[Callable[[Any], None]] = (),
    planned: Sequence[str] = (),
    before: "Earlier | None" = None,
) -> tuple[int, Path | None]:
    """Run a protocol with the terminal as front end; the exit code and the run file.

    `listeners` are told every event besides the terminal; `planned` are faults of a simulated bench, `NAME@SECONDS`;
    `before` is the run to go on with.
    """
    from app.headless import exit_code, headless

    with headless(config, speed, options, listeners, planned) as front:
        front.session.run(protocol, options.out or Path("runs"), options.specimen or "unnamed", before)
        front.wait()
    return exit_code(front.session), front.session.path if front.session.outcome else None


def _open_window(
    config: BenchConfig, speed: float | None, options: argparse.Namespace, protocol: Protocol, autostart: bool
) -> int:
    from app.build import connect
    from app.gui.application import open_window

    def bench(name: str) -> tuple[Any, BenchConfig]:
        other = load_bench(name)
        pace = other.truth.speed if other.simulated else 1.0
        return lambda: connect(other, pace), other

    return open_window(
        lambda: connect(config, speed), config, protocol, options.out, options.specimen, autostart, benches=bench
    )


def _draw(run_file: Path, picture: Path) -> int:
    from app.answer import PICTURES, writing
    from app.picture import draw_run
    from protocols.runreader import Run, RunError

    try:
        with writing(picture, PICTURES), Run(run_file) as run:
            draw_run(run, picture)
    except RunError as error:
        raise UsageError(str(error)) from None
    return DONE
