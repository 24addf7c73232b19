"""Severity, symbol and checks of a verdict, as logs, lists, tables and reports show them."""

import math
from enum import StrEnum
from typing import NamedTuple

from app.common.formatting import number_text, typeset
from model import shown_unit
from protocols.base import CheckResult, Outcome


class Severity(StrEnum):
    """Severity of a message."""

    INFO = "plain"
    SUCCESS = "good"
    WARNING = "attention"
    ERROR = "bad"


SEVERITIES = {
    Outcome.GOOD: Severity.SUCCESS,
    Outcome.DOUBTFUL: Severity.WARNING,
    Outcome.NO_RESULT: Severity.WARNING,
    Outcome.STOPPED: Severity.WARNING,
    Outcome.NOT_JUDGED: Severity.INFO,
}
"""Severities of outcomes; all others are errors."""

OUTCOME_SYMBOLS = {
    Outcome.GOOD: "✓",
    Outcome.DOUBTFUL: "△",
    Outcome.NO_RESULT: "○",
    Outcome.DID_NOT_PASS: "⊘",
    Outcome.STOPPED: "■",
    Outcome.FAILED: "✕",
    Outcome.UNSAFE: "⚠",
    Outcome.NOT_JUDGED: "–",
}
"""A shape for each outcome, distinct without colour."""


SEVERITY_SYMBOLS = {Severity.INFO: "–", Severity.SUCCESS: "✓", Severity.WARNING: "△", Severity.ERROR: "✕"}
"""A shape for each severity, distinct without colour."""


SEVERITY_STYLES = {
    Severity.INFO: "default",
    Severity.SUCCESS: "green",
    Severity.WARNING: "yellow",
    Severity.ERROR: "bold red",
}
"""Styles of texts on a terminal."""


def outcome_severity(outcome: Outcome) -> Severity:
    """Return the severity of an outcome for its display."""
    return SEVERITIES.get(outcome, Severity.ERROR)


SMALL_UNITS = {"V": (1e3, "mV"), "": (1e6, "ppm")}
SMALL = 0.1
"""Figures below it have the smaller unit, with its factor."""


class CheckRow(NamedTuple):
    """A check as a row of a table."""

    passed: bool
    name: str
    figure: str
    limits: str
    unit: str
    remedy: str
    """Empty if the check passed."""


def check_row(check: CheckResult) -> CheckRow:
    """Return a check as a row of a table, in display units."""
    factor, unit = shown_unit(check.unit)
    largest = max(
        (factor * abs(each) for each in (check.value, check.low, check.high) if each is not None), default=0.0
    )
    if unit in SMALL_UNITS and 0 < largest < SMALL:  # no powers of ten
        scale, unit = SMALL_UNITS[unit]
        factor *= scale
    low, high = (None if limit is None else number_text(factor * limit, 4) for limit in (check.low, check.high))
    limits = f"{low} … {high}" if low and high else f"at least {low}" if low else f"at most {high}"
    figure = number_text(factor * check.value, 4) if math.isfinite(check.value) else "not seen"
    name = f"{check.name} ({check.detail})" if check.detail else check.name
    return CheckRow(
        check.passed, typeset(name.replace(" - ", " − ")), figure, limits, unit, "" if check.passed else check.remedy
    )
