"""The command `tactor-bench`: the window, and the same work without one.

Exit codes: 0 done, 1 the run failed, 2 asked wrongly, 3 UNSAFE: rest could not be confirmed.
"""

import argparse
import functools
import gc
import logging
import os
import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

from app.common.errors import ExitCode, UsageError
from app.common.inputs import path_argument, seed_argument, specimen_argument, truncate_text

PROGRAM = "tactor-bench"
GC_THRESHOLD = 50_000
"""Objects made between two looks for garbage. Python's own 700 is a seventh of the time to a window: imports leave none."""
PROTOCOL_HELP = "a protocol, such as sine-dwell ('tactor-bench protocols' lists them)"


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}. '{self.prog} --help' shows what is understood")


class _Version(argparse.Action):
    """Prints the version; asking the installed packages for it takes a while, so only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from app.common.version import version

        parser.exit(message=f"{PROGRAM} {version()}\n")


def _deferred_command(name: str) -> Callable[[argparse.Namespace], int]:
    """A function of `app.cli.run`, imported when it runs: a help text or the model need none of its half second."""

    def command(options: argparse.Namespace) -> int:
        from app.cli import run as commands

        return int(getattr(commands, name)(options))

    return command


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit code."""
    # Before numpy is there: our matrices are small, and threads that wait for each other take longer than one.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Nor pydantic's: looking through every installed package for plug-ins of it, of which we use none.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    gc.set_threshold(GC_THRESHOLD)
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    try:
        options = _parser().parse_args(arguments)
        return int(options.command(options))
    except UsageError as error:
        sys.stderr.write(f"{PROGRAM}: {error}\n")
        return ExitCode.USAGE
    except KeyboardInterrupt:
        sys.stderr.write(f"{PROGRAM}: interrupted\n")
        return ExitCode.FAILED
    except BrokenPipeError:  # somebody reads only the beginning: `tactor-bench show RUN | head`
        return ExitCode.FAILED
    except OSError as error:  # what nobody foresaw still gets its sentence
        where = f"{truncate_text(str(error.filename))}: " if error.filename else ""
        sys.stderr.write(f"{PROGRAM}: {where}{error.strerror or error}\n")
        return ExitCode.FAILED
    except MemoryError:
        sys.stderr.write(f"{PROGRAM}: there is not enough memory for this; ask for less at once\n")
        return ExitCode.FAILED


def entry() -> NoReturn:
    """The console script: `main`, and out."""
    code = main()
    try:
        sys.stdout.flush()
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            sys.stderr.write(f"{PROGRAM}: the answer could not be written: {error.strerror}\n")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the interpreter's own flush complains
        code = ExitCode.FAILED if code == ExitCode.DONE else code
    runfile = sys.modules.get("protocols.runfile.writer")
    if runfile is not None and runfile.has_unclosable_file():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


@functools.cache
def _parser() -> argparse.ArgumentParser:
    """Everything that is understood; made once, since it takes longer than many a command."""
    from app.cli.bench import add_bench_commands, add_fault_option
    from app.cli.campaign import add_campaign_command
    from app.cli.identify import add_identify_commands, add_report_command
    from app.cli.import_ import add_import_command
    from app.cli.model import add_model_commands
    from app.cli.run import add_protocol_commands
    from app.cli.runs import add_run_commands

    parser = _Parser(
        prog=PROGRAM,
        description="Drive, measure, model and identify macro-fiber-composite tactors.",
        epilog="Without a command the window opens. Exit codes: 0 done, 1 the run failed, 2 asked wrongly, "
        "3 UNSAFE: rest could not be confirmed.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="the program's version")
    _add_bench_options(parser)
    parser.set_defaults(
        command=_deferred_command("window"),
        protocol="sine-dwell",
        settings=[],
        autostart=False,
        bench="sim",
        speed=None,
        seed=None,
        out=None,
        specimen=None,
    )
    known = parser.add_subparsers(title="commands", metavar="COMMAND", parser_class=_Parser)

    run = known.add_parser(
        "run",
        help="run a protocol without a window",
        description="Run a protocol: progress on the terminal, one HDF5 file as result.",
        epilog="example: tactor-bench run sine-dwell --set frequencies_hz=100,150,160,170,200 --set peak_to_peak_v='4 V'",
    )
    run.add_argument("protocol", help=f"{PROTOCOL_HELP}, or a lab's own file: ./my_protocol.py")
    _add_bench_options(run)
    _add_setting_option(run)
    run.add_argument("--json", action="store_true", help="one JSON object per event on standard output, SI units")
    add_fault_option(run)
    run.set_defaults(command=_deferred_command("run"))

    window = known.add_parser(
        "window",
        help="open the window (also what happens without a command)",
        description="Open the window, with a protocol's form filled in and, if asked, started.",
        epilog="example: tactor-bench window sine-dwell --start --set peak_to_peak_v=4",
    )
    window.add_argument("protocol", nargs="?", default="sine-dwell", help=PROTOCOL_HELP)
    _add_bench_options(window)
    _add_setting_option(window)
    window.add_argument(
        "--start", dest="autostart", action="store_true", help="start the run as soon as the bench is there"
    )
    window.set_defaults(command=_deferred_command("window"))

    demo = known.add_parser(
        "demo",
        help="a sine dwell on the simulated bench: in the window, or without a screen as a file and a picture",
        description="The main job on the simulated bench: the window running a sine dwell; where no window can be "
        "opened, the same run with a progress bar, leaving the run file and a picture.",
        epilog="example: tactor-bench demo --out runs",
    )
    _add_bench_options(demo)
    demo.add_argument("--no-window", action="store_true", help="do without the window even where there is a screen")
    demo.set_defaults(command=_deferred_command("demo"))

    show = known.add_parser(
        "show",
        help="tell what a run file holds",
        description="What a run file holds: how the run ended, its points and estimates.",
        epilog="example: tactor-bench show runs/20261121T091502Z_unnamed_sine-dwell.h5 --picture run.png",
    )
    show.add_argument("run", type=path_argument, help="a run file")
    show.add_argument("--json", action="store_true", help="as one JSON object, SI units")
    show.add_argument("--picture", type=path_argument, metavar="PNG", help="also draw it into this PNG file")
    show.set_defaults(command=_deferred_command("show"))
    add_bench_commands(known, _add_bench_options, _add_setting_option)
    add_campaign_command(known, _add_bench_options)
    add_model_commands(known)
    add_run_commands(known)
    add_import_command(known)
    add_protocol_commands(known, _add_bench_options)
    add_identify_commands(known)
    add_report_command(known)
    return parser


def _add_bench_options(parser: argparse.ArgumentParser) -> None:
    # SUPPRESS: a command's own default must not overwrite what stood before the command.
    add = functools.partial(parser.add_argument, default=argparse.SUPPRESS)
    add("--bench", metavar="FILE|sim", help="bench file, or 'sim' (default) for the simulated bench")
    add("--speed", metavar="N|max", help="simulated bench only: 1 to 20 times real speed, or 'max' (virtual clock)")
    add("--seed", type=seed_argument, help="simulated bench only: seed of its noise")
    add("--out", type=path_argument, help="folder for run files (default: runs; the window: the one used last)")
    add(
        "--specimen",
        type=specimen_argument,
        help="name of the specimen (default: unnamed; the window: the one used last)",
    )


def _add_setting_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--set",
        dest="settings",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter of the protocol, with or without a unit; may be given often",
    )


if __name__ == "__main__":
    entry()
