"""The commands `check`, `devices`, `commission`, `bench new` and `faults`."""

import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console, OverflowMethod
from rich.table import Table
from rich.text import Text

from app.cli.headless import make_protocol, run_headless, run_request, select_bench
from app.cli.options import (
    FAULTS,
    JSON_PLAIN,
    BenchSelection,
    CommandGroup,
    ProtocolOptions,
    argument,
    command,
    option,
    options,
)
from app.cli.output import PICTURE_SUFFIXES, check_output_file, print_answer, print_json, writing_output
from app.common import ExitCode, UsageError, check_row, print_message
from app.config import bench_template, find_devices
from app.services import operator_reachable
from drivers import INTERLOCK_RECOMMENDED, REST_REPEATABILITY_V, BenchError
from protocols import WIRING_CHECK
from protocols.base import (
    CheckResult,
    Outcome,
    PointMeasured,
    Prompt,
    RestMeasured,
    RunEnded,
    Verdict,
    checks_by_remedy,
)
from protocols.commissioning import OutputVerdict
from sim_hardware.plant import FAULT_DESCRIPTIONS

INSTRUMENT_ROLES = ("generator", "supply", "card")
"""Roles of devices that a bench file names."""


@command("example: tactor-bench check --bench bench1.toml --set level_v='50 mV'")
class CheckCommand(ProtocolOptions):
    """Check the wiring with small voltages: rest, a tenth of a volt to either side, a small sine. Prints every figure with
    its limits. Exit code 0 all checks passed, 1 a check or the run failed, 3 UNSAFE, 4 no result.
    """

    faults: Sequence[str] = FAULTS
    json: bool = option("the table as one JSON object on standard output, SI units")

    def execute(self) -> int:
        bench = select_bench(self)
        protocol = make_protocol(WIRING_CHECK, self.settings)
        events: list[Any] = []
        # The run itself is shown to the operator; only the table is JSON.
        code, path = run_headless(bench, run_request(self, protocol), False, [events.append], self.faults)
        ended = next((event for event in events if isinstance(event, RunEnded)), None)
        verdict = ended.verdict if ended else Verdict(Outcome.FAILED, ("the bench could not be opened",))
        checks = (*verdict.checks, *_rest_check(events)) if verdict.checks else ()
        failed = [check for check in checks if not check.passed]
        passed = verdict.outcome.has_result and all(check.consequence is not Outcome.DID_NOT_PASS for check in failed)
        if self.json:
            record = {
                "passed": passed,
                "verdict": verdict.outcome,
                "status": ended.status if ended else "failed",
                "reason": ended.reason if ended else "the bench could not be opened",
                "file": str(path) if path else None,
                "checks": [_check_record(check) for check in checks],
                "interlock": bool(bench.config.interlock.line),
            }
            print_json(record)
        else:
            _print_checks(checks, failed)
            if not (bench.config.simulated or bench.config.interlock.line):
                print_message(INTERLOCK_RECOMMENDED)
            if passed:
                print_message(f"Next: tactor-bench run sine-dwell --bench {self.bench} --set 'peak_to_peak_v=1 V'")
        return code if passed or code != ExitCode.DONE else ExitCode.FAILED


def _check_record(check: CheckResult) -> dict[str, Any]:
    record = {name: getattr(check, name) for name in ("name", "value", "unit", "low", "high", "passed")}
    return {**record, "remedy": "" if check.passed else check.remedy}


def _print_checks(checks: Sequence[CheckResult], failed: Sequence[CheckResult]) -> None:
    Console(markup=False).print(_check_table(checks) if checks else "The check was not completed: there is no table.")
    for remedy, same in checks_by_remedy(failed).items():
        names = ", ".join(check.name for check in same)
        Console(stderr=True, markup=False).print(f"{names}: {remedy}", highlight=False, soft_wrap=True)


def _rest_check(events: Sequence[Any]) -> Iterator[CheckResult]:
    """Yield whether rest at the end is the drive of the first point, if a point was measured."""
    point = next((event.point for event in events if isinstance(event, PointMeasured)), None)
    if point is None:
        return
    rest = next((event for event in events if isinstance(event, RestMeasured)), None)
    measured_v = rest.measured_v if rest is not None and rest.confirmed else math.nan
    low, high = point.drive - REST_REPEATABILITY_V, point.drive + REST_REPEATABILITY_V
    remedy = "see the sentence of the run above"
    yield CheckResult("rest confirmed at the end", measured_v, "V", low, high, remedy, Outcome.DID_NOT_PASS)


def _table(title: str, *heads: str, overflow: OverflowMethod = "fold") -> Table:
    """Return an empty table; the columns of numbers are aligned at the right."""
    table = Table(title=title, title_justify="left")
    for head in heads:
        table.add_column(head, justify="right" if head in ("figure", "limits") else "left", overflow=overflow)
    return table


