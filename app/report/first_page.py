"""First page of a report, which is signed: who measured what, when and with which instruments, verdict and key figures."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

from app.common import OUTCOME_SYMBOLS, Column, Table, pluralize, sentence_case, typeset_unit
from app.identification import SpecimenSheet
from app.report.document import Block, LimitOutcome, Paragraph, Photograph, Report, Verdict
from app.report.figures_of_merit import MODEL_SOURCE, SpecimenSummary
from app.report.limits import Limits
from app.report.report_tables import format_flags
from app.report.rounding import typeset_measurement
from app.report.runs import InstrumentRecord, ReportRun, run_label
from model import PARAMETERS, QUANTITIES, EstimatedQuantity, format_time, quantity_label
from protocols.base import Outcome

KEY_FIGURES = (
    "natural_frequency", "peak_frequency", "amplitude_at_resonance", "quality_factor", "static_gain_above_rest",
    "static_gain_below_rest", "latency", "margin_at_resonance", "smallest_margin", "smallest_margin_on_membrane",
)  # fmt: skip
FLEET_FIGURES = ("natural_frequency", "amplitude_at_resonance", "quality_factor", "latency", "smallest_margin")
NOT_RECORDED = "not recorded"
DOUBTFUL = OUTCOME_SYMBOLS[Outcome.DOUBTFUL]
"""Behind the run of a value: the run is doubtful, as a note says."""
VERDICT_LABELS: dict[Verdict, str] = {"pass": "met", "fail": "not met", "cannot tell": "not decided"}


def identity_blocks(sheet: SpecimenSheet, runs: Sequence[ReportRun], photograph: bytes) -> Iterator[Block]:
    """Yield what was measured, by whom, when and in which air, with the photograph of the specimen; and the instruments."""
    origin = sheet.description if sheet.path is None else sheet.description.replace(f" {sheet.path.name}", "")
    if photograph:
        yield Photograph(photograph, f"Photograph of specimen {sheet.specimen}")
    facts = {
        "specimen": "; ".join(
            filter(None, (sheet.serial and f"serial {sheet.serial}", sheet.batch and f"batch {sheet.batch}", origin))
        ),
        "measured": _measured_text(runs),
        "checked": _people(name for run in runs for name in run.summary.checked_by.split(", "))
        or "by no second person",
        "air": _air_text(runs),
        "mounted": _mounting_text(runs),
        "runs": _runs_text(runs),
    }  # fmt: skip
    yield Table(
        "measurement", "Measurement", tuple(Column(name, None, [text]) for name, text in facts.items()), vertical=True
    )
    yield instrument_table(runs)


def _people(names: Iterable[str]) -> str:
    counts = Counter(filter(None, names))
    return ", ".join(f"{name} ({pluralize(count, 'run')})" for name, count in counts.most_common())


def operators_text(runs: Sequence[ReportRun]) -> str:
    """Return the names of those who measured."""
    return ", ".join(dict.fromkeys(filter(None, (run.summary.operator for run in runs))))


def _measured_text(runs: Sequence[ReportRun]) -> str:
    times = sorted(format_time(run.summary.start_time) for run in runs if run.summary.start_time)
    span = "at an unknown time"
    if times:
        day, end = times[0].partition(" ")[0], times[-1]
        last = "" if end == times[0] else f" to {end.removeprefix(f'{day} ')}"
        span = f"{times[0]}{last} UTC"
    benches = ", ".join(dict.fromkeys(filter(None, (run.summary.bench for run in runs))))
    by = _people(run.summary.operator for run in runs) or "an operator who is not recorded"
    return f"{span} by {by}{f' at {benches}' if benches else ''}"


def _air_text(runs: Sequence[ReportRun]) -> str:
    """Return the ranges of temperature and humidity over the runs."""
    air = [run.summary.record.conditions for run in runs]
    temperatures = [each.temperature_c for each in air if each.temperature_c is not None]
    humidities = [100 * each.humidity for each in air if each.humidity is not None]
    parts = [
        "" if not values else " to ".join(dict.fromkeys(format(v, spec) for v in (min(values), max(values)))) + unit
        for values, spec, unit in ((temperatures, ".1f", " °C"), (humidities, ".0f", " % relative humidity"))
    ]
    missing = sum(each.temperature_c is None for each in air)
    note = f" ({NOT_RECORDED} in {pluralize(missing, 'run')})" if 0 < missing < len(air) else ""
    return (", ".join(filter(None, parts)) or NOT_RECORDED) + note


def _mounting_text(runs: Sequence[ReportRun]) -> str:
    """Return the parts with the time of their last mounting."""
    mountings = {(each.part, each.time): each for run in runs for each in run.record.mountings}
    counts, last = Counter(part for part, _ in mountings), {each.part: each for _, each in sorted(mountings.items())}
    texts = [
        f"{part} {format_time(each.time)}{f' by {each.who}' if each.who else ''}"
        + (f", {counts[part]} times" if counts[part] > 1 else "")
        for part, each in last.items()
    ]
    return "; ".join(texts) + " (UTC)" if texts else NOT_RECORDED


def _runs_text(runs: Sequence[ReportRun]) -> str:
    verdicts = Counter(run.summary.verdict_text if not run.problem else "unreadable" for run in runs)
    left_out = sum(bool(run.exclusion_reason) for run in runs)
    text = f"{pluralize(len(runs), 'run')}: {', '.join(f'{count} {verdict}' for verdict, count in verdicts.items())}"
    points, usable = sum(run.record.point_count for run in runs), sum(run.usable_count for run in runs)
    flags = format_flags(sum((Counter(run.flag_counts) for run in runs), Counter[str]()))
    text += f"; {usable} of {pluralize(points, 'point')} usable" + (f", flags: {flags}" if flags else "")
    return f"{text}; {left_out} left out of the identification, see page 2" if left_out else text


def instrument_table(runs: Sequence[ReportRun]) -> Table:
    """Return the table of instruments with the state of their calibration on the day of their last run."""
    users: dict[InstrumentRecord, list[ReportRun]] = {}
    for run in runs:
        for instrument in run.instruments:
            users.setdefault(instrument, []).append(run)
    rows, highlighted = [], set()
    for at, (each, used) in enumerate(users.items()):
        state = each.state(max(run.summary.start_time[:10] for run in used))
        if late := sum(run.uses_expired(each) for run in used):
            state = f"overdue in {pluralize(late, 'run')}"
        if late or each.drift:
            highlighted.add(at)
        identity = each.identity if each.serial in each.identity else f"{each.identity} #{each.serial}"
        certified = f"certificate {each.certificate}" if each.certificate else ""
        gain = f"gain known to {each.gain}" if each.gain else ""
        notes = "; ".join(filter(None, (certified, gain, each.drift))) or "–"
        rows.append((sentence_case(each.role), identity, each.calibrated or "–", each.expires or "–", state, notes))
    heads = ("instrument", "identity #serial", "calibrated", "due", "state", "evidence")
    return Table.of_rows("Instruments and their calibration", heads, rows, highlighted_rows=frozenset(highlighted))


def verdict_paragraph(limits: Limits | None, outcomes: Sequence[LimitOutcome]) -> Paragraph:
    """Return the verdict on the specimen."""
    if limits is None:
        return Paragraph("No limits were set: this report has values and no verdict on the specimen.")
    missed = [o for o in outcomes if o.verdict != "pass"]
    text = f"PASS: all {len(outcomes)} limits are met." if len(outcomes) > 1 else "PASS: the limit is met."
    if missed:
        counts = Counter(o.verdict for o in outcomes)
        parts = [f"{counts[verdict]} {label}" for verdict, label in VERDICT_LABELS.items() if counts[verdict]]
        text = f"NOT PASSED: of {pluralize(len(outcomes), 'limit')} {', '.join(parts)}."
    return Paragraph(text, "bad" if missed else "good")


def key_figure_table(
    summary: SpecimenSummary,
    runs: Sequence[ReportRun],
    limits: Limits | None = None,
    outcomes: Sequence[LimitOutcome] = (),
) -> Table:
    """Return the key figures, measured ones before the model's, with limits and verdicts; limits on other quantities behind them."""
    merits, by_stem = summary.figures_of_merit, {run.path.stem: run for run in runs}
    rows: list[tuple[str, ...]] = []
    bad = set()
    for name in dict.fromkeys((*KEY_FIGURES, *(o.name for o in outcomes))):
        merit = merits.get(name)
        found = [o for o in outcomes if o.name == name]
        unit = typeset_unit(QUANTITIES[name].shown[1]) if found else ""
        value = f"not measured{f' ({unit})' if unit else ''}"
        if merit is not None:
            value = typeset_measurement(merit.value, merit.standard_error, merit.unit, name)
        source = "" if merit is None else _source_text(merit, by_stem)
        for at, o in enumerate(found or [None]):
            if o is not None and o.verdict != "pass":
                bad.add(len(rows))
            why = "" if o is None or merit is None else o.why
            asked = "" if o is None else o.asked.removesuffix(unit).rstrip()
            judged = (asked, "" if o is None else f"{o.verdict}{f': {why}' if why else ''}")
            rows.append(
                (
                    (sentence_case(quantity_label(name if merit is None else merit.name)), value, source)
                    if at == 0
                    else ("", "" if o is None else o.found, "")
                )
                + judged
            )
    heads: tuple[str, ...] = ("quantity", "value ± total", "source", "limit", "verdict")
    note = _key_figure_note(summary, limits)
    if any(DOUBTFUL in row[2] for row in rows):
        note += f" {DOUBTFUL}: doubtful run, see page 2."
    if limits is None:
        heads, rows = heads[:3], [row[:3] for row in rows]
    return Table.of_rows("Key figures", heads, rows, note, frozenset(bad))  # fmt: skip


