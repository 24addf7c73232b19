"""What `tactor-bench report` does."""

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from app.cli.output import check_file, say, writing
from app.common.errors import DONE, FAILED, UsageError
from app.plotting.run_figure import figure_of
from app.report.content import ReportError, gather
from app.report.document import Report
from app.report.html import Html
from app.report.limits import BESIDE, Limits, LimitsError, example, read_limits
from app.report.pdf import Pdf, laid_out
from app.report.runs import Taken, Told
from app.report.specimen import Specimen
from protocols.base.jsonable import plain
from protocols.runfile.reader import Run, RunError, intact
from protocols.runfile.schema import safe_name


def report(options: argparse.Namespace) -> int:
    """`tactor-bench report SPECIMEN`."""
    if options.new_limits is not None:
        return _new_limits(options.new_limits)
    if options.specimen is None:
        raise UsageError("a specimen is missing: 'tactor-bench report T7'; 'tactor-bench runs' lists them")
    if not options.folder.is_dir():
        raise UsageError(f"there is no folder {options.folder}; name the one your runs are in with --folder")
    out: Path = options.out
    try:
        limits = _limits(options)
        out.mkdir(parents=True, exist_ok=True)
        with _told() as told:
            content, specimen, runs = gather(options.folder, options.specimen, limits, told)
            files = write(content, specimen, runs, out, told)
    except (ReportError, LimitsError, RunError) as error:
        raise UsageError(str(error)) from None
    except OSError as error:
        raise UsageError(f"the report cannot be written to {out}: {error.strerror or error}") from None
    for path in files:
        sys.stderr.write(f"wrote {path}\n")
    if options.json:
        say(json.dumps(plain({**content.record, "files": [str(path) for path in files]}), allow_nan=False))
    for outcome in content.outcomes:
        if outcome.verdict != "pass":
            why = f" ({outcome.why})" if outcome.why else ""
            sys.stderr.write(f"{outcome.verdict}: {outcome.name} is {outcome.found}, asked {outcome.asked}{why}\n")
    return DONE if content.passed else FAILED


def write(
    content: Report, specimen: Specimen, runs: tuple[Taken, ...], out: Path, told: Told = lambda *_: None
) -> tuple[Path, Path]:
    """Write PDF and HTML; every run's picture is drawn once for both.

    Raises:
        OSError: one cannot be written. What stood there still does.
    """
    name = safe_name(content.specimen)
    files = out / f"{name}_report.pdf", out / f"{name}_report.html"
    shown = [run for run in runs if not run.trouble]
    told("writing", 0, len(shown) + 1)
    with Html(content, files[1]) as html, Pdf(content, files[0], len(shown)) as pdf:
        pdf.text()
        for i, each in enumerate(shown):
            told("writing", i + 1, len(shown) + 1)
            with Run(each.path) as run, intact(each.path):
                figure = laid_out(figure_of(run, specimen.tactor))
            html.picture(each.name, figure)
            pdf.picture(each.name, figure)
    return files


def _limits(options: argparse.Namespace) -> Limits | None:
    """The limits asked for, or those that lie beside the runs; None where there are none.

    Raises:
        LimitsError, UsageError: they are wrong, or compare with a golden unit that nobody named.
    """
    beside = options.folder / BESIDE
    path = options.limits or (beside if beside.exists() else None)
    if path is None:
        if options.golden:
            raise UsageError("--golden needs limits to compare by: 'tactor-bench report --new-limits limits.toml'")
        return None
    found = read_limits(path)
    if options.golden:
        found = replace(found, golden=options.golden)
    compared = [name for name, limit in found.limits.items() if limit.within_golden is not None]
    if compared and not found.golden:
        raise UsageError(
            f'{path} compares {", ".join(compared)} with a golden unit, but names none; write golden = "T0" there, or '
            "give --golden T0"
        )
    return found


def _new_limits(path: Path) -> int:
    if path.exists():
        raise UsageError(f"{path} is there already and is not overwritten; choose another name")
    check_file(path)
    with writing(path):
        path.write_text(example(), "utf-8")
    return DONE


@contextmanager
def _told() -> Iterator[Told]:
    """A bar on a terminal, nothing elsewhere."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as progress:
        bar = progress.add_task("", total=None)
        yield lambda words, done, of: progress.update(bar, description=words, completed=done, total=of)
