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

NO_DIFFERENCE, EXACT = "none", ".12g"


class RunDifference(NamedTuple):
    """One row: its name, a text for each run, and how the second result differs from the first; empty without two results."""

    name: str
    values: tuple[str, ...]
    difference: str = ""
    is_result: bool = False

    @property
    def is_equal(self) -> bool:
        """Whether all runs have the same value; two results: whether they differ by nothing at the first digit of the difference's uncertainty."""
        return self.difference == NO_DIFFERENCE or (not self.difference and len(set(self.values)) == 1)


def run_settings(record: RunRecord, exact: bool = False) -> dict[str, str]:
    """Return the parameters of a run by their names in the form, in display units; `exact`: with every digit and every number."""
    kind = PROTOCOLS.get(record.protocol)
    settings = {}
    for name, value in record.parameters.items():
        known = kind is not None and name in kind.model_fields
        label = field_label(kind, name) if known and kind is not None else name.replace("_", " ")
        unit = (unit_of(kind, name) if known and kind is not None else None) or ""
        settings[label] = _setting_text(value, unit, exact)
    return settings


def compare_runs(runs: Sequence[RunSummary]) -> tuple[RunDifference, ...]:
    """Return a row for every setting, condition, instrument and result that at least one of the runs has; results last.

    Values that differ below the digits that are usually shown have more of them: settings and conditions 12, results those of the
    statistical uncertainty.
    """
    usual, exact = (
        [run_settings(run.record, digits) | _circumstances(run.record, digits) for run in runs]
        for digits in (False, True)
    )
    figures = [{figure.name: figure for figure in run.figures} for run in runs]
    rows = [
        RunDifference(name, _distinct(*(tuple(each.get(name, "–") for each in texts) for texts in (usual, exact))))
        for name in _names(usual)
    ]
    for name in _names(figures):
        found = [each.get(name) for each in figures]
        texts = _distinct(
            *(
                tuple("–" if each is None else _figure_text(each, getattr(each, error)) for each in found)
                for error in ("total", "statistical")
            )
        )
        first, second = (*found, None)[:2]
        difference = _difference(first, second) if len(runs) == 2 and first and second else ""
        rows.append(RunDifference(typeset(quantity_label(name)), texts, difference, is_result=True))
    return tuple(rows)


def _distinct(usual: tuple[str, ...], exact: tuple[str, ...]) -> tuple[str, ...]:
    """Return the usual texts, or the exact ones where the usual ones do not tell the values apart."""
    return usual if len(set(usual)) > 1 or len(set(exact)) == 1 else exact


def _names(each: Sequence[Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(name for one in each for name in one))


def _circumstances(record: RunRecord, exact: bool) -> dict[str, str]:
    conditions, sensor = record.conditions, record.sensor
    degrees, share = (EXACT, EXACT) if exact else (".1f", ".0f")
    facts = {
        "specimen": record.specimen,
        "protocol": PROTOCOLS.title(record.protocol) if record.protocol in PROTOCOLS else record.protocol,
        "operator": conditions.operator,
        "temperature": "" if conditions.temperature_c is None else f"{conditions.temperature_c:{degrees}} °C",
        "humidity": "" if conditions.humidity is None else f"{100 * conditions.humidity:{share}} %",
        "bench": record.bench_name,
        "calibration of the sensor": sensor.calibrated,
        "simulated": "yes" if record.simulated else "no",
        "verdict": str(record.verdict.outcome),
        **{f"{each.part} mounted": format_time(each.time) for each in record.mountings},
        **{role: str(identity) for role, identity in record.identities.items()},
    }
    return {name: text for name, text in facts.items() if text}


def _setting_text(value: object, unit: str, exact: bool = False) -> str:
    factor, shown = (1.0, unit) if unit == "s" else shown_unit(unit)  # a setting is no measured latency: minutes, too
    if isinstance(value, list | tuple):
        texts = [_setting_text(each, "", exact) for each in ([factor * v for v in value] if unit else value)]
        if len(texts) > 2 * MAX_LISTED and not exact:
            texts = [*texts[:MAX_LISTED], "…", *texts[-MAX_LISTED:]]
        return f"{', '.join(texts)} {typeset(shown)}".strip()
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{factor * value:{EXACT if exact else '.6g'}} {typeset(shown)}".strip()
    return "none" if value is None else str(value)


def _figure_text(figure: RunFigure, error: float) -> str:
    factor, unit = shown_unit(figure.unit, figure.name)
    return f"{round_figure(factor * figure.value, factor * error)} {typeset(unit)}".strip()


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
