"""Verdict on a run: whether its result can be used, the reasons, and the checks behind it.

The status of a run states how the program ended it; the verdict states what the measurement is worth. A protocol's `checks`
compare figures of its result with limits; `judge` adds what holds for every protocol (usable points) and returns the worst.
"""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from protocols.base.jsonable import to_jsonable
from protocols.base.quality import Quality

if TYPE_CHECKING:
    from protocols.base.protocol import Protocol


class RunStatus(StrEnum):
    """Status of a run. A file with `running` whose program is gone is a crashed run."""

    RUNNING = "running"
    COMPLETED = "completed"
    STOPPED = "stopped"
    FAILED = "failed"
    UNSAFE = "unsafe"


class Outcome(StrEnum):
    """What a run is worth. The texts are stored in run files and printed by `--json`; they never change."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    """There is a result, and a reason to question it."""
    NO_RESULT = "no result"
    """Nothing usable was measured."""
    DID_NOT_PASS = "did not pass"  # noqa: S105 - no password
    """A figure of a check, such as the wiring check, lies outside its limits."""
    STOPPED = "stopped"
    FAILED = "failed"
    UNSAFE = "unsafe"
    """Rest could not be confirmed at the end."""
    NOT_JUDGED = "not judged"
    """A run of an earlier version, an imported one, or one that has not ended."""

    @property
    def has_result(self) -> bool:
        """Whether the run gave a result that may be used."""
        return self in (Outcome.GOOD, Outcome.DOUBTFUL)


ALL_MEASURED = "all points measured"
"""Reason of a run whose plan was completed."""

SEVERITY = (Outcome.GOOD, Outcome.DOUBTFUL, Outcome.NO_RESULT, Outcome.DID_NOT_PASS)
"""Outcomes of a completed run, the worst last."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """A figure of a result, its limits (None: open on that side), and the remedy if it lies outside them."""

    name: str
    value: float
    unit: str
    """Empty where the name says it all."""
    low: float | None
    high: float | None
    remedy: str
    consequence: Outcome = Outcome.DOUBTFUL
    """Outcome of the run if the figure lies outside its limits."""
    detail: str = ""
    """Which points, weights or recordings the figure is of; empty where the name says it."""

    @property
    def passed(self) -> bool:
        """Whether the figure lies between its limits; a figure that could not be computed (NaN) does not."""
        return (
            math.isfinite(self.value)
            and (self.low is None or self.value >= self.low)
            and (self.high is None or self.value <= self.high)
        )

    @property
    def text(self) -> str:
        """Name, figure, limits and remedy as a sentence; without a unit, name and remedy."""
        figure = f"{self.value:.4g} {self.unit}" if math.isfinite(self.value) else "not measurable"
        if self.unit == "1":
            figure = figure.removesuffix(" 1")
        limits = " and ".join(
            f"{word} {limit:.4g}"
            for word, limit in (("at least", self.low), ("at most", self.high))
            if limit is not None
        )
        of = f" ({self.detail})" if self.detail else ""
        compared = f": {figure}, limit {limits}" if self.unit else ""
        return f"{self.name}{of}{compared}" + (f"; {self.remedy}" if self.remedy else "")


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a run is worth, the reasons in words, and every check, passed or not."""

    outcome: Outcome = Outcome.NOT_JUDGED
    reasons: tuple[str, ...] = ()
    checks: tuple[CheckResult, ...] = ()

    def describe(self, run_reason: str) -> str:
        """Return outcome, reasons and, where these do not imply it, how the run ended, as a line."""
        reasons = "; ".join(self.reasons)
        implied = run_reason in reasons or run_reason == ALL_MEASURED
        text = f"{reasons} ({run_reason})" if reasons and not implied else reasons or run_reason
        if not text or text.casefold().startswith(self.outcome):
            return text or str(self.outcome)
        return f"{self.outcome}: {text}"

    @property
    def failed_checks(self) -> tuple[CheckResult, ...]:
        """The checks that did not pass."""
        return tuple(check for check in self.checks if not check.passed)

    def to_json(self) -> str:
        """Return the verdict as JSON, as run files store it."""
        return json.dumps(to_jsonable(self), ensure_ascii=False, allow_nan=False)

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "Verdict":
        """Return the verdict of a JSON object.

        Raises:
            KeyError, TypeError, ValueError: the object is no verdict.
        """
        checks = tuple(
            CheckResult(
                **{
                    **each,
                    "value": math.nan if each["value"] is None else float(each["value"]),
                    "consequence": Outcome(each["consequence"]),
                }
            )
            for each in record["checks"]
        )
        return cls(Outcome(record["outcome"]), tuple(map(str, record["reasons"])), checks)

    @classmethod
    def of_status(cls, status: RunStatus, reason: str, checks: tuple[CheckResult, ...] = ()) -> "Verdict":
        """Return the verdict of a run that was not completed."""
        return cls(Outcome(status), (reason,), checks)


