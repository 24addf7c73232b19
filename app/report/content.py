"""What stands in the report of a specimen, computed once from its run files: nothing in it tells when it was made."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from app.common.formatting import counted
from app.common.version import version
from app.report import provenance as origins
from app.report import tables
from app.report.document import Block, Outcome, Plot, Report, Section, Words
from app.report.figures_of_merit import Merit
from app.report.limits import Limits, judge
from app.report.plots import TITLE, plots_of
from app.report.runs import Taken, Told, take
from app.report.specimen import Specimen
from app.report.summary import Known, known_of


class ReportError(Exception):
    """There is nothing to report. The sentence says why and what to do."""


def gather(
    folder: Path, specimen: str, limits: Limits | None = None, told: Told = lambda *_: None
) -> tuple[Report, Specimen, tuple[Taken, ...]]:
    """The report of a specimen from all its runs in a folder and below; with what its pictures need.

    Raises:
        ReportError: there is no run of it, or of the golden unit.
        OSError: the folder cannot be looked into.
    """
    runs = _runs(folder, specimen, told)
    known = known_of(specimen, runs, told)
    outcomes: tuple[Outcome, ...] = ()
    if limits is not None:
        golden: Mapping[str, Merit] = {}
        if limits.golden == specimen:
            golden = known.merits
        elif limits.golden:
            golden = known_of(limits.golden, _runs(folder, limits.golden, told), told).merits
        outcomes = judge(limits, known.merits, golden)
    told("figures", 0, 1)
    drawn = plots_of(known.specimen, known.campaign) if known.campaign is not None else []
    fingerprint = hashlib.sha256("".join(sorted(run.sha256 for run in runs)).encode()).hexdigest()[:16]
    code = f"tactor-bench {version()}"
    report = Report(
        specimen=specimen,
        subtitle=_subtitle(runs),
        marks=marks(runs),
        first=tuple(_first(known, runs, limits, outcomes, drawn)),
        appendix=tuple(_appendix(known, runs, drawn)),
        outcomes=outcomes,
        fingerprint=fingerprint,
        code=code,
        record=origins.record(specimen, known, runs, outcomes, fingerprint, code),
    )
    return report, known.specimen, runs


def marks(runs: tuple[Taken, ...]) -> tuple[str, ...]:
    """What every page has to say about where the numbers come from."""
    counting = [run for run in runs if run.observations and not run.left_out] or [r for r in runs if not r.trouble]
    found = []
    for word, which in (("SIMULATED", [r.simulated for r in counting]), ("IMPORTED", [r.imported for r in counting])):
        if any(which):
            found.append(word if all(which) else f"{word} IN PART")
    return tuple(found)


def _runs(folder: Path, specimen: str, told: Told) -> tuple[Taken, ...]:
    runs = take(folder, specimen, told)
    if not runs:
        raise ReportError(
            f"there is no run of specimen '{specimen}' in {folder}; 'tactor-bench runs' lists what is there"
        )
    return runs


def _subtitle(runs: tuple[Taken, ...]) -> str:
    days = sorted(run.start_time[:16].replace("T", " ") for run in runs if run.start_time)
    when = f", {days[0]} to {days[-1]} UTC" if len(set(days)) > 1 else f", {days[0]} UTC" if days else ""
    return f"{counted(len(runs), 'run')}{when}"


def _first(
    known: Known, runs: tuple[Taken, ...], limits: Limits | None, outcomes: tuple[Outcome, ...], drawn: list[Plot]
) -> list[Block]:
    blocks: list[Block] = []
    if limits is not None:
        blocks += tables.verdict(limits, outcomes)
    blocks += tables.sentences(known, runs)
    if known.specimen.found is not None and known.specimen.found.estimates:
        blocks.append(tables.parameters(known.specimen))
    if known.campaign is not None:
        if panels := [panel for plot in drawn if plot.title == TITLE for panel in plot.panels]:
            caption = "Below: measured less model. Bars and band: 95 %. Hollow: flagged. Every figure of the paper from this specimen: appendix."
            first = replace(panels[0], title=panels[0].title.removeprefix("(a) "))
            blocks.append(Plot("Frequency response", (first,), caption, inches=3.0))
        elif drawn:
            blocks.append(drawn[0])
    return blocks


def _appendix(known: Known, runs: tuple[Taken, ...], drawn: list[Plot]) -> list[Section]:
    sections = []
    if drawn:
        note: tuple[Words, ...] = ()
        if known.specimen.found is None:
            note = (Words(f"Nothing was identified ({known.specimen.why_not}): the lines are the paper's tactor."),)
        sections.append(Section("The paper's figures from this specimen", (*note, *drawn)))
        sections.append(Section("How well the model tells the points", tuple(tables.agreement(known, drawn))))
    if known.felt or known.quick is not None:
        sections.append(Section("What is felt, and how soon", tuple(tables.perception(known))))
    sections.append(
        Section(
            "Where the numbers come from",
            (
                *origins.held(known.specimen),
                origins.quality(runs),
                origins.instruments(runs),
                *origins.software(runs),
                origins.hashes(runs),
            ),
        )
    )
    return sections
