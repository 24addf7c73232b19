"""The parsers of `tactor-bench check`, `devices`, `bench` and `faults`. What they run is imported when it runs."""

import argparse
from collections.abc import Callable
from typing import Any

from app.arguments import path

Options = Callable[[argparse.ArgumentParser], None]


def add_bench_commands(known: Any, bench_options: Options, setting_option: Options) -> None:
    """Register the commands with the subparsers of the command; the options are those of `run`."""
    check = known.add_parser(
        "check",
        help="check the wiring with small voltages: a table of pass and fail",
        description="The wiring check: rest, a tenth of a volt to either side and a small sine. Prints every figure with "
        "its limits. Exit code 0 all passed, 1 something did not, 3 UNSAFE.",
        epilog="example: tactor-bench check --bench bench1.toml --set level_v='50 mV'",
    )
    bench_options(check)
    setting_option(check)
    add_fault_option(check)
    check.add_argument("--json", action="store_true", help="the table as one JSON object on standard output, SI units")
    check.set_defaults(command=_check)

    devices = known.add_parser(
        "devices",
        help="find what is connected: VISA instruments, NI cards, serial ports",
        description="What can be found: USB, VXI-11 and serial VISA resources, NI cards of this computer or of a gRPC "
        "server, serial ports. A raw LAN socket cannot be found, only asked: name its host.",
        epilog="example: tactor-bench devices --host 192.0.2.7 --server 192.0.2.8:31763",
    )
    _finding_options(devices)
    devices.add_argument("--json", action="store_true", help="as one JSON object on standard output")
    devices.set_defaults(command=_devices)

    bench = known.add_parser("bench", help="write a first bench file", description="Bench files.")
    verbs = bench.add_subparsers(title="what to do", metavar="VERB", required=True, parser_class=type(bench))
    new = verbs.add_parser(
        "new",
        help="write a first bench file from what is found",
        description="Write a first, commented bench file from what `tactor-bench devices` finds. Never overwrites one.",
        epilog="example: tactor-bench bench new bench1.toml --host 192.0.2.7",
    )
    new.add_argument("file", type=path, metavar="FILE", help="the file to write")
    _finding_options(new)
    new.set_defaults(command=_bench_new)

    faults = known.add_parser(
        "faults",
        help="list what can be broken on a simulated bench",
        description="The faults of a simulated bench, for 'tactor-bench run ... --fault NAME@SECONDS'.",
        epilog="example: tactor-bench run sine-dwell --speed max --fault scpi-dropped@3",
    )
    faults.add_argument("--json", action="store_true", help="as one JSON object on standard output")
    faults.set_defaults(command=_faults)


def add_fault_option(parser: argparse.ArgumentParser) -> None:
    """`--fault` of `run`."""
    parser.add_argument(
        "--fault",
        dest="faults",
        action="append",
        default=[],
        metavar="NAME[@SECONDS]",
        help="simulated bench only: break this so many bench seconds after the run began (default 0); may be given "
        "often. 'tactor-bench faults' lists them",
    )


def _finding_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--host",
        dest="hosts",
        action="append",
        default=[],
        metavar="HOST[:PORT]",
        help="also ask for an instrument on a LAN socket of this host (default ports 5025 and 5555); may be given often",
    )
    parser.add_argument(
        "--server", default="", metavar="HOST:PORT", help="NI's gRPC device server, for a card elsewhere"
    )


def _check(options: argparse.Namespace) -> int:
    from app.check_command import check

    return check(options)


def _devices(options: argparse.Namespace) -> int:
    from app.device_commands import devices

    return devices(options)


def _bench_new(options: argparse.Namespace) -> int:
    from app.device_commands import bench_new

    return bench_new(options)


def _faults(options: argparse.Namespace) -> int:
    from app.device_commands import list_faults

    return list_faults(options)
