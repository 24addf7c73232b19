"""Differences of runs: settings, conditions, instruments and results, in the words and units of the form."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from app.archive.run_summary import RunSummary
from app.common import field_label, round_figure, typeset, unit_of
from model import LENGTH_UNITS, format_time, quantity_label, shown_unit
from protocols import PROTOCOLS
from protocols.base import RunFigure
from protocols.runfile import RunRecord

MAX_LISTED = 3
"""Numbers of a list that are written, at either end."""

NO_DIFFERENCE = "none"


class RunDifference(NamedTuple):
    """One row: its name, a text for each run, and how the second result differs from the first; empty without two results."""

    name: str
    values: tuple[str, ...]
    difference: str = ""
    is_result: bool = False

    @property
    def is_equal(self) -> bool:
        """Whether all runs have the same value, or two differ by nothing at the first digit of the difference's uncertainty."""
        return len(set(self.values)) == 1 or self.difference == NO_DIFFERENCE


def run_settings(record: RunRecord) -> dict[str, str]:
    """Return the parameters of a run by their names in the form, in display units."""
    kind = PROTOCOLS.get(record.protocol)
    settings = {}
    for name, value in record.parameters.items():
        known = kind is not None and name in kind.model_fields
        label = field_label(kind, name) if known and kind is not None else name.replace("_", " ")
        settings[label] = _setting_text(value, (unit_of(kind, name) if known and kind is not None else None) or "")
    return settings


def compare_runs(runs: Sequence[RunSummary]) -> tuple[RunDifference, ...]:
    """Return a row for every setting, condition, instrument and result that at least one of the runs has; results last."""
    records = [run.record for run in runs]
    settings = [run_settings(record) | _circumstances(record) for record in records]
    figures = [{figure.name: figure for figure in run.figures} for run in runs]
    rows = [RunDifference(name, tuple(each.get(name, "–") for each in settings)) for name in _names(settings)]
    for name in _names(figures):
        found = [each.get(name) for each in figures]
        texts = tuple("–" if each is None else _figure_text(each) for each in found)
        first, second = (*found, None)[:2]
        difference = _difference(first, second) if len(runs) == 2 and first and second else ""
        rows.append(RunDifference(typeset(quantity_label(name)), texts, difference, is_result=True))
    return tuple(rows)


def _names(each: Sequence[Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(name for one in each for name in one))


def _circumstances(record: RunRecord) -> dict[str, str]:
    conditions, sensor = record.conditions, record.sensor
    facts = {
        "specimen": record.specimen,
        "protocol": PROTOCOLS.title(record.protocol) if record.protocol in PROTOCOLS else record.protocol,
        "operator": conditions.operator,
        "temperature": "" if conditions.temperature_c is None else f"{conditions.temperature_c:.1f} °C",
        "humidity": "" if conditions.humidity is None else f"{100 * conditions.humidity:.0f} %",
        "bench": record.bench_name,
        "calibration of the sensor": sensor.calibrated,
        "simulated": "yes" if record.simulated else "no",
        "verdict": str(record.verdict.outcome),
        **{f"{each.part} mounted": format_time(each.time) for each in record.mountings},
        **{role: str(identity) for role, identity in record.identities.items()},
    }
    return {name: text for name, text in facts.items() if text}


def _setting_text(value: object, unit: str) -> str:
    factor, shown = (1.0, unit) if unit == "s" else shown_unit(unit)  # a setting is no measured latency: minutes, too
    if isinstance(value, list | tuple):
        texts = [_setting_text(each, "").strip() for each in ([factor * v for v in value] if unit else value)]
        if len(texts) > 2 * MAX_LISTED:
            texts = [*texts[:MAX_LISTED], "…", *texts[-MAX_LISTED:]]
        return f"{', '.join(texts)} {typeset(shown)}".strip()
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{factor * value:.6g} {typeset(shown)}".strip()
    return "none" if value is None else str(value)


def _figure_text(figure: RunFigure) -> str:
    factor, unit = shown_unit(figure.unit, figure.name)
    return f"{round_figure(factor * figure.value, factor * figure.total)} {typeset(unit)}".strip()


def _difference(a: RunFigure, b: RunFigure) -> str:
    """Return b less a, and that in standard uncertainties of the difference: a gain that both share has no part in a ratio."""
    if a.unit in LENGTH_UNITS and a.value:
        relative = [each.statistical / each.value if each.value else math.inf for each in (a, b)]
        change, error, factor, unit = b.value / a.value - 1, math.hypot(*relative), 100.0, "%"
    else:
        factor, unit = shown_unit(a.unit, a.name)
        change, error = b.value - a.value, math.hypot(a.statistical, b.statistical)
    number = round_figure(factor * change, factor * error)
    if not float(number):
        return NO_DIFFERENCE
    text = f"{'+' if change > 0 else ''}{number} {typeset(unit)}".strip()
    sigmas = abs(change) / error if error > 0 else math.nan
    of = f", {sigmas:.{0 if sigmas > 10 else 1}f} σ" if math.isfinite(sigmas) else ""
    return f"{text}{of}".replace("-", "−")
