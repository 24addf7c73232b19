"""The command `runs`: the runs of a folder."""

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from app.archive import Catalogue, RunFilter, RunState, RunSummary, read_query, read_since
from app.cli.options import argument, command, option
from app.common import (
    SEVERITY_STYLES,
    ExitCode,
    UsageError,
    forget_results,
    format_bytes,
    format_duration,
    format_outcome,
    print_line,
    print_message,
    terminal_progress,
)
from protocols.base import Outcome, visible_text

DEFAULT_ROWS = 40
"""Runs that are listed without --all."""

EXPLAINED = (Outcome.DOUBTFUL, Outcome.NO_RESULT, Outcome.DID_NOT_PASS, Outcome.UNSAFE)
"""Verdicts whose reasons are printed below the list."""


def check_folder(folder: Path) -> None:
    """Raise UsageError if there is no folder of runs."""
    if not folder.is_dir():
        raise UsageError(f"there is no folder {folder}; name the folder of your runs")


@contextmanager
def scanned_catalogue(folder: Path, quiet: bool = False, rebuild: bool = False) -> Iterator[Catalogue]:
    """Bring the index of a folder of runs up to date, with a progress bar on a terminal, and yield its catalogue.

    Raises:
        UsageError: the index cannot be read or written, by this function or within the block.
    """
    catalogue = Catalogue(folder)
    try:
        if rebuild:
            catalogue.index.unlink(missing_ok=True)
            forget_results()
        with terminal_progress("reading runs", quiet) as progress:
            scanned = catalogue.scan(progress)
        for sentence in scanned.skipped:
            print_message(sentence)
        yield catalogue
    except OSError as error:
        raise UsageError(f"{error}; free space there or remove the file") from None


@command("example: tactor-bench runs --specimen T7 --since 7d --search 'good weights'")
class RunsCommand:
    """List the runs in a folder and below, newest first. An index in the user's cache speeds this up; the files are
    authoritative; moved, added or deleted files are detected.
    """

    folder: Path = argument("(default: runs)", Path("runs"), nargs="?")
    specimen: str = option("runs of this specimen")
    protocol: str = option("runs of this protocol, e.g. sine-dwell")
    status: str = option(
        "runs with this status: completed, imported, stopped, failed, unsafe, running, crashed, 'newer version' or damaged"
    )
    verdict: str = option(
        "runs with this verdict: good, doubtful, 'no result', 'did not pass', stopped, failed, unsafe or 'not judged'"
    )
    since: str = option("begun since 2026-11-21, 2026-11, today, 12h or 7d", metavar="WHEN")
    operator: str = option("runs of this operator", metavar="NAME")
    checked_by: str = option("runs checked by this second person; 'nobody': runs without check", metavar="NAME")
    instrument: str = option(
        "runs with this text in the identity of an instrument, e.g. a serial number", metavar="TEXT"
    )
    search: str = option(
        "runs with all these words (beginnings suffice) or fields: 'specimen:T2 verdict:good after:2026-10 sensor:LK'; those with "
        "the words in specimen or tags come first",
        metavar="WORDS",
    )
    all: bool = option("all of them, not only the newest 40")
    rebuild: bool = option("delete the index and all kept results, and read every file again")
    json: bool = option("one JSON list on standard output, SI units")

    def execute(self) -> int:
        check_folder(self.folder)
        run_filter = _run_filter(self)
        try:
            read_query(self.search)
        except ValueError as error:
            raise UsageError(f"--search: {error}") from None
        with scanned_catalogue(self.folder, self.json, self.rebuild) as catalogue:
            entries = catalogue.entries()
        summaries = run_filter.apply(entries)
        if self.json:
            print_line(json.dumps([_run_record(self.folder, entry) for entry in summaries]))
        else:
            _print_runs(summaries, len(entries), self.all)
        return ExitCode.DONE


def _run_filter(options: RunsCommand) -> RunFilter:
    try:
        since = read_since(options.since) if options.since else ""
    except ValueError:
        raise UsageError(
            f"--since {options.since}: write a day (2026-11-21), a month (2026-11), 'today', or how long ago (12h, 7d)"
        ) from None
    if options.status and options.status not in list(RunState):
        raise UsageError(f"there is no status '{options.status}'; there are: {', '.join(RunState)}")
    if options.verdict and options.verdict not in list(Outcome):
        raise UsageError(f"there is no verdict '{options.verdict}'; there are: {', '.join(Outcome)}")
    return RunFilter(
        options.search,
        options.specimen,
        options.protocol,
        options.status,
        since,
        options.verdict,
        options.operator,
        options.checked_by,
        options.instrument,
    )


def _print_runs(summaries: Sequence[RunSummary], total: int, show_all: bool) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2), header_style="bold")
    for heading in ("begun", "specimen", "protocol", "verdict", "points", "length", "size", "by", "tags", "file"):
        justify: Literal["left", "right"] = "right" if heading in ("points", "length", "size") else "left"
        table.add_column(heading, justify=justify, overflow="fold", no_wrap=heading == "begun")
    shown = summaries if show_all else summaries[:DEFAULT_ROWS]
    for e in shown:
        begun = f"{e.started_at:%Y-%m-%d %H:%M}" if e.started_at else ""
        verdict = Text(f"{e.symbol} {e.verdict_text}", SEVERITY_STYLES[e.severity])
        if e.simulated:
            verdict.append(", SIMULATED", "default")
        extent = (str(e.points), format_duration(e.seconds)) if e.readable else ("", "")
        people = f"{e.operator}, {e.checked_by} ✓" if e.checked_by else e.operator
        texts = map(visible_text, (e.specimen, e.protocol, people, e.tags, e.path))
        specimen, protocol, people, tags, path = texts
        table.add_row(begun, specimen, protocol, verdict, *extent, format_bytes(e.size), people, tags, path)
    out = Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 160)
    if shown:
        out.print(table)
    for e in shown:
        if not e.readable or e.outcome in EXPLAINED:
            line = f"{PurePosixPath(e.path).name}: {format_outcome(e.verdict_text, e.explanation)}"
            out.print(visible_text(line), soft_wrap=True)
    rest = len(summaries) - len(shown)
    more = f"; {rest} older ones with --all" if rest else ""
    out.print(f"{len(summaries)} of {total} runs{more}", soft_wrap=True)


def _run_record(folder: Path, summary: RunSummary) -> dict[str, Any]:
    """Return a run for JSON, SI units."""
    return {
        "path": str(folder / summary.path),
        "state": str(summary.state),
        "reason": summary.record.reason,
        "verdict": summary.verdict,
        "verdict_reasons": summary.verdict_reasons,
        "protocol": summary.protocol,
        "specimen": summary.specimen,
        "start_time": summary.start_time,
        "simulated": bool(summary.simulated),
        "points": summary.points,
        "duration_s": summary.seconds,
        "size_bytes": summary.size,
        "found": summary.estimates_text,
        "tags": [tag for tag in summary.tags.split(", ") if tag],
        "note": summary.note,
        "operator": summary.operator,
        "checked_by": [name for name in summary.checked_by.split(", ") if name],
        "temperature_c": summary.record.conditions.temperature_c,
        "humidity": summary.record.conditions.humidity,
        "bench": summary.record.bench_name,
        "instruments": summary.instruments,
    }
