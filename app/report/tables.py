"""Texts and tables of a report."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict

from app.campaign import PAPER_ITEMS
from app.common import Table, display_unit, pluralize
from app.plotting.panels import ReportPlot
from app.report.document import Block, LimitOutcome, Paragraph, Tone
from app.report.figures_of_merit import FIGURES_OF_MERIT, PerceptionMargin
from app.report.limits import Limits
from app.report.plots import CurveAgreement, curve_agreements
from app.report.rounding import (
    MINUS,
    typeset_measurement,
    typeset_number,
    typeset_probability,
    typeset_unit,
    typeset_with_error,
)
from app.report.runs import ReportRun
from app.report.specimen import SpecimenModel, parameter_description
from app.report.summary import SpecimenSummary
from model import Membrane, Tactor
from model.response import THRESHOLD_M

EMPTY_CELL = "–"
MAX_FINDINGS = 10
"""Findings that are listed."""
ITEM_NAMES = {item.protocol: item.name for item in PAPER_ITEMS}
"""Names of protocols in a campaign, which are shorter."""
TABLE_I = asdict(Tactor()) | asdict(Membrane())


def verdict_blocks(limits: Limits, outcomes: Sequence[LimitOutcome]) -> list[Block]:
    """Return the overall verdict and the table of limits."""
    missed = [o for o in outcomes if o.verdict != "pass"]
    words = f"PASS: all {len(outcomes)} limits are met." if len(outcomes) > 1 else "PASS: the limit is met."
    if missed:
        counts: Counter[str] = Counter(o.verdict for o in outcomes)
        labels = (("pass", "met"), ("fail", "not met"), ("cannot tell", "cannot be told"))
        parts = [f"{counts[verdict]} {says}" for verdict, says in labels if counts[verdict]]
        words = f"NOT PASSED: of {pluralize(len(outcomes), 'limit')} {', '.join(parts)}."
    rule = "the whole 95 % interval" if limits.rule == "guarded" else "the value alone"
    rows = tuple((o.name.replace("_", " "), o.asked, o.found, o.verdict, o.why) for o in outcomes)
    bad = frozenset(i for i, o in enumerate(outcomes) if o.verdict != "pass")
    note = f"Limits from {limits.source}; {rule} must lie within."
    return [
        Paragraph(words, "bad" if missed else "good"),
        Table.of_rows("Limits", ("what", "asked", "found ± standard error", "verdict", "why"), rows, note, bad),
    ]


def summary_blocks(summary: SpecimenSummary, runs: Sequence[ReportRun]) -> list[Block]:
    """Return the summary paragraphs of the first page."""
    found = summary.specimen.identification
    words: list[Paragraph] = []
    if found is None:
        words.append(Paragraph(f"Nothing is identified: {summary.specimen.problem}.", "bad"))
    else:
        verdict = found.verdict if found.adequacy is None else found.adequacy.message
        tone: Tone = "bad" if found.adequacy is not None and found.adequacy.adequate is False else "plain"
        words.append(
            Paragraph(
                f"Joint fit of {pluralize(len(found.observations.runs), 'set')} of points: {_spell_out(verdict)}.", tone
            )
        )
        words += [Paragraph(_unidentified_text(each), "bad") for each in found.unidentified]
        words += [Paragraph(f"{note}.") for note in found.notes]
    if summary.perception_margins:
        words.append(Paragraph(_margin_text(summary.perception_margins)))
    elif found is not None:
        words.append(
            Paragraph("No statement on threshold and latency: these runs do not tell the free response whole.")
        )
    if (quick := summary.latency) is not None and (felt_after := quick.latency) is not None:
        words.append(
            Paragraph(
                f"A step of {quick.step_v:g} V is felt after {typeset_measurement(felt_after.value, felt_after.standard_error, 's')} "
                "(model, ± standard error; the amplifier's own slew is not in it)."
            )
        )
    words.append(Paragraph(_quality_text(runs)))
    if late := [run for run in runs if run.expired]:
        words.append(
            Paragraph(
                f"In {pluralize(len(late), 'run')} the calibration of an instrument had expired: see the instruments, appendix.",
                "bad",
            )
        )
    words += [Paragraph(f"{run.name}: {run.problem}.", "bad") for run in runs if run.problem]
    words += [
        Paragraph(f"{run.name} is left out of the identification: {run.exclusion_reason}.")
        for run in runs
        if run.exclusion_reason
    ]
    return list(words)


def _margin_text(margins: Sequence[PerceptionMargin]) -> str:
    free, *pressed = margins
    text = f"At full drive, free, max - min is {_format_margin(free)} the threshold of {1e6 * THRESHOLD_M:g} µm"
    if pressed:
        text += f"; {pressed[-1].condition} {_format_margin(pressed[-1])} it"
    return f"{text} (model, 5 to 250 Hz, ± standard error)."


def _format_margin(margin: PerceptionMargin) -> str:
    if margin.margin >= 1:
        return (
            f"at least {typeset_with_error(margin.margin, margin.margin_error)} times (at {margin.frequency_hz:g} Hz)"
        )
    if not margin.felt_bands:
        return f"nowhere above, at least {typeset_with_error(margin.margin, margin.margin_error)} times"
    return f"above only {_format_bands(margin)}, at least {typeset_with_error(margin.margin, margin.margin_error)} times (at {margin.frequency_hz:g} Hz)"


def _format_bands(margin: PerceptionMargin) -> str:
    ends = (
        " to ".join(typeset_with_error(value, error) for value, error in zip(band, errors, strict=True)) + " Hz"
        for band, errors in zip(margin.felt_bands, margin.edge_errors, strict=True)
    )
    return " and ".join(ends) or "nowhere"


def _quality_text(runs: Sequence[ReportRun]) -> str:
    points, usable = sum(run.point_count for run in runs), sum(run.usable_count for run in runs)
    flags: Counter[str] = Counter()
    for run in runs:
        flags.update(run.flag_counts)
    why = ", ".join(f"{count} {flag}" for flag, count in sorted(flags.items()))
    unusable = f"{points - usable} are not usable" if points != usable else "all are usable"
    text = f"{pluralize(points, 'point')} in {pluralize(len(runs), 'run')}; {unusable}" + (f" ({why})" if why else "")
    return text + "."


def parameter_grid(specimen: SpecimenModel) -> Table:
    """Return the table of estimates beside the paper's Table I."""
    assert specimen.identification is not None
    rows = []
    for e in specimen.identification.estimates:
        paper = TABLE_I.get(e.name)
        factor, unit = display_unit(e.unit)
        off = "" if not paper else _percent(e.value / paper - 1)
        table = "" if paper is None else f"{typeset_number(factor * paper)} {typeset_unit(unit)}"
        sources = dict.fromkeys(_item_name(label) for label in e.source)
        rows.append(
            (
                e.name,
                parameter_description(e.name),
                typeset_measurement(e.value, e.standard_error, e.unit),
                table,
                off,
                ", ".join(sources),
            )
        )
    heads = ("parameter", "meaning", "value ± standard error", "paper's Table I", "difference", "told by")
    note = (
        "Standard errors of the fit, the gain of the sensor included. What is held (appendix) counts as exact: an error of a length or "
        "a density is not in them."
    )
    if specimen.identification.joint_fit is not None and specimen.identification.joint_fit.error_scale > 1:
        note = f"Standard errors are enlarged {specimen.identification.joint_fit.error_scale:.2g} times, as the misfit is larger than the errors of the points. {note}"
    return Table.of_rows("Parameters", heads, tuple(rows), note)


