"""Severity and symbol of each verdict, as logs, lists and reports show them."""

from enum import StrEnum

from protocols.base import Outcome


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


def outcome_severity(outcome: Outcome) -> Severity:
    """Return the severity with which an outcome is shown."""
    return SEVERITIES.get(outcome, Severity.ERROR)
