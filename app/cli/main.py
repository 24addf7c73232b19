"""Entry point of the command line `tactor-bench`.

The exit codes are in docs/reference/exit-codes.md.
"""

import argparse
import functools
import gc
import io
import logging
import os
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, NoReturn

from app.cli.options import BenchOptions, add_options, define_command, read_options
from app.common import ExitCode, UsageError, print_message, truncate_text
from drivers import threads_left_behind

PROGRAM = "tactor-bench"
COMMANDS: Mapping[str, tuple[str, str]] = {
    "run": ("run:RunCommand", "run a protocol without a window"),
    "window": ("run:WindowCommand", "open the window (default without a command)"),
    "demo": (
        "run:DemoCommand",
        "demonstrate a sine dwell on the simulated bench: in the window, or without a screen as a file and a picture",
    ),
    "show": ("run:ShowCommand", "show the contents of a run file"),
    "judge": ("run_files:JudgeCommand", "judge runs of earlier versions and imported runs by their points"),
    "check": ("bench:CheckCommand", "check the wiring with small voltages; table of passed and failed checks"),
    "commission": (
        "bench:CommissionCommand",
        "measure the properties that the driver assumes of the source, with high voltage off",
    ),
    "devices": ("bench:DevicesCommand", "list the connected VISA instruments, NI cards and serial ports"),
    "bench": ("bench:VERBS", "write a first bench file"),
    "faults": ("bench:FaultsCommand", "list the faults that can be injected into a simulated bench"),
    "campaign": ("campaign:VERBS", "plan and run all measurements of a specimen: new, status, run, resume ..."),
    "model": (
        "model:VERBS",
        "compute model quantities: parameters, modes, statics, frequency response, step, membrane, convergence",
    ),
    "study": (
        "study:StudyCommand",
        "study the response over parameter values: curves, HDF5 and CSV files, sensitivity",
    ),
    "figures": (
        "study:FiguresCommand",
        "draw the theory curves of the paper's Figs. 4, 5, 6, 8, 9, 10, 11, 12 as pictures and CSV",
    ),
    "runs": ("runs:RunsCommand", "list the runs of a folder; filter by specimen, protocol, date, status or text"),
    "operator": (
        "laboratory.people:OperatorCommand",
        "set today's operator, temperature and humidity, stored in every run",
    ),
    "checked": ("laboratory.people:CheckedCommand", "record the check of runs by a second person"),
    "fleet": (
        "laboratory.fleet:FleetCommand",
        "compare many specimens: mean, spread, outliers, Cpk, trends; by batch, bench or month",
    ),
    "fleet identify": (
        "laboratory.fleet_identify:FleetIdentifyCommand",
        "identify every specimen of a folder, on all cores or on several computers",
    ),
    "control-chart": (
        "laboratory.fleet:ControlChartCommand",
        "chart a golden specimen over time: drift of the bench, or of the specimen",
    ),
    "repeatability": (
        "laboratory.fleet:RepeatabilityCommand",
        "split the scatter of a quantity between specimens, operators, mountings and repeats (gauge R&R)",
    ),
    "certificate": (
        "laboratory.certificates:VERBS",
        "manage calibration certificates of instruments and their due dates: add, list, show",
    ),
    "audit": (
        "laboratory.audit:VERBS",
        "keep an audit trail of a folder, which detects any later change: start, verify, show, head",
    ),
    "serve": (
        "laboratory.serve:ServeCommand",
        "serve a folder of runs to colleagues' browsers, read-only: list, search, plots, downloads, reports",
    ),
    "backup": (
        "laboratory.backup:BackupCommand",
        "copy new and changed runs to a second folder, verified by their hashes",
    ),
    "export": (
        "run_files:ExportCommand",
        "export runs for other programs: CSV, Excel, MATLAB, Parquet, Universal File",
    ),
    "archive": (
        "specimen.archive:ArchiveCommand",
        "archive a specimen with all its runs as one file for a lab notebook or another computer",
    ),
    "restore": ("specimen.archive:RestoreCommand", "restore the files of an archive, each with its hash verified"),
    "verify": ("run_files:VerifyCommand", "verify run files by their checksums; repair files of a killed program"),
    "import": (
        "import_:ImportCommand",
        "import tables and time series (CSV, MATLAB, TDMS, Universal File) as run files",
    ),
    "protocols": ("run:ProtocolsCommand", "list the protocols and their parameters"),
    "resume": ("run:ResumeCommand", "resume a stopped or crashed run, or measure some of its points again"),
    "identify": ("identify:IdentifyCommand", "identify the parameters of a specimen from its runs, with errors"),
    "compare": (
        "compare:CompareCommand",
        "compare two runs point by point, or up to 20 runs by curves, peaks and differences",
    ),
    "calibration": (
        "identify:VERBS",
        "manage the accepted estimates of a specimen: accept, show, diff, use another version",
    ),
    "specimen": ("specimen.commands:VERBS", "edit the specimen sheet (dimensions and masses): new, set, show, check"),
    "mounting": (
        "specimen.mounting:MountingCommand",
        "record that mass, plate, membrane or laser was mounted anew, or list the mountings of a specimen",
    ),
    "label": ("specimen.label:LabelCommand", "make labels of specimens to print, with a QR code for a barcode scanner"),
    "report": ("report:ReportCommand", "write the report of a specimen as PDF and HTML"),
}
"""Module and class or group of each command, and one line of help. A module is imported only for its own commands."""