def agreement_blocks(summary: SpecimenSummary, plots: Sequence[ReportPlot]) -> list[Block]:
    """Return tables of Pearson's r, p and R^2 for every curve, and of the misfit of each run."""
    rows = tuple(_agreement_row(each) for each in curve_agreements(plots))
    fitted = summary.specimen.identification is not None
    note = (
        "The parameters were fitted to these same points (to fundamentals and phases, not to max - min): this is agreement, not "
        "prediction. r and p as the paper gives them; R² = 1 − residual sum of squares / sum of squares about the mean."
        if fitted
        else "Against the paper's Table I: nothing was fitted."
    )
    heads = ("curve", "points", "Pearson r", "p", "R²", "rms residual", "largest")
    blocks: list[Block] = [Table.of_rows("Validation curves", heads, rows, note)]
    if summary.specimen.identification is not None and summary.specimen.identification.misfits:
        misfits = summary.specimen.identification.misfits
        blocks.append(
            Table.of_rows(
                "How well the errors explain each run",
                ("points of", "residuals", "χ²", "p", "beyond 4 errors"),
                tuple(
                    (m.label, str(m.points), f"{m.chi_square:.1f}", typeset_probability(m.probability), str(m.outliers))
                    for m in misfits
                ),
                "χ² near the number of residuals: model and errors fit. A small p: the model, or the errors given, are not the whole "
                "story of that run.",
            )
        )
    if (
        summary.specimen.identification is not None
        and (adequacy := summary.specimen.identification.adequacy) is not None
        and adequacy.findings
    ):
        shown = adequacy.findings[:MAX_FINDINGS]
        more = (
            f" The first {MAX_FINDINGS} of {len(adequacy.findings)}." if len(adequacy.findings) > MAX_FINDINGS else ""
        )
        rows = tuple((f.kind, _spell_out(f.words), typeset_probability(f.probability)) for f in shown)
        note = f"By chance: of so much in any of all {adequacy.test_count} tests.{more}"
        blocks.append(
            Table.of_rows("How the runs depart from the model", ("kind", "what is seen", "by chance"), rows, note)
        )
    return blocks