def _check_table(checks: Sequence[CheckResult]) -> Table:
    table = _table("Wiring check", "", "check", "figure", "limits", "unit", overflow="ellipsis")
    for check in checks:
        row = check_row(check)
        word = Text("pass", "green") if row.passed else Text("FAIL", "bold red")
        table.add_row(word, row.name, row.figure, row.limits, row.unit)
    return table


@command("example: tactor-bench commission --bench bench1.toml")
class CommissionCommand(BenchSelection):
    """Commission the source: with high voltage off, exercise the instrument's properties that the driver assumes, and
    measure them at the amplifier's input. Prints pass, differs or dangerous for each property and stores a record by
    make, model, serial number and firmware. Exit code 0 all passed, 1 a property differs, 2 set-up failed.
    """

    picture: Path | None = option("also draw the recorded outputs into this file", metavar="PNG")
    json: bool = option("the record as one JSON object on standard output, SI units")
    share: Path | None = option(
        "also write the record for the developers: model, firmware and figures, without serial number, address, names, paths "
        "and time of day",
        metavar="FILE",
    )

    def execute(self) -> int:
        from app.session import commission, make_record, shared_record

        bench = select_bench(self)
        if self.picture:
            check_output_file(self.picture, PICTURE_SUFFIXES)
        if self.share:
            check_output_file(self.share)
        if not bench.config.simulated and not operator_reachable():
            raise UsageError(
                f"commissioning on {bench.config.name} needs an operator who switches high voltage off, and standard input is "
                "not a terminal. Nothing was moved. Start it at a terminal"
            )
        try:
            done = commission(
                bench.config,
                bench.speed,
                (lambda _: None) if bench.config.simulated else _wait_for_operator,
                lambda name, fraction: print_message(f"{100 * fraction:3.0f} % {name} ..."),
            )
        except BenchError as error:
            raise UsageError(f"not commissioned, and no record is stored: {error}") from None
        record = make_record(done.identity, bench.config.simulated, done.rate_hz, done.result, bench.config.card.driver)
        if self.json:
            print_json({**record, "file": str(done.path)})
        else:
            _print_commissioning(record, done.path)
        if self.share:
            with writing_output(self.share):
                self.share.write_text(json.dumps(shared_record(record), indent=1, ensure_ascii=False) + "\n", "utf-8")
        if self.picture:
            from app.plotting import draw_commissioning

            title = f"{done.identity}, firmware {done.identity.firmware or 'unknown'}: {record['verdict']}"
            rest_v = bench.config.amplifier.rest_v
            with writing_output(self.picture, PICTURE_SUFFIXES):
                draw_commissioning(title, done.result.traces, rest_v, bench.config.simulated, self.picture)
        if record["verdict"] != OutputVerdict.PASS:
            return ExitCode.FAILED
        if not self.json:
            print_message(f"Next: tactor-bench check --bench {self.bench}, with high voltage on")
        return ExitCode.DONE


def _wait_for_operator(prompt: Prompt) -> None:
    print_message(f"{prompt.text} Press Enter when it is done; Ctrl-C ends this here")
    if not sys.stdin.readline():
        raise BenchError(f"standard input has ended without confirmation: {prompt.text}")


TIMES = {
    "stop_s": "Stop takes {s:.2f} s until the instrument reports rest",
    "level_stop_s": "Stop from a held level takes {s:.2f} s, because the rest of its burst can be played faster",
    "upload_s": "The longest waveform is uploaded in {s:.2f} s",
    "reply_s": "The slowest reply arrives {s:.2f} s after its message{slowest}, an upload's included",
    "start_s": "A drive begins {ms:.1f} ms after its trigger",
    "interlock_s": "High voltage is off {s:.2f} s after the last heartbeat of the interlock",
    "second_client_s": "A second connection is answered after {ms:.1f} ms",
}
"""Sentences on the measured times of a commissioning, by their names in its record."""


