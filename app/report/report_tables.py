"""Texts and tables of a report, provenance included: held values, quality, instruments, software, hashes."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import reduce
from typing import Any

from app.common import Table, pluralize, sentence_case, typeset_unit
from app.identification import (
    BudgetBar,
    assumed_line,
    budget_bars,
    budget_record,
    compare_with_chain,
    contradictions,
    format_shares,
    held_parameters,
    mounting_tables,
    nonideality_tables,
    sheet_unit,
    short_run_name,
    steps_line,
    unstated_errors,
)
from app.plotting import PlotPanel, ReportPlot, StackedBar
from app.report.document import Block, LimitOutcome, Paragraph, Tone
from app.report.figures_of_merit import PerceptionMargin, SpecimenSummary
from app.report.plots import CurveAgreement, curve_agreements
from app.report.rounding import (
    MINUS,
    SPACE,
    typeset_measurement,
    typeset_number,
    typeset_probability,
    typeset_with_error,
)
from app.report.runs import ReportRun, run_label
from app.report.specimen import SpecimenModel
from model import QUANTITIES, Membrane, Tactor, format_time, quantity_label, shown_unit
from protocols.base import Outcome, RunStatus

EMPTY_CELL = "–"
BAR_HEIGHT_IN = 0.2
FAULTY_ENDS = (RunStatus.FAILED, RunStatus.UNSAFE)
MAX_FINDINGS = 10
"""Findings that are listed."""
TABLE_I = asdict(Tactor()) | asdict(Membrane())


def parameter_blocks(summary: SpecimenSummary, runs: Sequence[ReportRun]) -> Iterator[Block]:
    """Yield the result of the identification, the parameters by source, and what was left out and why."""
    specimen, labels = summary.specimen, {run.path.stem: run_label(run) for run in runs}
    yield from (replace(each, text=_relabelled(each.text, labels)) for each in _fit_blocks(specimen))
    if specimen.estimates:
        grid = parameter_grid(specimen)
        yield replace(grid, note=_relabelled(grid.note, labels))
        yield known_values(specimen)
    if specimen.identification is not None and not summary.perception_margins:
        yield Paragraph("No statement on threshold and latency: the free response is not determined by these runs.")
    yield from _run_blocks(runs)


def _relabelled(text: str, labels: Mapping[str, str]) -> str:
    """Return a text with the short names of runs in place of their files' names."""
    return reduce(lambda text, name: text.replace(name, labels[name]), labels, text)


def _fit_blocks(specimen: SpecimenModel) -> Iterator[Paragraph]:
    """Yield the result of the identification, its basis, and the parameters that it leaves open."""
    identification = specimen.identification
    if identification is None:
        yield Paragraph(f"Nothing is identified: {specimen.problem}.", "bad")
        return
    verdict = identification.verdict if identification.adequacy is None else identification.adequacy.message
    tone: Tone = "bad" if identification.adequacy is not None and identification.adequacy.adequate is False else "plain"
    count = pluralize(len(identification.observations.runs), "set")
    yield Paragraph(f"Joint fit of {count} of points: {_spell_out(verdict)}.", tone)
    if added := steps_line(identification, also="identify --also", plain="identify --plain"):
        yield Paragraph(sentence_case(added), "bad")
    yield from (Paragraph(f"{sentence_case(text)}.", "bad") for text in contradictions(identification))
    yield from (Paragraph(_unidentified_text(each), "bad") for each in identification.unidentified)
    yield from (Paragraph(f"{note}.") for note in identification.notes)


def _run_blocks(runs: Sequence[ReportRun]) -> Iterator[Block]:
    """Yield the runs that could not be read, are left out, have no result, or are doubtful."""
    yield from (Paragraph(f"{run.name}: {run.problem}.", "bad") for run in runs if run.problem)
    for run in runs:
        if run.exclusion_reason:
            yield Paragraph(f"{run.name} is left out of the identification: {run.exclusion_reason}.")
    for run in runs:
        if run.without_result and not run.exclusion_reason:
            yield Paragraph(f"{run.name} is not used: {run.summary.verdict}: {run.summary.explanation}.", "bad")
        elif not (run.problem or run.exclusion_reason or run.identifiable) and run.record.status in FAULTY_ENDS:
            yield Paragraph(f"{run.name} {run.record.status}: {run.record.reason}.", "bad")
    doubtful: dict[str, list[str]] = {}
    for run in runs:
        if run.summary.outcome is Outcome.DOUBTFUL and (run.exclusion_reason or not run.without_result):
            for reason in run.summary.record.verdict.reasons:
                doubtful.setdefault(reason.partition("; ")[0].partition(":")[0], []).append(run_label(run))
    if doubtful:
        yield Paragraph(
            f"Doubtful: {'; '.join(reason + ' in ' + ', '.join(names) for reason, names in doubtful.items())}."
        )