EXIT_CODE_HELP = (
    "0 done (a run: good or doubtful), 1 did not pass, stopped or failed, 2 invalid arguments (nothing was moved), "
    "3 UNSAFE: rest could not be confirmed, 4 no result: nothing usable was measured"
)
"""As the table in docs/reference/exit-codes.md."""

GC_THRESHOLD = 50_000
"""Garbage collection threshold. Python's default of 700 costs a seventh of the start-up time, although imports leave no garbage."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}. '{self.prog} --help' lists the options")


class _Version(argparse.Action):
    """Prints the version, which is read from the installed packages only then because it is slow."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from drivers.watchdog import version

        parser.exit(message=f"{PROGRAM} {version()}\n")


class _Commands(argparse._SubParsersAction):  # type: ignore[type-arg]  # noqa: SLF001
    """Subcommands whose modules are imported when they are used, to define their options."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        if " ".join(values[:2]) in COMMANDS:  # a command of two words
            values = [" ".join(values[:2]), *values[2:]]
        self.define(values[0])
        super().__call__(parser, namespace, values, option_string)

    def define(self, name: str) -> None:
        """Add the options of a command to its parser, once."""
        parser = self.choices[name]
        if parser.get_default("command") is None and parser.description is None:
            module, _, command = COMMANDS[name][0].partition(":")
            define_command(parser, getattr(import_module(f"app.cli.{module}"), command))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    # Set before numpy is imported: the matrices are small, and several threads are slower than one.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Keeps pydantic from searching every installed package for plug-ins.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    gc.set_threshold(GC_THRESHOLD)
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    try:
        options = _parser().parse_args(arguments)
        return int(options.command(options))
    except UsageError as error:
        print_message(f"{PROGRAM}: {error}")
        return ExitCode.USAGE
    except (KeyboardInterrupt, SystemError) as error:
        if isinstance(error, SystemError) and not isinstance(error.__cause__, KeyboardInterrupt):
            raise  # the other one is an interruption within HDF5
        print_message(f"{PROGRAM}: interrupted")
        return ExitCode.FAILED
    except BrokenPipeError:  # the reader closed the pipe: `tactor-bench show RUN | head`
        return ExitCode.FAILED
    except OSError as error:  # errors that no command handles
        where = f"{truncate_text(str(error.filename))}: " if error.filename else ""
        print_message(f"{PROGRAM}: {where}{error.strerror or error}")
        return ExitCode.FAILED
    except MemoryError:
        print_message(f"{PROGRAM}: there is not enough memory for this; compute less at a time")
        return ExitCode.FAILED


def prepare_console() -> None:
    """Print `?` for characters missing in the console's encoding: a pipe on Windows is cp1252, which has no check mark.

    A closed stream is replaced: a file that is opened later must not get its number.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), "r" if number == 0 else "w"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def entry() -> NoReturn:
    """Run `main` as the console script and exit."""
    os.environ["PYTHONSAFEPATH"] = "1"  # the Python processes that it starts do not import from the working directory
    prepare_console()
    code = main()
    try:
        sys.stdout.flush()
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            print_message(f"{PROGRAM}: the answer could not be written: {error.strerror}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the interpreter's own flush complains
        code = ExitCode.FAILED if code == ExitCode.DONE else code
    runfile = sys.modules.get("protocols.runfile.writer")
    if threads_left_behind() or (runfile is not None and runfile.has_unclosable_file()):
        sys.stderr.flush()
        os._exit(code)
    gc.freeze()  # the interpreter would search all imported modules for garbage: a sixth of the time of a short command
    sys.exit(code)


@functools.cache
def _parser() -> argparse.ArgumentParser:
    """Return the parser, which is built once because that is slow."""
    parser = _Parser(
        prog=PROGRAM,
        description="Drive, measure, model and identify macro-fiber-composite tactors.",
        epilog=f"Without a command the window opens. Exit codes: {EXIT_CODE_HELP}.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version of the program and exit")
    add_options(parser, BenchOptions)
    parser.set_defaults(command=_open_window)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", action=_Commands, parser_class=_Parser)
    for name, (_, text) in COMMANDS.items():
        commands.add_parser(name, help=text)
    return parser


def complete_parser() -> argparse.ArgumentParser:
    """Return the parser with the options of every command."""
    parser = _parser()
    for action in parser._actions:  # noqa: SLF001 - argparse has no public access to its commands
        if isinstance(action, _Commands):
            for name in COMMANDS:
                action.define(name)
    return parser


def _open_window(namespace: argparse.Namespace) -> int:
    from app.cli.run import WindowCommand

    return read_options(WindowCommand, namespace).execute()


if __name__ == "__main__":
    entry()
