"""What `tactor-bench runs` and `tactor-bench export` do.

The parsers of `tactor-bench runs` and `tactor-bench export`. What they run is imported when it runs.
"""

import argparse
import json
import sqlite3
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from app.archive.catalogue import Catalogue
from app.archive.export import PARTS, ExportError, Part, export
from app.archive.run_summary import Entry, State, Wanted, read_since
from app.common.errors import DONE, FAILED, UsageError
from app.common.formatting import duration, size
from app.common.inputs import path
from app.common.progress import bar
from protocols.runfile.reader import Run, RunError

SOME = 40
"""Runs a person is shown without asking for more."""


def runs(options: argparse.Namespace) -> int:
    """`tactor-bench runs [FOLDER]`."""
    folder: Path = options.folder
    if not folder.is_dir():
        raise UsageError(f"there is no folder {folder}; name the one your runs are in: tactor-bench runs FOLDER")
    wanted = _wanted(options)
    catalogue = Catalogue(folder)
    try:
        if options.rebuild:
            catalogue.index.unlink(missing_ok=True)
        with bar("reading runs", options.json) as tell:
            scanned = catalogue.scan(told=lambda done, of: tell(done / max(of, 1)))
        entries = catalogue.entries()
    except (sqlite3.Error, OSError) as error:
        raise UsageError(
            f"the index {catalogue.index} cannot be used: {error}; make room there or take the file away"
        ) from None
    for sentence in scanned.skipped:
        sys.stderr.write(f"{sentence}\n")
    found = wanted.among(entries)
    if options.json:
        print(json.dumps([_record(folder, entry) for entry in found]))  # noqa: T201 - the command line speaks here
    else:
        _show(found, len(entries), options.all)
    return DONE


def export_runs(options: argparse.Namespace) -> int:
    """`tactor-bench export RUN...`."""
    parts: Sequence[Part] = tuple(p for p in PARTS if p in options.parts) if options.parts else PARTS
    unknown = [p for p in options.parts if p not in PARTS]
    if unknown:
        raise UsageError(f"a run has no part '{unknown[0]}'; its parts are: {', '.join(PARTS)}")
    failed = False
    for run_path in options.runs:
        try:
            with Run(run_path) as run, bar(run_path.name) as tell:
                written = export(
                    run,
                    options.out or run_path.parent,
                    options.format,
                    parts,
                    told=tell,
                )
        except (RunError, ExportError) as error:
            failed = True
            sys.stderr.write(f"{error}\n")
            continue
        except (OSError, KeyError, ValueError, RuntimeError) as error:
            failed = True
            sys.stderr.write(f"{run_path} is damaged inside and is skipped: {error}\n")
            continue
        for file in written:
            print(file)  # noqa: T201
    return FAILED if failed else DONE


def _wanted(options: argparse.Namespace) -> Wanted:
    try:
        since = read_since(options.since) if options.since else ""
    except ValueError:
        raise UsageError(
            f"--since {options.since}: write a day (2026-11-21), a month (2026-11), 'today', or how long ago (12h, 7d)"
        ) from None
    if options.status and options.status not in list(State):
        raise UsageError(f"there is no status '{options.status}'; there are: {', '.join(State)}")
    return Wanted(options.search or "", options.specimen or "", options.protocol or "", options.status or "", since)


def _show(found: Sequence[Entry], known: int, everything: bool) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, padding=(0, 2), header_style="bold")
    heads = ("begun", "specimen", "protocol", "status", "points", "length", "size", "tags", "file")
    for head in heads:
        numbers = head in ("points", "length", "size")
        table.add_column(head, justify="right" if numbers else "left", overflow="fold", no_wrap=head == "begun")
    shown = found if everything else found[:SOME]
    for e in shown:
        begun = e.begun
        status = f"{e.state}, SIMULATED" if e.simulated else e.state
        facts = (str(e.points), duration(e.seconds), size(e.size)) if e.readable else ("", "", size(e.size))
        table.add_row(
            f"{begun:%Y-%m-%d %H:%M}" if begun else "", e.specimen, e.protocol, status, *facts, e.tags, e.path
        )
    out = Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 160)
    if shown:
        out.print(table)
    for e in shown:
        if not e.readable:
            out.print(f"{e.state}: {e.reason}", soft_wrap=True)
    rest = len(found) - len(shown)
    more = f"; {rest} older ones with --all" if rest else ""
    out.print(f"{len(found)} of {known} runs{more}", soft_wrap=True)


def _record(folder: Path, e: Entry) -> dict[str, Any]:
    """An entry for a machine, SI units."""
    return {
        "path": str(folder / e.path),
        "state": str(e.state),
        "reason": e.reason,
        "protocol": e.protocol,
        "specimen": e.specimen,
        "start_time": e.start_time,
        "simulated": bool(e.simulated),
        "points": e.points,
        "duration_s": e.seconds,
        "size_bytes": e.size,
        "found": e.found,
        "tags": [tag for tag in e.tags.split(", ") if tag],
        "note": e.note,
    }


def add_run_commands(known: Any) -> None:
    """Register the commands with the subparsers of the command."""
    runs = known.add_parser(
        "runs",
        help="list the runs of a folder; find some by specimen, protocol, date, status or words",
        description="The runs in a folder and below, newest first. An index in the user's cache makes it quick; the files "
        "are what counts, and what was moved, added or deleted is noticed.",
        epilog="example: tactor-bench runs --specimen T7 --since 7d --search 'good weights'",
    )
    runs.add_argument("folder", nargs="?", type=path, default=Path("runs"), help="(default: runs)")
    runs.add_argument("--specimen", help="runs of this specimen")
    runs.add_argument("--protocol", help="runs of this protocol, e.g. sine-dwell")
    runs.add_argument(
        "--status", help="completed, imported, stopped, failed, unsafe, running, crashed, 'newer version' or damaged"
    )
    runs.add_argument("--since", metavar="WHEN", help="begun since 2026-11-21, 2026-11, today, 12h or 7d")
    runs.add_argument("--search", metavar="WORDS", help="all these words, in names, reasons, results, tags or notes")
    runs.add_argument("--all", action="store_true", help="all of them, not only the newest 40")
    runs.add_argument("--rebuild", action="store_true", help="throw the index away and read every file again")
    runs.add_argument("--json", action="store_true", help="one JSON list on standard output, SI units")
    runs.set_defaults(command=_runs)

    export = known.add_parser(
        "export",
        help="a run as CSV, JSON or MAT files",
        description="Points, estimates, events and raw samples with their times, SI units in every header. What comes "
        "from a simulated bench has SIMULATED in its name.",
        epilog="example: tactor-bench export runs/20261121T091502Z_T7_sine-dwell.h5 --format csv --out sheets",
    )
    export.add_argument("runs", nargs="+", type=path, metavar="RUN", help="run files")
    export.add_argument("--format", choices=("csv", "json", "mat"), default="csv", help="(default: csv)")
    export.add_argument(
        "--out", type=path, default=None, metavar="FOLDER", help="where the files go (default: beside the run)"
    )
    export.add_argument(
        "--part",
        dest="parts",
        action="append",
        default=[],
        metavar="PART",
        help="only this part: about, points, estimates, events or raw; may be given often (default: all)",
    )
    export.set_defaults(command=_export)


def _runs(options: argparse.Namespace) -> int:

    return runs(options)


def _export(options: argparse.Namespace) -> int:

    return export_runs(options)