def judge(protocol: "Protocol", points: Sequence[Any], planned: int) -> Verdict:
    """Return the verdict on a completed run. Pure, so that a run file gives the verdict of the live run.

    Args:
        protocol: the protocol with the parameters of the run.
        points: the valid points, superseded ones left out.
        planned: number of entries of the plan.
    """
    checks = (*usability_checks(points, planned), *protocol.checks(points))
    failed = [check for check in checks if not check.passed]
    outcome = max((check.consequence for check in failed), key=SEVERITY.index, default=Outcome.GOOD)
    return Verdict(outcome, tuple(check.text for check in failed), checks)


def usability_checks(points: Sequence[Any], planned: int) -> tuple[CheckResult, ...]:
    """Return the checks that hold for every protocol: each entry has a point, and each point is usable."""
    flags = [Quality(int(getattr(point, "quality", 0))) for point in points]
    usable = sum(flag.usable for flag in flags)
    causes = Counter(
        fault.name for flag in flags if not flag.usable for fault in flag & ~Quality.FACTS if fault.name is not None
    )
    detail = ", ".join(f"{n} {name.lower().replace('_', ' ')}" for name, n in causes.most_common())
    if missing := planned - len(points):
        detail = f"{detail}, {missing} without a point".removeprefix(", ")
    remedy = _usability_remedy(causes)
    checks = [
        CheckResult(
            f"usable points of {planned}" if usable else f"no usable point of {planned}",
            float(usable),
            "1" if usable else "",
            float(planned) if usable else 1.0,
            None,
            remedy,
            Outcome.DOUBTFUL if usable else Outcome.NO_RESULT,
            detail,
        )
    ]
    if expired := sum(bool(flag & Quality.CALIBRATION_EXPIRED) for flag in flags):
        remedy = "calibrate the displacement sensor and enter the date under [sensor] in the bench file"
        checks.append(CheckResult("points with an expired sensor calibration", float(expired), "1", None, 0.0, remedy))
    if exceeded := sum(bool(flag & Quality.LEVEL_EXCEEDED) for flag in flags):
        remedy = "see the log for the level and its value"
        checks.append(
            CheckResult("points in which an abort level was exceeded", float(exceeded), "1", None, 0.0, remedy)
        )
    return tuple(checks)


REMEDIES = {
    Quality.OUT_OF_RANGE: "bring the target into the sensor's range",
    Quality.NO_RESPONSE: "check that the tactor is under the sensor, and that high voltage is on",
    Quality.DRIVE_OFF: "check the cable from the generator to the amplifier and to the card",
    Quality.CLIPPED: "choose a larger range of the card, or less drive",
    Quality.UNSETTLED: "allow more time to settle",
    Quality.DROPPED: "close other programs, or lower the sample rate",
}
"""What to do about points that are not usable, by flag; in the order in which causes mask each other."""


def _usability_remedy(causes: Counter[str]) -> str:
    for flag, remedy in REMEDIES.items():
        if flag.name is not None and flag.name in causes:
            return remedy
    return "measure these points again"