def _print_commissioning(record: Mapping[str, Any], path: Path) -> None:
    """Print one page: measured checks, assumptions, times, and where the record is."""
    console = Console(markup=False, highlight=False)
    styles = {OutputVerdict.PASS: "green", OutputVerdict.DIFFERS: "yellow", OutputVerdict.DANGEROUS: "bold red"}
    firmware = f", firmware {record['firmware']}" if record["firmware"] else ""
    who = f"{record['maker']} {record['model']} #{record['serial']}{firmware}"
    title = f"Commissioning of {who}: {record['verdict']}"
    checks = _table(title, "", "measured at the output", "figure", "limits", "unit", "worst")
    for check in record["checks"]:
        limits = [f"{limit:g}" for limit in (check["low"], check["high"]) if limit is not None]
        figure = "-" if check["value"] is None else f"{check['value']:.4g}"
        verdict = Text(check["verdict"], styles.get(check["verdict"], ""))
        checks.add_row(verdict, check["name"], figure, " to ".join(limits), check["unit"], check["detail"])
    console.print(checks)
    table = _table("Assumptions of the driver", "", "property", "value assumed")
    for each in record["assumptions"]:
        table.add_row(Text(each["verdict"], styles.get(each["verdict"], "")), each["property"], each["value"])
    console.print(table if record["assumptions"] else "There is no table of assumptions about this source.")
    for error in record["errors"]:
        print_message(error)
    slowest = "".join(f" ({each['command']})" for each in record["commands"][:1])
    for name, sentence in TIMES.items():
        if (time_s := record["times"].get(name)) is not None:
            console.print(sentence.format(s=time_s, ms=1e3 * time_s, slowest=slowest))
    exempt = ". The simulated bench needs no commissioning" if record["simulated"] else ""
    console.print(f"Record and traces: {path}{exempt}", soft_wrap=True)


@options
class DiscoveryOptions:
    """Options of the search for devices."""

    hosts: Sequence[str] = option(
        "also query an instrument on a LAN socket of this host (default ports 5025 and 5555), or a LabJack there; may be repeated",
        flag="--host",
        metavar="HOST[:PORT]",
    )
    server: str = option("NI's gRPC device server, for the card of another computer", metavar="HOST:PORT")


@command("example: tactor-bench devices --host 192.0.2.7 --server 192.0.2.8:31763")
class DevicesCommand(DiscoveryOptions):
    """List the connected devices: USB, VXI-11 and serial VISA resources, NI cards of this computer or of a gRPC server,
    serial ports. A raw LAN socket and a LabJack cannot be discovered, only queried: give the host.
    """

    json: bool = JSON_PLAIN

    def execute(self) -> int:
        devices, notes = find_devices(self.hosts, self.server)
        if self.json:
            print_json({"found": [asdict(one) for one in devices], "notes": notes})
            return ExitCode.DONE
        table = _table("Connected", "role", "address", "identity")
        for one in devices:
            table.add_row(one.role, one.where, one.identity)
        Console(markup=False, highlight=False).print(table if devices else "Nothing was found.")
        for note in notes:
            print_message(note)
        if any(one.role in INSTRUMENT_ROLES for one in devices):
            options = "".join(f" --host {host}" for host in self.hosts) + (
                f" --server {self.server}" * bool(self.server)
            )
            print_message(
                f"Next: tactor-bench bench new bench1.toml{options}, then tactor-bench commission --bench bench1.toml"
            )
        return ExitCode.DONE


@command("bench1.toml --host 192.0.2.7")
class NewBenchCommand(DiscoveryOptions):
    """Write a first, commented bench file with the devices that 'tactor-bench devices' lists; never overwrites a file."""

    file: Path = argument("bench file to write", metavar="FILE")

    def execute(self) -> int:
        if self.file.exists():  # before the search, which takes seconds
            raise UsageError(f"{self.file} is there already and is not overwritten; give another name")
        devices, notes = find_devices(self.hosts, self.server)
        try:
            with self.file.open("x", encoding="utf-8") as file:
                file.write(bench_template(devices, self.server))
        except FileExistsError:
            raise UsageError(f"{self.file} is there already and is not overwritten; give another name") from None
        except OSError as error:
            raise UsageError(f"{self.file} cannot be written: {error.strerror or error}") from None
        for note in notes:
            print_message(note)
        have = [f"{one.role} {one.identity}" for one in devices if one.role in INSTRUMENT_ROLES]
        print_message(
            f"{self.file}: {', '.join(have) or 'nothing was devices, the addresses are examples'}. Go through it"
        )
        print_message(f"Next: tactor-bench commission --bench {self.file}, with high voltage off")
        return ExitCode.DONE


@command("example: tactor-bench run sine-dwell --speed max --fault scpi-dropped@3")
class FaultsCommand:
    """List the faults of a simulated bench, for 'tactor-bench run ... --fault NAME@SECONDS'."""

    json: bool = JSON_PLAIN

    def execute(self) -> int:
        width = max(map(len, FAULT_DESCRIPTIONS))
        lines = (f"{name:{width}}  {text}" for name, text in FAULT_DESCRIPTIONS.items())
        return print_answer(FAULT_DESCRIPTIONS, lines, self.json)


VERBS = CommandGroup(
    "Bench files.", "example: tactor-bench bench new bench1.toml --host 192.0.2.7", {"new": NewBenchCommand}
)
