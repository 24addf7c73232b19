"""The commands `run`, `window`, `demo`, `show`, `resume` and `protocols`."""

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from inspect import getdoc
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.headless import SelectedBench, exit_code, headless_session, select_bench
from app.cli.options import (
    JSON_EVENTS,
    JSON_OBJECT,
    JSON_PLAIN,
    BenchOptions,
    ProtocolOptions,
    define_command,
    faults_option,
    option,
    switch,
)
from app.common.errors import ExitCode, UsageError
from app.common.inputs import path_argument
from app.config.bench_file import BenchConfig, load_bench
from app.session.request import build_protocol, load_protocol_class
from protocols.base import Protocol
from protocols.registry import PROTOCOLS, load_plug_ins
from protocols.runner.request import RunRequest

if TYPE_CHECKING:
    from protocols.resume import ResumableRun

PROTOCOL_HELP = "a protocol, such as sine-dwell ('tactor-bench protocols' lists them)"


@dataclass(frozen=True)
class RunOptions(ProtocolOptions):
    """Options of `run`."""

    protocol: str = option(help=f"{PROTOCOL_HELP}, or a lab's own file: ./my_protocol.py")
    json: bool = switch("--json", JSON_EVENTS)
    faults: Sequence[str] = faults_option()


def run(options: RunOptions) -> int:
    """Run a protocol with the terminal as front end."""
    bench = select_bench(options)
    protocol = make_protocol(options.protocol, options.settings)
    return run_headless(bench, options, protocol, options.json, planned_faults=options.faults)[0]


@dataclass(frozen=True)
class WindowOptions(ProtocolOptions):
    """Options of `window`."""

    protocol: str = option(nargs="?", default="sine-dwell", help=PROTOCOL_HELP)
    autostart: bool = switch("--start", "start the run as soon as the bench is there")


def window(options: WindowOptions) -> int:
    """Open the window."""
    from app.gui.screen import window_unavailable_reason

    bench = select_bench(options)
    protocol = make_protocol(options.protocol, options.settings)
    if why := window_unavailable_reason():
        raise UsageError(f"no window can be opened: {why}. The same work without one: 'tactor-bench run sine-dwell'")
    return _open_window(bench, options, protocol, options.autostart)


@dataclass(frozen=True)
class DemoOptions(BenchOptions):
    """Options of `demo`."""

    no_window: bool = switch("--no-window", "do without the window even where there is a screen")


def demo(options: DemoOptions) -> int:
    """Run a sine dwell in the window, or without one where no window can be opened."""
    from app.gui.screen import window_unavailable_reason

    bench = select_bench(options)
    protocol = make_protocol("sine-dwell", [])
    why = "--no-window was given" if options.no_window else window_unavailable_reason()
    if not why:
        return _open_window(bench, options, protocol, autostart=True)
    sys.stderr.write(f"No window: {why}. The same job follows without one.\n")
    code, path = run_headless(bench, options, protocol)
    if path is not None and path.exists():
        _draw_run(path, path.with_suffix(".png"))
    return code


@dataclass(frozen=True)
class ShowOptions:
    """Options of `show`."""

    run: Path = option(type=path_argument, help="a run file")
    json: bool = switch("--json", JSON_OBJECT)
    picture: Path | None = option(
        "--picture", type=path_argument, metavar="PNG", help="also draw it into this PNG file"
    )


def show(options: ShowOptions) -> int:
    """Print what a run file contains."""
    from app.archive.description import run_record, run_text
    from app.cli.output import PICTURE_SUFFIXES, check_output_file, print_json, print_line
    from protocols.runfile.reader import Run, translate_read_errors

    if options.picture:
        check_output_file(options.picture, PICTURE_SUFFIXES)
    with _refusing_unreadable_runs(), Run(options.run) as run, translate_read_errors(options.run):
        if options.json:
            print_json(run_record(run))
        else:
            print_line(run_text(run))
    return _draw_run(options.run, options.picture) if options.picture else ExitCode.DONE


