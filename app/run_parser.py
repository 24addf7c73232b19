"""The parsers of `tactor-bench runs` and `tactor-bench export`. What they run is imported when it runs."""

import argparse
from pathlib import Path
from typing import Any

from app.arguments import path


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
    from app.run_commands import runs

    return runs(options)


def _export(options: argparse.Namespace) -> int:
    from app.run_commands import export_runs

    return export_runs(options)
