"""Result cards of a report: verdict, quantities or points, and hints of every run, as the window shows them; tables of results."""

from collections.abc import Iterator, Sequence

from app.common import MAX_POINT_ROWS, OUTCOME_SYMBOLS, ResultSummary, Severity, Table, outcome_severity
from app.report.document import Block, Paragraph, Tone
from app.report.rounding import typeset_measurement
from app.report.runs import ReportRun
from protocols import aspects_of
from protocols.base import Outcome, RunFigure
from protocols.runfile import RunReadError

NOISE_NOTE = (
    "± one standard error of this run's noise only; total uncertainties are given for the identified parameters."
)
HEADINGS = ("quantity", "value")
TONES: dict[Severity, Tone] = {Severity.ERROR: "bad"}


def result_cards(runs: Sequence[ReportRun]) -> Iterator[Block]:
    """Yield the result of each run that can be read, in the order of the runs."""
    for run in runs:
        if run.result is not None:
            yield from _card(run, run.result)


def result_tables(runs: Sequence[ReportRun], section: str) -> Iterator[Block]:
    """Yield the tables of a section that protocols make of their newest run with a result."""
    newest = {run.summary.protocol: run for run in runs if run.result is not None and not run.without_result}
    for protocol, run in newest.items():
        try:
            tables = tuple(aspects_of(protocol).result_tables(run.name, run.summary.figures))
        except RunReadError as error:  # of a laboratory's protocol
            yield Paragraph(f"{error}.", "bad")
            continue
        for table in tables:
            if table.section == section:
                rows = [tuple(map(_typeset, row)) for row in table.rows]
                yield Table.of_rows(table.title, table.columns, rows, table.note)


def _typeset(cell: str | RunFigure) -> str:
    """Return a cell as text, a figure with its total uncertainty."""
    if isinstance(cell, str):
        return cell
    return typeset_measurement(cell.value, cell.total, cell.unit, cell.name)


def _card(run: ReportRun, result: ResultSummary) -> Iterator[Block]:
    outcome = result.verdict.outcome
    marks = ", SIMULATED" * result.simulated + ", IMPORTED" * run.imported
    title = f"{run.summary.protocol}, {run.name}: {OUTCOME_SYMBOLS[outcome]} {outcome.upper()}{marks}"
    tone = TONES.get(outcome_severity(outcome), "plain")
    lines = [(line.name, line.text) for line in result.lines]
    if listed := lines or result.points[:MAX_POINT_ROWS]:
        more = 0 if lines else len(result.points) - len(listed)
        note = f"{NOISE_NOTE} {more} more points are in the file." if more > 0 else NOISE_NOTE
        yield Table.of_rows(title, HEADINGS if lines else result.point_names, listed, note)
    else:
        yield Paragraph(title, tone)
    if outcome is not Outcome.GOOD:
        yield Paragraph(f"{result.verdict.describe(result.reason)}.", tone)
    yield from (Paragraph(f"Hint: {hint}.") for hint in result.hints)
