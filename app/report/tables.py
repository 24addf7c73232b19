"""The words and tables of a report."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict

from app.campaign.plan import PAPER
from app.common.formatting import counted, shown_unit
from app.report.document import Block, Grid, Outcome, Plot, Tone, Words
from app.report.figures_of_merit import MERITS, Felt
from app.report.limits import Limits
from app.report.plots import Agreement, agreements
from app.report.rounding import MINUS, plain, printed_unit, probability, stated, with_error
from app.report.runs import Taken
from app.report.specimen import Specimen, meaning
from app.report.summary import Known
from model.parameters import Membrane, Tactor
from model.response.perception import THRESHOLD_M

NONE = "–"
MOST = 10
"""Departures that are shown."""
ITEMS = {item.protocol: item.name for item in PAPER}
"""What a campaign calls a protocol, which is shorter."""
TABLE_I = asdict(Tactor()) | asdict(Membrane())


def verdict(limits: Limits, outcomes: Sequence[Outcome]) -> list[Block]:
    """Whether the specimen passes, and each limit."""
    missed = [o for o in outcomes if o.verdict != "pass"]
    words = f"PASS: all {len(outcomes)} limits are met." if len(outcomes) > 1 else "PASS: the limit is met."
    if missed:
        counts: Counter[str] = Counter(o.verdict for o in outcomes)
        told = (("pass", "met"), ("fail", "not met"), ("cannot tell", "cannot be told"))
        parts = [f"{counts[verdict]} {says}" for verdict, says in told if counts[verdict]]
        words = f"NOT PASSED: of {counted(len(outcomes), 'limit')} {', '.join(parts)}."
    rule = "the whole 95 % interval" if limits.rule == "guarded" else "the value alone"
    rows = tuple((o.name.replace("_", " "), o.asked, o.found, o.verdict, o.why) for o in outcomes)
    bad = frozenset(i for i, o in enumerate(outcomes) if o.verdict != "pass")
    note = f"Limits from {limits.source}; {rule} must lie within."
    return [
        Words(words, "bad" if missed else "good"),
        Grid("Limits", ("what", "asked", "found ± standard error", "verdict", "why"), rows, note, bad),
    ]


def sentences(known: Known, runs: Sequence[Taken]) -> list[Block]:
    """What a reader has to know before the numbers."""
    found = known.specimen.found
    words: list[Words] = []
    if found is None:
        words.append(Words(f"Nothing is identified: {known.specimen.why_not}.", "bad"))
    else:
        verdict = found.verdict if found.adequacy is None else found.adequacy.words
        tone: Tone = "bad" if found.adequacy is not None and found.adequacy.adequate is False else "plain"
        words.append(
            Words(f"Joint fit of {counted(len(found.campaign.runs), 'set')} of points: {_spelled(verdict)}.", tone)
        )
        words += [Words(_unidentified(each), "bad") for each in found.unidentified]
        words += [Words(f"{note}.") for note in found.notes]
    if known.felt:
        words.append(Words(_felt_words(known.felt)))
    elif found is not None:
        words.append(Words("No statement on threshold and latency: these runs do not tell the free response whole."))
    if (quick := known.quick) is not None and (felt_after := quick.latency) is not None:
        words.append(
            Words(
                f"A step of {quick.volts:g} V is felt after {stated(felt_after.value, felt_after.standard_error, 's')} "
                "(model, ± standard error; the amplifier's own slew is not in it)."
            )
        )
    words.append(Words(_quality_words(runs)))
    if late := [run for run in runs if run.expired]:
        words.append(
            Words(
                f"In {counted(len(late), 'run')} the calibration of an instrument had expired: see the instruments, appendix.",
                "bad",
            )
        )
    words += [Words(f"{run.name}: {run.trouble}.", "bad") for run in runs if run.trouble]
    words += [Words(f"{run.name} is left out of the identification: {run.left_out}.") for run in runs if run.left_out]
    return list(words)


def _felt_words(felts: Sequence[Felt]) -> str:
    free, *pressed = felts
    text = f"At full drive, free, max - min is {_margin(free)} the threshold of {1e6 * THRESHOLD_M:g} µm"
    if pressed:
        text += f"; {pressed[-1].words} {_margin(pressed[-1])} it"
    return f"{text} (model, 5 to 250 Hz, ± standard error)."


def _margin(felt: Felt) -> str:
    if felt.margin >= 1:
        return f"at least {with_error(felt.margin, felt.margin_error)} times (at {felt.at_hz:g} Hz)"
    if not felt.usable:
        return f"nowhere above, at least {with_error(felt.margin, felt.margin_error)} times"
    return (
        f"above only {_bands(felt)}, at least {with_error(felt.margin, felt.margin_error)} times (at {felt.at_hz:g} Hz)"
    )


def _bands(felt: Felt) -> str:
    ends = (
        " to ".join(with_error(value, error) for value, error in zip(band, errors, strict=True)) + " Hz"
        for band, errors in zip(felt.usable, felt.edges, strict=True)
    )
    return " and ".join(ends) or "nowhere"


def _quality_words(runs: Sequence[Taken]) -> str:
    points, usable = sum(run.points for run in runs), sum(run.usable for run in runs)
    flags: Counter[str] = Counter()
    for run in runs:
        flags.update(run.flags)
    why = ", ".join(f"{count} {flag}" for flag, count in sorted(flags.items()))
    unusable = f"{points - usable} are not usable" if points != usable else "all are usable"
    text = f"{counted(points, 'point')} in {counted(len(runs), 'run')}; {unusable}" + (f" ({why})" if why else "")
    return text + "."


def parameters(known: Specimen) -> Grid:
    """Estimates beside the paper's Table I."""
    assert known.found is not None
    rows = []
    for e in known.found.estimates:
        paper = TABLE_I.get(e.name)
        factor, unit = shown_unit(e.unit)
        off = "" if not paper else _percent(e.value / paper - 1)
        table = "" if paper is None else f"{plain(factor * paper)} {printed_unit(unit)}"
        sources = dict.fromkeys(_item(label) for label in e.source)
        rows.append(
            (e.name, meaning(e.name), stated(e.value, e.standard_error, e.unit), table, off, ", ".join(sources))
        )
    heads = ("parameter", "meaning", "value ± standard error", "paper's Table I", "difference", "told by")
    note = (
        "Standard errors of the fit, the gain of the sensor included. What is held (appendix) counts as exact: an error of a length or "
        "a density is not in them."
    )
    if known.found.fit is not None and known.found.fit.stretch > 1:
        note = f"Standard errors are enlarged {known.found.fit.stretch:.2g} times, as the misfit is larger than the errors of the points. {note}"
    return Grid("Parameters", heads, tuple(rows), note)


