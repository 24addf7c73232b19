"""The parsers of `tactor-bench check`, `devices`, `bench` and `faults`. What they run is imported when it runs.

`tactor-bench check`: runs the wiring check and prints its table.

`tactor-bench devices`, `bench new` and `faults`.
"""

import argparse
import copy
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from app.cli.run import make_protocol, run_headless, selected_bench
from app.common.errors import ExitCode, UsageError
from app.common.inputs import path_argument
from app.config.discovery import find_devices
from app.config.template import bench_template
from drivers.bench.rest import REST_REPEATABILITY_V
from protocols.base.events import PointMeasured, RestMeasured, RunEnded
from protocols.base.jsonable import to_jsonable
from protocols.measurements.wiring_check import Verdict, WiringCheck
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS

AddOptions = Callable[[argparse.ArgumentParser], None]


def add_bench_commands(subparsers: Any, add_bench_options: AddOptions, add_setting_option: AddOptions) -> None:
    """Register the commands with the subparsers of the command; the options are those of `run`."""
    check = subparsers.add_parser(
        "check",
        help="check the wiring with small voltages: a table of pass and fail",
        description="The wiring check: rest, a tenth of a volt to either side and a small sine. Prints every figure with "
        "its limits. Exit code 0 all passed, 1 something did not, 3 UNSAFE.",
        epilog="example: tactor-bench check --bench bench1.toml --set level_v='50 mV'",
    )
    add_bench_options(check)
    add_setting_option(check)
    add_fault_option(check)
    check.add_argument("--json", action="store_true", help="the table as one JSON object on standard output, SI units")
    check.set_defaults(command=_check)

    devices = subparsers.add_parser(
        "devices",
        help="find what is connected: VISA instruments, NI cards, serial ports",
        description="What can be found: USB, VXI-11 and serial VISA resources, NI cards of this computer or of a gRPC "
        "server, serial ports. A raw LAN socket cannot be found, only asked: name its host.",
        epilog="example: tactor-bench devices --host 192.0.2.7 --server 192.0.2.8:31763",
    )
    _add_discovery_options(devices)
    devices.add_argument("--json", action="store_true", help="as one JSON object on standard output")
    devices.set_defaults(command=_devices)

    bench = subparsers.add_parser("bench", help="write a first bench file", description="Bench files.")
    verbs = bench.add_subparsers(title="what to do", metavar="VERB", required=True, parser_class=type(bench))
    new = verbs.add_parser(
        "new",
        help="write a first bench file from what is found",
        description="Write a first, commented bench file from what `tactor-bench devices` finds. Never overwrites one.",
        epilog="example: tactor-bench bench new bench1.toml --host 192.0.2.7",
    )
    new.add_argument("file", type=path_argument, metavar="FILE", help="the file to write")
    _add_discovery_options(new)
    new.set_defaults(command=_bench_new)

    faults = subparsers.add_parser(
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


def _add_discovery_options(parser: argparse.ArgumentParser) -> None:
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

    return check(options)


def _devices(options: argparse.Namespace) -> int:

    return list_devices(options)


def _bench_new(options: argparse.Namespace) -> int:

    return write_bench_template(options)


def _faults(options: argparse.Namespace) -> int:

    return list_faults(options)


DISPLAY_UNITS = {"m": (1e6, "µm"), "s": (1e3, "ms"), "m/V": (1e6, "µm/V")}


def check(options: argparse.Namespace) -> int:
    """Run it; 0 where everything passed, 1 where not or where the run failed, 3 UNSAFE."""
    config, speed = selected_bench(options)
    protocol = make_protocol(WiringCheck.name, options.settings)
    assert isinstance(protocol, WiringCheck)
    events: list[Any] = []
    told = copy.copy(options)
    told.json = False  # the run speaks to the person; only the table is for the machine
    code, path = run_headless(config, speed, told, protocol, [events.append], options.faults)
    points = [event.point for event in events if isinstance(event, PointMeasured)]
    verdicts = protocol.verdicts(points)
    if verdicts:
        rest = next((event for event in events if isinstance(event, RestMeasured)), None)
        verdicts = (*verdicts, _rest_verdict(rest, points[0].drive))
    passed = code == ExitCode.DONE and bool(verdicts) and all(verdict.passed for verdict in verdicts)
    if options.json:
        ended = next((event for event in events if isinstance(event, RunEnded)), None)
        record = {
            "passed": passed,
            "status": ended.status if ended else "failed",
            "reason": ended.reason if ended else "the bench could not be opened",
            "file": str(path) if path else None,
            "checks": [_verdict_record(verdict) for verdict in verdicts],
        }
        sys.stdout.write(json.dumps(to_jsonable(record), allow_nan=False) + "\n")
    else:
        Console(markup=False).print(
            _verdict_table(verdicts) if verdicts else "The check was not carried to its end: there is no table."
        )
        for verdict in verdicts:
            if not verdict.passed:
                Console(stderr=True, markup=False).print(
                    f"{verdict.name}: {verdict.remedy}", highlight=False, soft_wrap=True
                )
    return code if code != ExitCode.DONE else (ExitCode.DONE if passed else ExitCode.FAILED)


def _rest_verdict(rest: RestMeasured | None, initial_v: float) -> Verdict:
    measured_v = rest.measured_v if rest is not None and rest.confirmed else math.nan
    low, high = initial_v - REST_REPEATABILITY_V, initial_v + REST_REPEATABILITY_V
    return Verdict("rest confirmed at the end", measured_v, "V", low, high, "see the run's own sentence above")


def _verdict_record(verdict: Verdict) -> dict[str, Any]:
    return {
        "name": verdict.name,
        "value": verdict.value,
        "unit": verdict.unit,
        "low": verdict.low,
        "high": verdict.high,
        "passed": verdict.passed,
        "remedy": "" if verdict.passed else verdict.remedy,
    }


def _verdict_table(verdicts: Sequence[Verdict]) -> Table:
    table = Table(title="Wiring check", title_justify="left")
    for head in ("", "what", "figure", "limits", "unit"):
        table.add_column(head, justify="right" if head in ("figure", "limits") else "left")
    for verdict in verdicts:
        factor, unit = DISPLAY_UNITS.get(verdict.unit, (1.0, verdict.unit))
        low, high = (None if limit is None else f"{factor * limit:.4g}" for limit in (verdict.low, verdict.high))
        limits = f"{low} .. {high}" if low and high else f"at least {low}" if low else f"at most {high}"
        word = Text("pass", "green") if verdict.passed else Text("FAIL", "bold red")
        figure = f"{factor * verdict.value:.4g}" if math.isfinite(verdict.value) else "not seen"
        table.add_row(word, verdict.name, figure, limits, "" if unit == "1" else unit)
    return table


def list_devices(options: argparse.Namespace) -> int:
    """Print what is connected; 0 also where nothing is."""
    found, notes = find_devices(options.hosts, options.server)
    if options.json:
        sys.stdout.write(json.dumps({"found": [asdict(one) for one in found], "notes": notes}) + "\n")
        return ExitCode.DONE
    table = Table(title="Connected" if found else "Nothing was found", title_justify="left")
    for head in ("what", "where", "who"):
        table.add_column(head, overflow="fold")
    for one in found:
        table.add_row(one.role, one.where, one.identity)
    Console(markup=False, highlight=False).print(table if found else "Nothing was found.")
    for note in notes:
        sys.stderr.write(f"{note}\n")
    return ExitCode.DONE


def write_bench_template(options: argparse.Namespace) -> int:
    """Write a first bench file.

    Raises:
        UsageError: the file is there already, or cannot be written.
    """
    if options.file.exists():
        raise UsageError(f"{options.file} is there already and is not overwritten; give another name")
    found, notes = find_devices(options.hosts, options.server)
    try:
        with options.file.open("x", encoding="utf-8") as file:
            file.write(bench_template(found, options.server))
    except FileExistsError:
        raise UsageError(f"{options.file} is there already and is not overwritten; give another name") from None
    except OSError as error:
        raise UsageError(f"{options.file} cannot be written: {error.strerror or error}") from None
    for note in notes:
        sys.stderr.write(f"{note}\n")
    have = [f"{one.role} {one.identity}" for one in found if one.role in ("generator", "supply", "card")]
    sys.stderr.write(
        f"{options.file}: {', '.join(have) or 'nothing was found, the addresses are examples'}. Go through it\n"
    )
    return ExitCode.DONE


def list_faults(options: argparse.Namespace) -> int:
    """Print what can be broken on a simulated bench."""
    if options.json:
        sys.stdout.write(json.dumps(FAULT_DESCRIPTIONS) + "\n")
        return ExitCode.DONE
    width = max(map(len, FAULT_DESCRIPTIONS))
    sys.stdout.write("".join(f"{name:{width}}  {words}\n" for name, words in FAULT_DESCRIPTIONS.items()))
    return ExitCode.DONE