@dataclass(frozen=True)
class _AgainOptions:
    run: Path = option(type=path_argument, metavar="RUN", help="a run file")
    again: str = option(
        "--again",
        default="",
        metavar="WHICH",
        help="entries by what they are called, e.g. 155,160 for frequencies; or 'flagged'",
    )
    file: str = option(
        "--protocol",
        default="",
        metavar="FILE.py",
        help="the file of a lab's own protocol, where the run is of one",
    )


@dataclass(frozen=True)
class ResumeOptions(BenchOptions, _AgainOptions):
    """Options of `resume`."""

    json: bool = switch("--json", JSON_EVENTS)


def resume_run(options: ResumeOptions) -> int:
    """Resume a run, or repeat some of its points, as a new file beside the old one."""
    from protocols.resume import find_entries, load_resumable

    bench = select_bench(options)
    _load_plug_ins()
    if options.file:
        load_protocol_class(options.file, _warn)
    with _refusing_unreadable_runs():
        again = find_entries(options.run, [word for word in options.again.split(",") if word]) if options.again else ()
        before = load_resumable(options.run, again)
    options = replace(options, out=options.out or options.run.parent, specimen=options.specimen or before.specimen)
    return run_headless(bench, options, before.protocol, options.json, resume=before)[0]


@contextmanager
def _refusing_unreadable_runs() -> Iterator[None]:
    from protocols.runfile.reader import RunReadError

    try:
        yield
    except RunReadError as error:
        raise UsageError(str(error)) from None


def make_protocol(name: str, settings: Sequence[str]) -> Protocol:
    """Return the protocol `name` with `NAME=VALUE` settings.

    Raises:
        UsageError: an unknown protocol or parameter, or a value out of range; every error is listed.
    """
    kind = load_protocol_class(name, _warn)
    values: dict[str, Any] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals:
            raise UsageError(f"--set {setting}: write NAME=VALUE, for example --set peak_to_peak_v=4")
        values[key.strip()] = value.strip()
    return build_protocol(kind, values)


def _warn(problem: str) -> None:
    sys.stderr.write(f"{problem}\n")


def _load_plug_ins() -> None:
    for problem in load_plug_ins():
        _warn(problem)


def run_headless(
    bench: SelectedBench,
    options: BenchOptions,
    protocol: Protocol,
    as_json: bool = False,
    observers: Sequence[Callable[[Any], None]] = (),
    planned_faults: Sequence[str] = (),
    resume: "ResumableRun | None" = None,
) -> tuple[int, Path | None]:
    """Run a protocol with the terminal as front end; return the exit code and the run file.

    The `observers` receive every event besides the terminal; `planned_faults` are faults of a simulated bench,
    `NAME@SECONDS`; `resume` is the run to resume.
    """
    with headless_session(bench, as_json, observers, planned_faults) as front:
        request = RunRequest(protocol, options.out or Path("runs"), options.specimen or "unnamed", resume)
        front.session.run(request)
        front.wait()
    return exit_code(front.session), front.session.path if front.session.outcome else None


def _open_window(selected: SelectedBench, options: BenchOptions, protocol: Protocol, autostart: bool) -> int:
    from app.gui.application import open_window
    from app.session.connect import connect

    def open_bench(name: str) -> tuple[Any, BenchConfig]:
        other = load_bench(name)
        speed = other.simulation_parameters.speed if other.simulated else 1.0
        return lambda: connect(other, speed), other

    return open_window(
        lambda: connect(selected.config, selected.speed),
        selected.config,
        protocol,
        options.out,
        options.specimen,
        autostart,
        bench_factory=open_bench,
    )


