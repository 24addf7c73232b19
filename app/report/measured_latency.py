"""Measured latency of a specimen for the report, beside the published times of other actuators."""

import json
from collections.abc import Sequence

from app.archive.figures import FELT, LATENCY_PROTOCOL, RunFigure
from app.common import Table
from app.report.document import Block
from app.report.rounding import typeset_measurement, typeset_with_error
from app.report.runs import ReportRun
from model.response import PUBLISHED_LATENCIES

TIMES_NOTE = (
    "± total standard uncertainty, that of the sensor's gain and delay included. A step's times count from the centroid of its "
    "edge in the recorded drive, a sine's from its begin; the amplifier's own delay is part of them. Rise: 10 to 90 % of a step, "
    "from the begin to 90 % of the peak of a sine."
)
PUBLISHED_NOTE = "Times to nearly the full vibration: the rise of a sine's onset compares with them, the time to the threshold does not."


def latency_blocks(runs: Sequence[ReportRun]) -> list[Block]:
    """Return the table of the newest latency run, and that of other actuators; nothing without such a run."""
    measured = [run for run in runs if run.summary.protocol == LATENCY_PROTOCOL and not run.without_result]
    if not measured:
        return []
    figures = [RunFigure(*record) for record in json.loads(measured[-1].summary.figures_json)]
    onsets: dict[str, dict[str, str]] = {}
    for figure in figures:
        name, _, onset = figure.name.partition(", ")
        if onset and figure.unit != "m/s":
            onsets.setdefault(onset, {})[name] = _typeset(figure)
    names = list(dict.fromkeys(name for values in onsets.values() for name in values))
    names.sort(key=lambda name: not name.startswith(FELT))
    rows = [
        (onset, *(values.get(name, "–") for name in names))
        for onset, values in sorted(onsets.items(), key=_onset_order)
    ]
    published = [
        (p.actuator, f"{'below ' if not p.low_s else ''}{_span_ms(p.low_s, p.high_s)} ms", p.meaning, p.source)
        for p in PUBLISHED_LATENCIES
    ]
    title = f"Latency as measured ({measured[-1].name})"
    return [
        Table.of_rows(title, ("onset", *names), rows, TIMES_NOTE),
        Table.of_rows("Other actuators, published", ("actuator", "time", "what", "source"), published, PUBLISHED_NOTE),
    ]


def _onset_order(item: tuple[str, object]) -> tuple[bool, float]:
    """Return steps before sines, each by its number."""
    return item[0].startswith("from"), float(next(word for word in item[0].split() if word[0].isdigit()))


def _typeset(figure: RunFigure) -> str:
    if figure.unit == "s":
        return typeset_measurement(figure.value, figure.total, "s")
    return f"{typeset_with_error(100 * figure.value, 100 * figure.total)} %"


def _span_ms(low_s: float, high_s: float) -> str:
    low, high = f"{1e3 * low_s:g}", f"{1e3 * high_s:g}"
    return high if low in ("0", high) else f"{low} to {high}"
