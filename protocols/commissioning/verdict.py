"""Verdict of a commissioning: pass, differs or dangerous, by measured check and by assumption of the driver."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from drivers.evidence import Assumption, OutputCheck

DANGEROUS_V = 0.1
"""Dangerous level or transient at the amplifier's input: 20 V or more on the specimen."""


DANGEROUS_RATIO = 1.1
"""Dangerous ratio of a drive, or of a departure from its form, to the limit."""


class OutputVerdict(StrEnum):
    """Verdict on one property, in order of severity. The texts are stored in records and never change."""

    PASS = "pass"  # noqa: S105 - no password
    HIDDEN = "cannot be seen"
    NOT_MEASURED = "not measured"
    DIFFERS = "differs"
    DANGEROUS = "dangerous"


SEVERITY = tuple(OutputVerdict)

_OF_A_DRIVE = {OutputCheck.SCALE, OutputCheck.UNEVEN, OutputCheck.LONG_LEVEL, OutputCheck.STOP, OutputCheck.SKEW}
FOLLOWERS = {
    OutputCheck.START: _OF_A_DRIVE | {OutputCheck.SHAPE, OutputCheck.POLARITY, OutputCheck.START_ROUTE},
    OutputCheck.SHAPE: _OF_A_DRIVE,
}
"""Checks that fail with another one: of drives that do not start, and of drives in another form."""


@dataclass(frozen=True, slots=True)
class CheckedOutput:
    """One measured figure of the output, and its limits (None: open on that side)."""

    check: OutputCheck
    value: float
    unit: str
    low: float | None
    high: float | None
    detail: str = ""

    @property
    def passed(self) -> bool:
        """Whether the figure lies between its limits."""
        return self.verdict is OutputVerdict.PASS

    @property
    def verdict(self) -> OutputVerdict:
        """Pass, differs, or dangerous: an inverted or too large drive, a wrong level, a step or a drop."""
        if not math.isfinite(self.value):
            return OutputVerdict.NOT_MEASURED
        if (self.low is None or self.value >= self.low) and (self.high is None or self.value <= self.high):
            return OutputVerdict.PASS
        if self.check in (OutputCheck.POLARITY, OutputCheck.INTERLOCK) or (
            self.unit == "V" and abs(self.value) >= DANGEROUS_V
        ):
            return OutputVerdict.DANGEROUS
        if self.check in (OutputCheck.SCALE, OutputCheck.UNEVEN, OutputCheck.SHAPE):
            return (
                OutputVerdict.DANGEROUS if self.value > DANGEROUS_RATIO * (self.high or 0.0) else OutputVerdict.DIFFERS
            )
        return OutputVerdict.DIFFERS


@dataclass(frozen=True, slots=True)
class CommandTime:
    """Reply times of one command.

    Attributes:
        command: header, with `?` for a query. An unconfirmed command counts with the query after it.
        count: number of replies.
        median_s, longest_s: time from the begin of the message to its reply.
    """

    command: str
    count: int
    median_s: float
    longest_s: float


@dataclass(frozen=True, slots=True)
class MeasuredTimes:
    """Measured times of a source, seconds; NaN where not measured.

    Attributes:
        stop_s: time of Stop from the largest drive until the driver reports rest; from a small drive if the source differs.
            Without the time of waiting for the end of a burst.
        start_s: time from the trigger to the first sample of a drive.
        second_client_s: time of the reply to a second connection; NaN if the instrument answers one client only.
        reply_s: longest time from the begin of a message to its reply, uploads included.
        level_stop_s: time of Stop from a level with a hastened end, for a source that cannot abort bursts; NaN for a jump of the
            output.
        upload_s: time of the upload of the driver's longest waveform.
        interlock_s: time from the last heartbeat of the interlock until high voltage is off.
    """

    stop_s: float
    start_s: float
    second_client_s: float
    reply_s: float = math.nan
    level_stop_s: float = math.nan
    upload_s: float = math.nan
    interlock_s: float = math.nan


@dataclass(frozen=True, slots=True)
class CheckedAssumption:
    """An assumption of the driver and the verdict of its measurement."""

    assumption: Assumption
    verdict: OutputVerdict


def checked_assumptions(
    assumptions: Iterable[Assumption], checks: Sequence[CheckedOutput]
) -> tuple[CheckedAssumption, ...]:
    """Return the verdict on each assumption: the worst of the checks that measure it.

    A check that fails because another one does is not measured.
    """
    verdicts = {check.check: check.verdict for check in checks}
    failed = {
        check for check, verdict in verdicts.items() if verdict in (OutputVerdict.DIFFERS, OutputVerdict.DANGEROUS)
    }
    for cause, followers in FOLLOWERS.items():
        if cause in failed:
            verdicts |= dict.fromkeys(failed & followers, OutputVerdict.NOT_MEASURED)
    checked = []
    for each in assumptions:
        measured = [verdicts.get(check, OutputVerdict.NOT_MEASURED) for check in each.checks]
        checked.append(CheckedAssumption(each, max(measured, key=SEVERITY.index, default=OutputVerdict.HIDDEN)))
    return tuple(checked)


def worst_verdict(checks: Iterable[CheckedOutput]) -> OutputVerdict:
    """Return the worst verdict of the checks."""
    return max((check.verdict for check in checks), key=SEVERITY.index, default=OutputVerdict.NOT_MEASURED)
