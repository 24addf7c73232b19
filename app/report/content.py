"""Content of the report of a specimen, computed from its run files; reproducible, without the date of its creation."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from app.archive import Catalogue
from app.common import NO_PROGRESS, AuditEntry, AuditError, Progress, read_entries
from app.config import LABORATORY_FILE_NAME, Laboratory
from app.identification import SpecimenSheet, load_sheet
from app.plotting import RESIDUALS_NOTE, PlotPanel, ReportPlot
from app.report import report_tables
from app.report.document import Block, LimitOutcome, Paragraph, Report, ReportSection
from app.report.figures_of_merit import SpecimenSummary, summarize_specimen
from app.report.first_page import fleet_summary, identity_blocks, key_figure_table, operators_text, verdict_paragraph
from app.report.limits import Limits, judge_limits
from app.report.plots import TITLE, response_figure, specimen_plots
from app.report.result_cards import result_cards, result_tables
from app.report.runs import ReportRun, read_report_runs
from app.report.specimen import SpecimenModel, with_damping_by_elongation
from drivers import open_regular
from drivers.watchdog import version
from model import format_time
from model.identification import ObservationSet
from model.response import ABDOMEN_THRESHOLD, PerceptionThreshold
from model.studies import PaperFigure, skin_figures

SectionContents = Mapping[str, tuple[str, Callable[[], Iterable[Block]]]]
"""Title of each section by its name, and the function that makes its blocks."""

LINE_STYLES = ("-", "--", "-.", ":", (0, (1, 3)))
SKIN_TITLES = {"fig10": "Young modulus E_m", "fig11": "skin damping c_s", "fig12": "pre-stretch δ"}
SHORT_SECTIONS = ("parameters", "uncertainties", "skin")
"""Sections behind the first page."""
FULL_SECTIONS = ("parameters", "figures", "agreement", "perception", "results", "provenance")
"""Sections of a full report, where they have something."""


MAX_PHOTOGRAPH_BYTES = 10_000_000


FLEET = "fleet"
"""Name of the report of many specimens."""


class ReportError(Exception):
    """There is nothing to report; the message gives reason and remedy."""


def build_report(
    folder: Path,
    specimen: str,
    limits: Limits | None = None,
    progress: Progress = NO_PROGRESS,
    threshold: PerceptionThreshold = ABDOMEN_THRESHOLD,
    full: bool = True,
    laboratory: Laboratory | None = None,
) -> tuple[Report, SpecimenModel, tuple[ReportRun, ...]]:
    """Build the report of a specimen from all its runs in a folder and below; return also model and runs for its pictures.

    It is two pages long, or `full`, with all its evidence in an appendix. The laboratory's own sections, order, header and footer
    are added; the first page is always the page to sign.

    Raises:
        ReportError: there is no run of the specimen, or of the golden unit; or the laboratory names a section that does not exist.
        SheetError: a specimen sheet is invalid.
        OSError: the folder cannot be read.
    """
    laboratory = laboratory or Laboratory()
    names = _section_names(laboratory, full)
    runs = _read_specimen_runs(folder, specimen, progress, limits.golden if limits else "")
    summary = summarize_specimen(
        specimen, runs, progress, load_sheet(folder, specimen), threshold, every_margin="perception" in names
    )
    whole = bool({"figures", "agreement", "provenance"} & set(names))
    if whole:
        summary = replace(summary, specimen=with_damping_by_elongation(summary.specimen))
    outcomes: tuple[LimitOutcome, ...] = ()
    if limits is not None:
        golden = summary.figures_of_merit if limits.golden == specimen else {}
        if limits.golden not in ("", specimen):
            golden_runs = _read_specimen_runs(folder, limits.golden, progress)
            golden = summarize_specimen(
                limits.golden, golden_runs, progress, load_sheet(folder, limits.golden), threshold, False
            ).figures_of_merit
        outcomes = judge_limits(limits, summary.figures_of_merit, golden)
    progress.update(0.0, "figures")
    drawn = _plots(summary.specimen, summary.observations, runs, threshold, whole)
    photograph = _read_photograph(folder, summary.specimen.sheet)
    fingerprint = hashlib.sha256("".join(sorted(run.sha256 for run in runs)).encode()).hexdigest()[:16]
    code = f"tactor-bench {version()}"
    report = Report(
        specimen=specimen,
        page_marks=page_marks(runs),
        first_page=tuple(_first_page(summary, runs, limits, outcomes, drawn, threshold, photograph)),
        appendix=tuple(_sections(names, laboratory, _contents(folder, summary, runs, drawn))),
        limit_outcomes=outcomes,
        fingerprint=fingerprint,
        software_version=code,
        laboratory=laboratory,
        measured_by=operators_text(runs),
        record=report_tables.report_record(specimen, summary, runs, outcomes, fingerprint, code),
    )
    return report, summary.specimen, runs


def specimen_names(folder: Path, progress: Progress = NO_PROGRESS) -> tuple[str, ...]:
    """Return the specimens with a run in a folder and below, in order.

    Raises:
        ReportError: there are none.
        OSError: the folder cannot be read.
    """
    catalogue = Catalogue(folder)
    catalogue.scan(progress)
    if names := sorted({each.specimen for each in catalogue.entries() if each.specimen}):
        return tuple(names)
    raise ReportError(f"there is no run in {folder}; 'tactor-bench run' measures one")


def build_fleet_report(reports: Sequence[Report], laboratory: Laboratory | None = None) -> Report:
    """Return one report of many specimens: a summary, and the first page of each as its own page."""
    marks = dict.fromkeys(mark for each in reports for mark in each.page_marks)
    return Report(
        specimen=FLEET,
        page_marks=tuple(marks),
        first_page=(fleet_summary(reports),),
        appendix=tuple(ReportSection(f"Specimen {each.specimen}", each.first_page, own_page=True) for each in reports),
        limit_outcomes=tuple(outcome for each in reports for outcome in each.limit_outcomes),
        fingerprint=hashlib.sha256("".join(each.fingerprint for each in reports).encode()).hexdigest()[:16],
        software_version=reports[0].software_version,
        laboratory=laboratory or Laboratory(),
        measured_by=", ".join(dict.fromkeys(name for each in reports for name in each.measured_by.split(", ") if name)),
        record={"specimens": [each.record for each in reports]},
    )


def _plots(
    specimen: SpecimenModel,
    observations: ObservationSet | None,
    runs: Sequence[ReportRun],
    threshold: PerceptionThreshold,
    whole: bool,
) -> list[ReportPlot]:
    """Return the plots of a report: without a section of plots only the plot of the first page, as each needs a band."""
    first = None if whole or observations is None else response_figure(specimen, observations, threshold, 1)
    return specimen_plots(specimen, observations, runs, threshold) if first is None else [first]


def _read_photograph(folder: Path, sheet: SpecimenSheet) -> bytes:
    """Return the picture that a sheet names, beside it; nothing without one, or where it is no PNG or JPEG of usual size."""
    if not sheet.photograph:
        return b""
    with suppress(OSError, ValueError), open_regular(folder / Path(sheet.photograph).name) as file:
        data: bytes = file.read(MAX_PHOTOGRAPH_BYTES + 1)
        if data.startswith((b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")) and len(data) <= MAX_PHOTOGRAPH_BYTES:
            return data
    return b""


def page_marks(runs: tuple[ReportRun, ...]) -> tuple[str, ...]:
    """Return the marks of every page: SIMULATED, IMPORTED."""
    counting = [run for run in runs if run.identifiable] or [run for run in runs if not run.problem]
    origins_of_runs = {
        "SIMULATED": [bool(run.summary.simulated) for run in counting],
        "IMPORTED": [run.imported for run in counting],
    }
    return tuple(mark if all(marked) else f"{mark} IN PART" for mark, marked in origins_of_runs.items() if any(marked))


def _read_specimen_runs(folder: Path, specimen: str, progress: Progress, golden: str = "") -> tuple[ReportRun, ...]:
    runs = read_report_runs(folder, specimen, progress, golden)
    if not runs:
        raise ReportError(
            f"there is no run of specimen '{specimen}' in {folder}; 'tactor-bench runs' lists what is there"
        )
    return runs


def _first_page(
    summary: SpecimenSummary,
    runs: tuple[ReportRun, ...],
    limits: Limits | None,
    outcomes: tuple[LimitOutcome, ...],
    plots: list[ReportPlot],
    threshold: PerceptionThreshold,
    photograph: bytes,
) -> Iterator[Block]:
    yield verdict_paragraph(limits, outcomes)
    yield from identity_blocks(summary.specimen.sheet, runs, photograph)
    yield key_figure_table(summary, runs, limits, outcomes)
    if panels := [panel for plot in plots if plot.title == TITLE for panel in plot.panels]:
        felt = threshold.marked_label if threshold == ABDOMEN_THRESHOLD else threshold.description
        caption = f"{RESIDUALS_NOTE}Bars, band: 95 %. Hollow: flagged. Dashed: felt, {felt}. Shaded: uncomfortable."
        first = replace(panels[0], title=panels[0].title.removeprefix("(a) "))
        yield ReportPlot("Frequency response", (first,), caption, row_height_in=3.0)
    elif plots:
        yield plots[0]


def _section_names(laboratory: Laboratory, full: bool) -> tuple[str, ...]:
    """Return the names of the sections behind the first page, in order.

    Raises:
        ReportError: one does not exist.
    """
    names = dict.fromkeys((*SHORT_SECTIONS, *FULL_SECTIONS))
    if taken := [name for name in laboratory.texts if name in names]:
        raise ReportError(f"[report.texts.{taken[0]}] of {LABORATORY_FILE_NAME} has the name of a section: rename it")
    for name in laboratory.sections:
        if name not in (*names, *laboratory.texts):
            raise ReportError(
                f"{LABORATORY_FILE_NAME} asks for the section '{name}'; there are {', '.join((*names, *laboratory.texts))}"
            )
    usual = (*(FULL_SECTIONS if full else SHORT_SECTIONS), *laboratory.texts)
    if not laboratory.sections:
        return usual
    own = laboratory.sections if "parameters" in laboratory.sections else ("parameters", *laboratory.sections)
    return tuple(dict.fromkeys((*own, *usual) if full else own))


def _sections(names: Sequence[str], laboratory: Laboratory, contents: SectionContents) -> Iterator[ReportSection]:
    for name in names:
        if name in laboratory.texts:
            title, text = laboratory.texts[name]
            yield ReportSection(title, [Paragraph(line) for line in text.splitlines() if line.strip()])
        elif blocks := [*contents[name][1]()]:
            yield ReportSection(contents[name][0], blocks)


def _contents(
    folder: Path, summary: SpecimenSummary, runs: tuple[ReportRun, ...], plots: list[ReportPlot]
) -> SectionContents:
    """Return title and blocks of the sections by name; a section without blocks is left out."""

    def agreement() -> Iterator[Block]:
        if plots:
            yield from report_tables.agreement_blocks(summary, plots)

    return {
        "parameters": ("Parameters and their source", lambda: report_tables.parameter_blocks(summary, runs)),
        "skin": ("On skin", lambda: _skin_blocks(summary)),
        "uncertainties": ("What limits the uncertainties", lambda: _budget_blocks(folder, summary)),
        "figures": ("The paper's figures from this specimen", lambda: _figure_blocks(summary, plots)),
        "agreement": ("How well the model explains the points", agreement),
        "perception": (
            "Perceived amplitude and latency",
            lambda: (*report_tables.perception_blocks(summary), *result_tables(runs, "perception")),
        ),
        "results": ("Result of every run", lambda: (*result_cards(runs), *result_tables(runs, "results"))),
        "provenance": ("Where the numbers come from", lambda: _provenance_blocks(folder, summary, runs)),
    }


def _skin_blocks(summary: SpecimenSummary) -> Iterator[Block]:
    """Yield the effect of the skin on the response."""
    figures = skin_figures(summary.specimen.specimen)
    yield ReportPlot(
        "Response on skin by the model with this specimen's parameters (the paper's Figs. 10 to 12)",
        tuple(_study_panel(figure) for figure in figures),
        "Computed, not measured, as in the paper's Figs. 10 to 12: twice the fundamental of the centre under the full drive.",
        columns=3,
        row_height_in=2.4,
    )


def _budget_blocks(folder: Path, summary: SpecimenSummary) -> Iterator[Block]:
    """Yield the sources of the uncertainties, and the place of everything else."""
    yield from report_tables.budget_blocks(summary.specimen, table=False)
    yield from audit_blocks(folder)


def _figure_blocks(summary: SpecimenSummary, plots: list[ReportPlot]) -> Iterator[Block]:
    if plots and summary.specimen.identification is None:
        problem = summary.specimen.problem
        yield Paragraph(f"Nothing was identified ({problem}): the lines are the paper's tactor.")
    yield from plots


def _provenance_blocks(folder: Path, summary: SpecimenSummary, runs: tuple[ReportRun, ...]) -> Iterator[Block]:
    yield from report_tables.uncertainty_blocks(summary.specimen)
    yield report_tables.quality_table(runs)
    yield from report_tables.software_tables(runs)
    yield report_tables.hash_table(runs)
    yield from audit_blocks(folder)


def _study_panel(figure: PaperFigure) -> PlotPanel:
    lines = tuple(curve.scaled(1.0, 1e6) for curve in figure.curves)
    title = f"{figure.name.replace('fig', 'Fig. ')}: {SKIN_TITLES[figure.name]}"
    return PlotPanel(title, "frequency (Hz)", "displacement (µm)", lines, styles=LINE_STYLES, own_legend=True)


def audit_blocks(folder: Path) -> Iterator[Block]:
    """Yield the head of the folder's audit trail, which proves the entries up to it; nothing without a trail."""
    entries: list[AuditEntry] = []
    with suppress(AuditError):
        entries, _ = read_entries(folder)
    if entries:
        text = f"Audit trail: {len(entries)} entries, the last of {format_time(entries[-1].time, seconds=True)} UTC with the hash {entries[-1].hash}. "
        yield Paragraph(f"{text}'tactor-bench audit verify --head' with this hash detects any change before it.")