def agreement(known: Known, drawn: Sequence[Plot]) -> list[Block]:
    """Pearson's r, its p and R^2 for every curve, and how far the fit explains each run."""
    rows = tuple(_agreement_row(each) for each in agreements(drawn))
    fitted = known.specimen.found is not None
    note = (
        "The parameters were fitted to these same points (to fundamentals and phases, not to max - min): this is agreement, not "
        "prediction. r and p as the paper gives them; R² = 1 − residual sum of squares / sum of squares about the mean."
        if fitted
        else "Against the paper's Table I: nothing was fitted."
    )
    heads = ("curve", "points", "Pearson r", "p", "R²", "rms residual", "largest")
    blocks: list[Block] = [Grid("Validation curves", heads, rows, note)]
    if known.specimen.found is not None and known.specimen.found.misfits:
        misfits = known.specimen.found.misfits
        blocks.append(
            Grid(
                "How well the errors explain each run",
                ("points of", "residuals", "χ²", "p", "beyond 4 errors"),
                tuple(
                    (m.label, str(m.points), f"{m.chi_square:.1f}", probability(m.probability), str(m.outliers))
                    for m in misfits
                ),
                "χ² near the number of residuals: model and errors fit. A small p: the model, or the errors given, are not the whole "
                "story of that run.",
            )
        )
    if known.specimen.found is not None and (told := known.specimen.found.adequacy) is not None and told.findings:
        shown = told.findings[:MOST]
        more = f" The first {MOST} of {len(told.findings)}." if len(told.findings) > MOST else ""
        rows = tuple((f.kind, _spelled(f.words), probability(f.probability)) for f in shown)
        note = f"By chance: of so much in any of all {told.tests} tests.{more}"
        blocks.append(Grid("How the runs depart from the model", ("kind", "what is seen", "by chance"), rows, note))
    return blocks


def _agreement_row(each: Agreement) -> tuple[str, ...]:
    r, p = (NONE, NONE) if each.r is None else (f"{each.r:.4f}".replace("-", "−"), probability(each.p))
    squared = NONE if each.r_squared is None else f"{each.r_squared:.4f}".replace("-", "−")
    return (
        each.label,
        str(each.points),
        r,
        p,
        squared,
        f"{each.rms:#.3g} {each.unit}",
        f"{each.largest:#.3g} {each.unit}",
    )


def perception(known: Known) -> list[Block]:
    """Margin over the threshold at every elongation, and the latency."""
    rows = tuple(
        (
            f.words,
            _bands(f),
            with_error(f.margin, f.margin_error),
            f"{f.at_hz:g} Hz",
            f"{1e6 * f.band.centre.max():.0f} µm",
        )
        for f in known.felt
    )
    blocks: list[Block] = []
    if rows:
        heads = ("specimen", "felt", "smallest margin", "at", "largest max - min")
        note = (
            f"By the model as identified, at full drive, ± standard error. Margin: max - min over {1e6 * THRESHOLD_M:g} µm, the "
            "discrimination threshold on the abdomen below 250 Hz; looked at from 5 to 250 Hz, where an end without an error is the "
            "end of that range."
        )
        blocks.append(Grid("Margin over the threshold", heads, rows, note))
    if known.quick is not None:
        quick = known.quick
        told = [(m.name, m) for m in (quick.latency, quick.rise) if m is not None]
        lines = [(MERITS[name].words, stated(m.value, m.standard_error, "s")) for name, m in told]
        lines.append(
            ("overshoot over the final value", f"{with_error(100 * quick.overshoot, 100 * quick.overshoot_error)} %")
        )
        blocks.append(Grid(f"A step of {quick.volts:g} V", ("what", "value ± standard error"), tuple(lines)))
    return blocks


def _percent(share: float) -> str:
    text = f"{100 * share:+.1f} %".replace("-", "−")
    return "0.0 %" if text[1:] == "0.0 %" else text


def _item(label: str) -> str:
    """`20261121T091502Z_T7_static-loading mfc` as `loading`."""
    protocol = label.rpartition("_")[2].split(" ")[0]
    return ITEMS.get(protocol, protocol)


def _spelled(words: str) -> str:
    return words.replace(" +- ", " ± ").replace(" -", f" {MINUS}")


def _unidentified(words: str) -> str:
    names, _, shares = words.partition(" (")
    along = f": relative changes of {shares.removesuffix(')')} together leave every point where it is" if shares else ""
    return f"Not identifiable from these runs: {names}{_spelled(along)}."