def _format_bands(margin: PerceptionMargin) -> str:
    ends = (
        " to ".join(map(typeset_with_error, band, errors)) + " Hz"
        for band, errors in zip(margin.felt_bands, margin.edge_errors, strict=True)
    )
    return " and ".join(ends) or "nowhere"


def parameter_grid(specimen: SpecimenModel) -> Table:
    """Return the table of estimates compared with the paper's Table I."""
    rows = []
    identification, fit = specimen.identification, specimen.joint_fit
    for e in () if identification is None else identification.identified:
        paper = TABLE_I.get(e.name)
        factor, unit = shown_unit(e.unit, e.name)
        paper_text = "" if paper is None else f"{typeset_number(factor * paper)} {typeset_unit(unit)}"
        rows.append(
            (
                f"{e.name}: {quantity_label(e.name)}",
                typeset_measurement(e.value, e.standard_error, e.unit, e.name),
                f"{paper_text} ({_percent(e.value / paper - 1)})" if paper else "",
                ", ".join(dict.fromkeys(map(short_run_name, e.source))),
            )
        )
    heads = (
        "fitted parameter",
        "value ± total",
        "paper's Table I (difference)",
        "determined by",
    )
    note = "Total standard uncertainty: scatter of the points (statistical), gains of the instruments, dimensions and masses."
    if fit is not None and fit.error_scale > 1:
        parts = (f"{m.error_scale:.2g} times the errors of {m.label}" for m in fit.residuals if m.error_scale > 1)
        note += f" Enlarged where the misfit is larger than the errors of the points: {', '.join(parts)}."
    return Table.of_rows("Parameters", heads, rows, note)


def known_values(specimen: SpecimenModel) -> Table:
    """Return the values that the runs do not determine, by source: sheet, Table I, assumed, held."""
    identification = specimen.identification
    entries, priors = specimen.sheet.values, {} if identification is None else identification.priors
    measured: dict[tuple[str, str], list[str]] = {}
    for e in entries.values():
        if e.name in priors:
            origin = ("specimen sheet" if e.measured else "paper's Table I", e.instrument)
            measured.setdefault(origin, []).append(f"{e.name} {_format_known(e.name, e.value, e.uncertainty)}")
    rows: dict[str, list[str]] = {}
    for (source, instrument), texts in measured.items():
        rows.setdefault(source, []).append(", ".join(texts) + (f" ({instrument})" if instrument else ""))
    if identification is not None:
        for source, text in (("assumed", assumed_line(identification)), ("held", held_parameters(identification))):
            if text:
                rows[source] = [sentence_case(text)]
    note = "Values with an uncertainty enter the fit with it, and are in the totals above."
    lines = [(sentence_case(source), "; ".join(texts)) for source, texts in rows.items()]
    return Table.of_rows("Known before", ("source", "values ± standard uncertainty"), lines, note)


def _format_known(name: str, value: float, uncertainty: float) -> str:
    factor, unit = sheet_unit(name)
    return f"{typeset_with_error(factor * value, factor * uncertainty)}{SPACE}{typeset_unit(unit).replace(' ', SPACE)}".rstrip()