def fleet_summary(reports: Sequence[Report]) -> Table:
    """Return the table of many specimens: verdict, and the key figures that any of them has."""
    merits = [{str(m["name"]): m for m in each.record["merits"]} for each in reports]  # type: ignore[attr-defined]
    names = [name for name in FLEET_FIGURES if any(name in found for found in merits)]
    rows, bad = [], set()
    for at, (report, found) in enumerate(zip(reports, merits, strict=True)):
        missed = [quantity_label(o.name) for o in report.limit_outcomes if o.verdict != "pass"]
        verdict = f"not passed: {', '.join(missed)}" if missed else "pass" if report.limit_outcomes else "no limits"
        if missed:
            bad.add(at)
        cells = [
            typeset_measurement(m["value"], m["standard_error"], m["unit"], name)
            + (" (model)" if m["source"] == MODEL_SOURCE else "")
            if (m := found.get(name))
            else "–"
            for name in names
        ]
        rows.append((report.specimen, verdict, *cells))
    heads = ("specimen", "verdict", *map(quantity_label, names))
    note = "±: total standard uncertainty. The first page of each specimen follows."
    return Table.of_rows("Summary", heads, rows, note, frozenset(bad))


def _key_figure_note(summary: SpecimenSummary, limits: Limits | None) -> str:
    notes = ["±: total standard uncertainty"]
    if summary.largest_at_hz:
        notes.append(
            f"largest response: at {summary.largest_at_hz:.4g} Hz among the points; the peak frequency is below the natural (undamped) one"
        )
    if margins := summary.perception_margins:
        where = (f"{each.condition} at {each.frequency_hz:g} Hz" for each in (margins[0], margins[-1]))
        smallest = f"smallest by the model, 5 to 250 Hz: {', '.join(dict.fromkeys(where))}"
        notes.append(f"margins: over the threshold, {margins[0].threshold.marked_label}; {smallest}")
    if limits is not None:
        rule = "whole 95 % interval" if limits.rule == "guarded" else "value alone"
        notes.append(f"limits: in the unit of the value, {limits.source}, {rule}")
    return ". ".join(map(sentence_case, notes)) + "."


def _source_text(merit: EstimatedQuantity, by_stem: Mapping[str, ReportRun]) -> str:
    """Return the run of a measured value, without the year where all are of one, with its doubts; or that it is the model's."""
    if merit.source == MODEL_SOURCE:
        return "fitted, see page 2" if merit.name in PARAMETERS else "model, not measured"
    stem = str(merit.source).partition(" ")[0]  # behind it the part of a series
    if (run := by_stem.get(stem)) is None:
        return str(merit.source)
    doubt = f" {DOUBTFUL}" if run.summary.outcome is Outcome.DOUBTFUL else ""
    drift = ", sensor drifting" if any(each.drift for each in run.instruments) else ""
    years = {each.summary.start_time[:4] for each in by_stem.values()}
    label = run_label(run) if len(years) > 1 else run_label(run).replace(f" {years.pop()}-", " ")
    return f"{label}{doubt}{drift}"