def _draw_run(run_file: Path, picture: Path) -> int:
    from app.cli.output import PICTURE_SUFFIXES, writing_output
    from app.plotting.run_figure import draw_run
    from protocols.runfile.reader import Run

    with _refusing_unreadable_runs(), writing_output(picture, PICTURE_SUFFIXES), Run(run_file) as run:
        draw_run(run, picture)
    return ExitCode.DONE


@dataclass(frozen=True)
class ProtocolsOptions:
    """Options of `protocols`."""

    protocol: str | None = option(nargs="?", help="a protocol, or a lab's own file: ./my_protocol.py")
    json: bool = switch("--json", JSON_PLAIN)


def list_protocols(options: ProtocolsOptions) -> int:
    """Print what can be measured, or the parameters of one protocol."""
    _load_plug_ins()
    if options.protocol:
        kind = load_protocol_class(options.protocol, _warn)
        rows = _parameter_records(kind)
        lines = [f"{kind.title}: {_first_line(kind)}"]
        for row in rows:
            lines += [f"  {row['parameter']} = {row['default']} {row['unit']}".rstrip()]
            lines += [f"      {row['what it is']}" + (f"; {row['range']}" if row["range"] else "")]
    else:
        rows = [{"protocol": name, "what it measures": _first_line(kind)} for name, kind in sorted(PROTOCOLS.items())]
        widest = max(map(len, PROTOCOLS))
        lines = [f"{row['protocol']:{widest}}  {row['what it measures']}" for row in rows]
    sys.stdout.write((json.dumps(rows) if options.json else "\n".join(lines)) + "\n")
    return ExitCode.DONE


def _parameter_records(kind: type[Protocol]) -> list[dict[str, str]]:
    from app.gui.widgets.form import format_parameter, protocol_fields

    return [
        {
            "parameter": field.name,
            "default": format_parameter(kind.model_fields[field.name].get_default(call_default_factory=True)),
            "unit": field.unit,
            "range": field.limits,
            "what it is": field.description,
        }
        for field in protocol_fields(kind)
    ]


def _first_line(kind: type[Protocol]) -> str:
    """Return the first sentence of the protocol's description."""
    return (getdoc(kind) or kind.title).splitlines()[0]


COMMANDS: Mapping[str, Callable[[argparse.ArgumentParser], None]] = {
    "run": lambda parser: define_command(
        parser,
        RunOptions,
        run,
        "Run a protocol: progress on the terminal, one HDF5 file as result.",
        "example: tactor-bench run sine-dwell --set frequencies_hz=100,150,160,170,200 --set peak_to_peak_v='4 V'",
    ),
    "window": lambda parser: define_command(
        parser,
        WindowOptions,
        window,
        "Open the window, with a protocol's form filled in and, if asked, started.",
        "example: tactor-bench window sine-dwell --start --set peak_to_peak_v=4",
    ),
    "demo": lambda parser: define_command(
        parser,
        DemoOptions,
        demo,
        "The main job on the simulated bench: the window running a sine dwell; where no window can be "
        "opened, the same run with a progress bar, leaving the run file and a picture.",
        "example: tactor-bench demo --out runs",
    ),
    "show": lambda parser: define_command(
        parser,
        ShowOptions,
        show,
        "What a run file holds: how the run ended, its points and estimates.",
        "example: tactor-bench show runs/20261121T091502Z_unnamed_sine-dwell.h5 --picture run.png",
    ),
    "protocols": lambda parser: define_command(
        parser,
        ProtocolsOptions,
        list_protocols,
        "The protocols of this program and of installed packages; with a name or a file, its parameters.",
        "example: tactor-bench protocols sine-dwell",
    ),
    "resume": lambda parser: define_command(
        parser,
        ResumeOptions,
        resume_run,
        "Go on with a run that was stopped, failed or lost its program; or, with --again, measure some of its "
        "points once more. The result is a new file that carries the old points over and links to their raw data.",
        "example: tactor-bench resume runs/20261121T091502Z_T7_sine-dwell.h5 --again 155,160",
    ),
}
