"""Verdict of a commissioning: pass, differs or dangerous, by measured check and by assumption of the driver."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from drivers.evidence import Assumption, OutputCheck

DANGEROUS_V = 0.1
"""A level or a transient of this size at the amplifier's input is up to 20 V (towards rest) or more on the specimen."""


DANGEROUS_RATIO = 1.1
"""A drive or a departure from its form that exceeds its limit by this factor."""


class OutputVerdict(StrEnum):
    """Verdict on one property, in order of severity. The texts are stored in records and never change."""

    PASS = "pass"  # noqa: S105 - no password
    HIDDEN = "cannot be seen"
    NOT_MEASURED = "not measured"
    DIFFERS = "differs"
    DANGEROUS = "dangerous"


SEVERITY = tuple(OutputVerdict)


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
        """Pass, differs, or dangerous: a drive that is inverted or too large, a wrong level, a step or a drop."""
        if not math.isfinite(self.value):
            return OutputVerdict.NOT_MEASURED
        if (self.low is None or self.value >= self.low) and (self.high is None or self.value <= self.high):
            return OutputVerdict.PASS
        if self.check is OutputCheck.POLARITY or (self.unit == "V" and abs(self.value) >= DANGEROUS_V):
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
        command: its header, with `?` for a query. One that an instrument does not confirm counts with the query after it.
        count: how often it was replied to.
        median_s, longest_s: from the beginning of its message to its reply.
    """

    command: str
    count: int
    median_s: float
    longest_s: float


@dataclass(frozen=True, slots=True)
class MeasuredTimes:
    """Measured times of a source, seconds; NaN where not measured.

    Attributes:
        stop_s: of Stop from the largest drive until the driver reports rest; of a small drive if the source differs. Where Stop
            waits for the end of a burst, without that time.
        start_s: from the trigger to the first sample of a drive.
        second_client_s: reply of the instrument to a second connection; NaN if it answers one client only.
        reply_s: longest time from the beginning of a message to its reply, uploads included.
        level_stop_s: of Stop from a level whose end it hastened, of a source whose bursts can only be waited for; NaN if the output
            did not follow without a jump.
        upload_s: of the longest waveform that the driver sends.
    """

    stop_s: float
    start_s: float
    second_client_s: float
    reply_s: float = math.nan
    level_stop_s: float = math.nan
    upload_s: float = math.nan


@dataclass(frozen=True, slots=True)
class CheckedAssumption:
    """An assumption of the driver and what its measurement says."""

    assumption: Assumption
    verdict: OutputVerdict


def checked_assumptions(
    assumptions: Iterable[Assumption], checks: Sequence[CheckedOutput]
) -> tuple[CheckedAssumption, ...]:
    """Return the verdict on each assumption: the worst of the checks that measure it."""
    verdicts = {check.check: check.verdict for check in checks}
    checked = []
    for each in assumptions:
        measured = [verdicts.get(check, OutputVerdict.NOT_MEASURED) for check in each.checks]
        checked.append(CheckedAssumption(each, max(measured, key=SEVERITY.index, default=OutputVerdict.HIDDEN)))
    return tuple(checked)


def worst_verdict(checks: Iterable[CheckedOutput]) -> OutputVerdict:
    """Return the worst verdict of the checks."""
    return max((check.verdict for check in checks), key=SEVERITY.index, default=OutputVerdict.NOT_MEASURED)