def _agreement_row(agreement: CurveAgreement) -> tuple[str, ...]:
    r, p = (
        (EMPTY_CELL, EMPTY_CELL)
        if agreement.r is None
        else (f"{agreement.r:.4f}".replace("-", "−"), typeset_probability(agreement.p))
    )
    squared = EMPTY_CELL if agreement.r_squared is None else f"{agreement.r_squared:.4f}".replace("-", "−")
    return (
        agreement.label,
        str(agreement.points),
        r,
        p,
        squared,
        f"{agreement.rms:#.3g} {agreement.unit}",
        f"{agreement.largest:#.3g} {agreement.unit}",
    )


def perception_blocks(summary: SpecimenSummary) -> list[Block]:
    """Return tables of the margin over the threshold at every elongation, and of the latency."""
    rows = tuple(
        (
            f.condition,
            _format_bands(f),
            typeset_with_error(f.margin, f.margin_error),
            f"{f.frequency_hz:g} Hz",
            f"{1e6 * f.band.centre.max():.0f} µm",
        )
        for f in summary.perception_margins
    )
    blocks: list[Block] = []
    if rows:
        heads = ("specimen", "felt", "smallest margin", "at", "largest max - min")
        note = (
            f"By the model as identified, at full drive, ± standard error. Margin: max - min over {1e6 * THRESHOLD_M:g} µm, the "
            "discrimination threshold on the abdomen below 250 Hz; looked at from 5 to 250 Hz, where an end without an error is the "
            "end of that range."
        )
        blocks.append(Table.of_rows("Margin over the threshold", heads, rows, note))
    if summary.latency is not None:
        quick = summary.latency
        merits = [(m.name, m) for m in (quick.latency, quick.rise_time) if m is not None]
        lines = [
            (FIGURES_OF_MERIT[name].description, typeset_measurement(m.value, m.standard_error, "s"))
            for name, m in merits
        ]
        lines.append(
            (
                "overshoot over the final value",
                f"{typeset_with_error(100 * quick.overshoot, 100 * quick.overshoot_error)} %",
            )
        )
        blocks.append(Table.of_rows(f"A step of {quick.step_v:g} V", ("what", "value ± standard error"), tuple(lines)))
    return blocks


def _percent(share: float) -> str:
    text = f"{100 * share:+.1f} %".replace("-", "−")
    return "0.0 %" if text[1:] == "0.0 %" else text


def _item_name(label: str) -> str:
    """`20261121T091502Z_T7_static-loading mfc` as `loading`."""
    protocol = label.rpartition("_")[2].split(" ")[0]
    return ITEM_NAMES.get(protocol, protocol)


def _spell_out(text: str) -> str:
    return text.replace(" +- ", " ± ").replace(" -", f" {MINUS}")


def _unidentified_text(text: str) -> str:
    names, _, shares = text.partition(" (")
    along = f": relative changes of {shares.removesuffix(')')} together leave every point where it is" if shares else ""
    return f"Not identifiable from these runs: {names}{_spell_out(along)}."