def agreement_blocks(summary: SpecimenSummary, plots: Sequence[ReportPlot]) -> Iterator[Block]:
    """Yield tables of Pearson's r, p and R^2 for every curve, and of the misfit of each run."""
    identification = summary.specimen.identification
    note = (
        "The parameters were fitted to these same points (to fundamentals and phases, not to max - min): this is agreement, not "
        "prediction. r and p as the paper gives them; R² = 1 − residual sum of squares / sum of squares about the mean."
        if identification is not None
        else "Against the paper's Table I: nothing was fitted."
    )
    heads: tuple[str, ...] = ("curve", "points", "Pearson r", "p", "R²", "rms residual", "largest")
    rows: list[tuple[str, ...]] = [_agreement_row(each) for each in curve_agreements(plots)]
    yield Table.of_rows("Validation curves", heads, rows, note)
    if identification is None:
        return
    if identification.misfits:
        heads = ("points of", "residuals", "χ²", "p", "beyond 4 errors")
        rows = [
            (m.label, str(len(m.values)), f"{m.chi_square:.1f}", typeset_probability(m.p_value), str(len(m.outliers)))
            for m in identification.misfits
        ]
        note = (
            "χ² near the number of residuals: model and errors fit. A small p: the model, or the given errors, do not "
            "explain that run."
        )
        yield Table.of_rows("How well the errors explain each run", heads, rows, note)
    if differences := compare_with_chain(identification):
        rows = [(d.name, f"{100 * d.share:+.2g} %", f"{d.sigmas:+.2g}", d.reasons) for d in differences]
        heads = ("parameter", "chain against joint fit", "in total uncertainties", "left out by the chain, or held")
        note = "The steps of the paper on the same runs. It takes dimensions as exact and has no creep, hysteresis or share of the masses."
        yield Table.of_rows("The paper's chain beside the joint fit", heads, rows, note)
    if identification.adequacy is not None and (findings := identification.adequacy.findings):
        more = f" The first {MAX_FINDINGS} of {len(findings)}." if len(findings) > MAX_FINDINGS else ""
        rows = [(f.kind, _spell_out(f.text), typeset_probability(f.probability)) for f in findings[:MAX_FINDINGS]]
        note = f"Probability by chance: that any of all {identification.adequacy.test_count} tests deviates this much.{more}"
        heads = ("kind", "discrepancy", "by chance")
        yield Table.of_rows("Discrepancies between runs and model", heads, rows, note)


def _agreement_row(agreement: CurveAgreement) -> tuple[str, ...]:
    r, squared = (
        EMPTY_CELL if value is None else f"{value:.4f}".replace("-", MINUS)
        for value in (agreement.r, agreement.r_squared)
    )
    return (
        agreement.label,
        str(agreement.points),
        r,
        EMPTY_CELL if agreement.r is None else typeset_probability(agreement.p),
        squared,
        f"{agreement.rms:#.3g} {agreement.unit}",
        f"{agreement.largest:#.3g} {agreement.unit}",
    )


def perception_blocks(summary: SpecimenSummary) -> Iterator[Block]:
    """Yield tables of the margin over the threshold at every elongation, and of the latency."""
    rows = [
        (
            margin.condition,
            _format_bands(margin),
            typeset_with_error(margin.margin, margin.margin_error),
            f"{margin.frequency_hz:g} Hz",
            f"{1e6 * margin.band.centre.max():.0f} µm",
        )
        for margin in summary.perception_margins
    ]
    if rows:
        heads = ("specimen", "felt", "smallest margin", "at", "largest max - min")
        note = (
            "By the model as identified, at full drive, ± standard error. Margin: max - min over the threshold of perception, "
            f"{summary.perception_margins[0].threshold.description}; looked at from 5 to 250 Hz, where an end without an error is the "
            "end of that range."
        )
        yield Table.of_rows("Margin over the threshold", heads, rows, note)
    if (step := summary.latency) is not None:
        lines = [
            (QUANTITIES[merit.name].name, typeset_measurement(merit.value, merit.standard_error, "s"))
            for merit in (step.latency, step.rise_time)
            if merit is not None
        ]
        overshoot = f"{typeset_with_error(100 * step.overshoot, 100 * step.overshoot_error)} %"
        lines.append(("overshoot over the final value", overshoot))
        title = f"A step of {step.step_v:g} V, by the model"
        yield Table.of_rows(title, ("quantity", "value ± standard error"), lines)


def _percent(share: float) -> str:
    text = f"{100 * share:+.1f} %".replace("-", MINUS)
    return "0.0 %" if text[1:] == "0.0 %" else text


def _spell_out(text: str) -> str:
    return text.replace(" -", f" {MINUS}")


def _unidentified_text(text: str) -> str:
    names, _, shares = text.partition(" (")
    along = f": relative changes of {shares.removesuffix(')')} together leave every point where it is" if shares else ""
    return f"Not identifiable from these runs: {names}{_spell_out(along)}."


def uncertainty_blocks(specimen: SpecimenModel) -> Iterator[Block]:
    """Yield remarks of the sheet, effects outside the beam model, mountings, and the sources of every uncertainty."""
    identification, sheet = specimen.identification, specimen.sheet
    texts = {"serial number": sheet.serial, "batch": sheet.batch, "photograph": sheet.photograph, "notes": sheet.notes}
    remarks = [f"{name}: {text}" for name, text in (*texts.items(), *sheet.descriptions.items()) if text]
    yield Paragraph(f"{'. '.join([*remarks, sheet.description])}.")
    if identification is not None:
        for table in (*nonideality_tables(identification), *mounting_tables(identification)):
            yield replace(table, columns=tuple(column for column in table.columns if column.displayed))
        if unstated := unstated_errors(identification):
            yield Paragraph(f"Exact for want of a stated uncertainty: {', '.join(unstated)}.")
    yield from budget_blocks(specimen)


