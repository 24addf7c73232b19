"""What the commands do. Each takes the parsed options and returns an exit code.

`tactor-bench protocols` and `tactor-bench resume`: what can be measured, and going on with what was begun.

The parsers of `tactor-bench protocols` and `resume`. What they run is imported when it runs.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from inspect import getdoc
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.common.errors import ExitCode, UsageError
from app.common.inputs import path_argument
from app.config.bench_file import BenchConfig, load_bench
from app.gui.widgets.form import format_parameter, protocol_fields
from app.session.request import build_protocol, choose_bench, load_protocol_class
from protocols.base.jsonable import to_jsonable
from protocols.base.protocol import Protocol
from protocols.registry import PROTOCOLS, load_plug_ins
from protocols.resume import find_entries, load_resumable
from protocols.runfile.reader import RunReadError

if TYPE_CHECKING:
    from protocols.resume import ResumableRun


def protocol_names() -> str:
    """The protocols, for a help text."""
    return ", ".join(PROTOCOLS)


def run(options: argparse.Namespace) -> int:
    """`tactor-bench run PROTOCOL`."""
    config, speed = selected_bench(options)
    protocol = make_protocol(options.protocol, options.settings)
    return run_headless(config, speed, options, protocol, planned_faults=options.faults)[0]


def window(options: argparse.Namespace) -> int:
    """`tactor-bench [window]`."""
    from app.gui.screen import window_unavailable_reason

    config, speed = selected_bench(options)
    protocol = make_protocol(options.protocol, options.settings)
    if why := window_unavailable_reason():
        raise UsageError(f"no window can be opened: {why}. The same work without one: 'tactor-bench run sine-dwell'")
    return _open_window(config, speed, options, protocol, options.autostart)


def demo(options: argparse.Namespace) -> int:
    """`tactor-bench demo`: the main job, with or without a screen."""
    from app.gui.screen import window_unavailable_reason

    config, speed = selected_bench(options)
    protocol = make_protocol("sine-dwell", [])
    why = "" if not options.no_window else "--no-window was given"
    why = why or window_unavailable_reason()
    if not why:
        return _open_window(config, speed, options, protocol, autostart=True)
    sys.stderr.write(f"No window: {why}. The same job follows without one.\n")
    options.json = False
    code, path = run_headless(config, speed, options, protocol)
    if path is not None and path.exists():
        _draw_run(path, path.with_suffix(".png"))
    return code


def show(options: argparse.Namespace) -> int:
    """`tactor-bench show RUN`."""
    from app.archive.description import run_record, run_text
    from app.cli.output import PICTURE_SUFFIXES, check_output_file
    from protocols.runfile.reader import Run, RunReadError, translate_read_errors

    if options.picture:
        check_output_file(options.picture, PICTURE_SUFFIXES)
    try:
        with Run(options.run) as run, translate_read_errors(options.run):
            told = json.dumps(to_jsonable(run_record(run)), allow_nan=False) if options.json else run_text(run)
    except RunReadError as error:
        raise UsageError(str(error)) from None
    print(told)  # noqa: T201 - the command line speaks here
    if options.picture:
        return _draw_run(options.run, options.picture)
    return ExitCode.DONE


def protocol_class(name: str) -> type[Protocol]:
    """The protocol of a name, of an installed package, or of a lab's own file (`./my_protocol.py`).

    Raises:
        UsageError: there is none, or the file is broken.
    """
    return load_protocol_class(name, lambda trouble: sys.stderr.write(f"{trouble}\n"))


def make_protocol(name: str, settings: list[str]) -> Protocol:
    """The protocol `name` with `NAME=VALUE` settings.

    Raises:
        UsageError: an unknown protocol or parameter, or a value out of range; every fault is listed.
    """
    kind = protocol_class(name)
    values: dict[str, Any] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals:
            raise UsageError(f"--set {setting}: write NAME=VALUE, for example --set peak_to_peak_v=4")
        values[key.strip()] = value.strip()
    return build_protocol(kind, values)


def selected_bench(options: argparse.Namespace) -> tuple[BenchConfig, float | None]:
    """The bench and its speed; None is the virtual clock."""
    return choose_bench(options.bench, options.speed, options.seed, option="--")


def run_headless(
    config: BenchConfig,
    speed: float | None,
    options: argparse.Namespace,
    protocol: Protocol,
    observers: Sequence[Callable[[Any], None]] = (),
    planned_faults: Sequence[str] = (),
    resume: "ResumableRun | None" = None,
) -> tuple[int, Path | None]:
    """Run a protocol with the terminal as front end; the exit code and the run file.

    `observers` are told every event besides the terminal; `planned` are faults of a simulated bench, `NAME@SECONDS`;
    `before` is the run to go on with.
    """
    from app.cli.headless import exit_code, headless_session

    with headless_session(config, speed, options, observers, planned_faults) as front:
        front.session.run(protocol, options.out or Path("runs"), options.specimen or "unnamed", resume)
        front.wait()
    return exit_code(front.session), front.session.path if front.session.outcome else None


def _open_window(
    config: BenchConfig, speed: float | None, options: argparse.Namespace, protocol: Protocol, autostart: bool
) -> int:
    from app.gui.application import open_window
    from app.session.connect import connect

    def bench(name: str) -> tuple[Any, BenchConfig]:
        other = load_bench(name)
        pace = other.simulation_parameters.speed if other.simulated else 1.0
        return lambda: connect(other, pace), other

    return open_window(
        lambda: connect(config, speed), config, protocol, options.out, options.specimen, autostart, bench_factory=bench
    )


def _draw_run(run_file: Path, picture: Path) -> int:
    from app.cli.output import PICTURE_SUFFIXES, writing_output
    from app.plotting.run_figure import draw_run
    from protocols.runfile.reader import Run, RunReadError

    try:
        with writing_output(picture, PICTURE_SUFFIXES), Run(run_file) as run:
            draw_run(run, picture)
    except RunReadError as error:
        raise UsageError(str(error)) from None
    return ExitCode.DONE


def resume_run(options: argparse.Namespace) -> int:
    """Go on with a run beside the old one, of the same specimen; the exit code of a run."""
    config, speed = selected_bench(options)
    for trouble in load_plug_ins():
        sys.stderr.write(f"{trouble}\n")
    if options.file:
        protocol_class(options.file)
    try:
        again = find_entries(options.run, [word for word in options.again.split(",") if word]) if options.again else ()
        before = load_resumable(options.run, again)
    except RunReadError as error:
        raise UsageError(str(error)) from None
    options.out = options.out or options.run.parent
    options.specimen = options.specimen or before.specimen
    return run_headless(config, speed, options, before.protocol, resume=before)[0]


def list_protocols(options: argparse.Namespace) -> int:
    """What can be measured, or the parameters of one protocol."""
    for trouble in load_plug_ins():
        sys.stderr.write(f"{trouble}\n")
    if options.protocol:
        kind = protocol_class(options.protocol)
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
    """The protocol's own first sentence."""
    return (getdoc(kind) or kind.title).splitlines()[0]