def budget_blocks(specimen: SpecimenModel, table: bool = True) -> Iterator[Block]:
    """Yield the shares of every uncertainty by source as bars, and as a table where asked or without bars."""
    identification = specimen.identification
    if identification is not None and (budget := identification.budget) is not None:
        if bars := budget_bars(identification):
            yield _budget_plot(bars)
        if not bars or table:
            shares = [(name, format_shares(budget, i)) for name, i in identification.budget_rows.items()]
            note = "Shares of the squared total; noise is the statistical part."
            yield Table.of_rows("Sources of the uncertainties", ("parameter", "shares"), shares, note)


def _budget_plot(bars: Sequence[BudgetBar]) -> ReportPlot:
    stacked = tuple(StackedBar(bar.name, bar.shares, bar.size_text) for bar in bars)
    panel = PlotPanel("", "share of the squared total", "", bars=stacked)
    caption = "Right: total standard uncertainty and its statistical part, of the value. Improve the longest piece first; gray: further sources."
    return ReportPlot("Uncertainty budget", (panel,), caption, row_height_in=0.5 + BAR_HEIGHT_IN * len(bars))


def quality_table(runs: Sequence[ReportRun]) -> Table:
    """Return the table of runs with their points and quality flags."""
    heads = ("run", "protocol", "begun (UTC)", "verdict", "kind", "points", "not usable", "flags")
    rows = [
        (
            run.name,
            run.summary.protocol,
            format_time(run.summary.start_time),
            run.summary.verdict_text,
            ", ".join(["simulated"] * run.summary.simulated + ["imported"] * run.imported),
            str(run.record.point_count),
            str(run.record.point_count - run.usable_count),
            format_flags(run.flag_counts),
        )
        for run in runs
    ]
    return Table.of_rows("Runs and the quality of their points", heads, rows)


def format_flags(counts: Mapping[str, int]) -> str:
    """Format the numbers of flagged points: `2 clipped, 1 noisy`."""
    return ", ".join(f"{count} {flag}" for flag, count in sorted(counts.items()))


def software_tables(runs: Sequence[ReportRun]) -> Iterator[Table]:
    """Yield the table of software versions, if there are any."""
    used = Counter(
        ", ".join(f"{name} {version}" for name, version in run.record.software.items())
        for run in runs
        if run.record.software
    )
    if used:
        rows = [(software, str(count)) for software, count in sorted(used.items())]
        yield Table.of_rows("Measured with", ("software", "runs"), rows)


def hash_table(runs: Sequence[ReportRun]) -> Table:
    """Return the table of run file hashes, by which later changes are detected."""
    rows = [(run.name, run.sha256 or "could not be read") for run in runs]
    return Table.of_rows("Run files", ("file", "SHA-256"), rows, monospace=True)


def report_record(
    specimen: str,
    summary: SpecimenSummary,
    runs: Sequence[ReportRun],
    outcomes: Sequence[LimitOutcome],
    fingerprint: str,
    software_version: str,
) -> dict[str, Any]:
    """Return the content of the report for JSON, SI."""
    identification = summary.specimen.identification
    return {
        "specimen": specimen,
        "simulated": any(run.summary.simulated for run in runs),
        "imported": any(run.imported for run in runs),
        "passed": all(o.verdict == "pass" for o in outcomes) if outcomes else None,
        "limits": [{k: v.replace(SPACE, " ") for k, v in asdict(o).items()} for o in outcomes],
        "parameters": [] if identification is None else [asdict(e) for e in identification.identified],
        "known": {} if identification is None else {name: list(pair) for name, pair in identification.priors.items()},
        "dimensions": summary.specimen.sheet.description,
        "budget": None if identification is None else budget_record(identification.budget),
        "unidentified": [] if identification is None else list(identification.unidentified),
        "merits": [
            {"name": name, "value": m.value, "standard_error": m.standard_error, "unit": m.unit, "source": m.source}
            for name, m in summary.figures_of_merit.items()
        ],
        "runs": [
            {
                "file": run.name,
                "points": run.record.point_count,
                "usable": run.usable_count,
                "verdict": run.summary.verdict,
                "verdict_reasons": run.summary.verdict_reasons,
                "sha256": run.sha256,
            }
            for run in runs
        ],
        "fingerprint": fingerprint,
        "code": software_version,
    }