def add_protocol_commands(subparsers: Any, add_bench_options: Any) -> None:
    """Register the commands with the subparsers of the command; the options are those of `run`."""
    protocols = subparsers.add_parser(
        "protocols",
        help="list what can be measured, and the parameters of each",
        description="The protocols of this program and of installed packages; with a name or a file, its parameters.",
        epilog="example: tactor-bench protocols sine-dwell",
    )
    protocols.add_argument("protocol", nargs="?", help="a protocol, or a lab's own file: ./my_protocol.py")
    protocols.add_argument("--json", action="store_true", help="as one JSON object on standard output")
    protocols.set_defaults(command=_protocols)

    resume = subparsers.add_parser(
        "resume",
        help="go on with a run that was stopped or crashed, or measure some of its points again",
        description="Go on with a run that was stopped, failed or lost its program; or, with --again, measure some of its "
        "points once more. The result is a new file that carries the old points over and links to their raw data.",
        epilog="example: tactor-bench resume runs/20261121T091502Z_T7_sine-dwell.h5 --again 155,160",
    )
    resume.add_argument("run", type=path_argument, metavar="RUN", help="a run file")
    resume.add_argument(
        "--again",
        default="",
        metavar="WHICH",
        help="entries by what they are called, e.g. 155,160 for frequencies; or 'flagged'",
    )
    resume.add_argument(
        "--protocol",
        dest="file",
        default="",
        metavar="FILE.py",
        help="the file of a lab's own protocol, where the run is of one",
    )
    add_bench_options(resume)
    resume.add_argument("--json", action="store_true", help="one JSON object per event on standard output, SI units")
    resume.set_defaults(command=_resume)


def _protocols(options: argparse.Namespace) -> int:

    return list_protocols(options)


def _resume(options: argparse.Namespace) -> int:

    return resume_run(options)
