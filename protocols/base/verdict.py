"""Verdict on a run: whether its result can be used, the reasons, and the checks behind it.

The status of a run states its end; the verdict states whether its result is usable. A protocol's `checks` compare figures of its
result with limits; `judge` adds the checks common to all protocols (usable points) and returns the worst.
"""

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from model import quantity_label, shown_unit
from protocols.base.quality import Quality, point_quality, remedy_for
from protocols.base.text import to_jsonable

if TYPE_CHECKING:
    from protocols.base.protocol import Protocol
    from protocols.base.records import EstimatedQuantity
    from protocols.base.reference import ReferenceModel


class RunStatus(StrEnum):
    """Status of a run. A file with `running` whose program is gone is a crashed run."""

    RUNNING = "running"
    COMPLETED = "completed"
    STOPPED = "stopped"
    FAILED = "failed"
    UNSAFE = "unsafe"


class Outcome(StrEnum):
    """Outcome of a verdict. The texts are stored in run files and printed by `--json`; they never change."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    """There is a result with a reason for doubt."""
    NO_RESULT = "no result"
    """Nothing usable was measured."""
    DID_NOT_PASS = "did not pass"  # noqa: S105 - no password
    """A figure of a check, such as the wiring check, lies outside its limits."""
    STOPPED = "stopped"
    FAILED = "failed"
    UNSAFE = "unsafe"
    """Rest could not be confirmed at the end."""
    NOT_JUDGED = "not judged"
    """A run of an earlier version, an imported run, or a run that has not ended."""

    @property
    def has_result(self) -> bool:
        """Whether the run gave a usable result."""
        return self in (Outcome.GOOD, Outcome.DOUBTFUL)


ALL_MEASURED = "all points measured"
"""Reason of a completed plan."""

STOP_CAUSE = " points: "
"""Prefix of the cause in the reason of a run that the operator stopped because of an exceeded level or a missing response."""

SEVERITY = (Outcome.GOOD, Outcome.DOUBTFUL, Outcome.NO_RESULT, Outcome.DID_NOT_PASS)
"""Outcomes of a completed run, the worst last."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """A figure of a result, its limits (None: open on that side), and the remedy if it lies outside them."""

    name: str
    value: float
    unit: str
    """Remedy; empty if the name suffices."""
    low: float | None
    high: float | None
    remedy: str
    consequence: Outcome = Outcome.DOUBTFUL
    """Outcome of the run if the figure lies outside its limits."""
    detail: str = ""
    """Points, weights or recordings of the figure; empty if the name states them."""

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
        return f"{self.figure}; {self.remedy}" if self.remedy else self.figure

    @property
    def figure(self) -> str:
        """Name, figure and limits; without a unit, the name."""
        factor, unit = shown_unit(self.unit)
        unit = f" {unit}".rstrip()
        figure = f"{factor * self.value:.4g}{unit}" if math.isfinite(self.value) else "not measurable"
        limits = " and ".join(
            f"{word} {factor * limit:.4g}{unit}"
            for word, limit in (("at least", self.low), ("at most", self.high))
            if limit is not None
        )
        of = f" ({self.detail})" if self.detail else ""
        return f"{self.name}{of}" + (f": {figure}, limit {limits}" if self.unit else "")


@dataclass(frozen=True, slots=True)
class Verdict:
    """Outcome of a run, its reasons as text, and every check, passed or not."""

    outcome: Outcome = Outcome.NOT_JUDGED
    reasons: tuple[str, ...] = ()
    checks: tuple[CheckResult, ...] = ()

    def describe(self, run_reason: str) -> str:
        """Return outcome, reasons and, if these do not imply it, the end of the run, as a line."""
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
            KeyError, TypeError, ValueError: the object is not a verdict.
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
        """Return the verdict of an incomplete run."""
        return cls(Outcome(status), (reason,), checks)


def judge(
    protocol: "Protocol",
    points: Sequence[Any],
    planned: int,
    reference: "ReferenceModel | None" = None,
    estimates: "Sequence[EstimatedQuantity] | None" = None,
) -> Verdict:
    """Return the verdict on a completed run. Pure, so that a run file gives the verdict of the live run.

    Args:
        protocol: the protocol with the parameters of the run.
        points: the valid points, superseded ones left out.
        planned: number of entries of the plan.
        reference: model of the free specimen, for protocols that compare with it.
        estimates: estimates from these points, if already computed.
    """
    identified = identification_checks(protocol, points, estimates)
    checks = (*usability_checks(points, planned), *identified, *protocol.checks(points))
    if reference is not None:
        checks += protocol.reference_checks(points, reference)
    failed = [check for check in checks if not check.passed]
    outcome = max((check.consequence for check in failed), key=SEVERITY.index, default=Outcome.GOOD)
    reasons = tuple(
        "; ".join([*(check.figure for check in same), *([remedy] if remedy else [])])
        for remedy, same in checks_by_remedy(failed).items()
    )
    return Verdict(outcome, reasons, checks)


def checks_by_remedy(checks: Iterable[CheckResult]) -> dict[str, list[CheckResult]]:
    """Return the checks grouped by remedy, in the order of the first of each group."""
    groups: dict[str, list[CheckResult]] = {}
    for check in checks:
        groups.setdefault(check.remedy, []).append(check)
    return groups


def judge_ended(
    status: RunStatus,
    reason: str,
    protocol: "Protocol",
    points: Sequence[Any],
    planned: int,
    reference: "ReferenceModel | None" = None,
    estimates: "Sequence[EstimatedQuantity] | None" = None,
) -> Verdict:
    """Return the verdict on a run that ended with `status` and `reason`; see `judge`. Pure.

    A run stopped because of an exceeded level or a missing response, without a usable point, has no result.
    """
    if status is RunStatus.COMPLETED:
        return judge(protocol, points, planned, reference, estimates)
    usable = any(point_quality(point).usable for point in points)
    if status is RunStatus.STOPPED and STOP_CAUSE in reason and not usable:
        return Verdict(Outcome.NO_RESULT, (reason,), usability_checks(points, planned))
    return Verdict.of_status(status, reason)


def identification_checks(
    protocol: "Protocol", points: Sequence[Any], estimates: "Sequence[EstimatedQuantity] | None" = None
) -> tuple[CheckResult, ...]:
    """Return the check that the usable points gave the estimates that the protocol promises."""
    if not any(point_quality(point).usable for point in points):
        return ()  # reported by the check of usable points
    promised = protocol.promised_estimates(points)
    identified = {each.name for each in (protocol.estimates(points) if estimates is None else estimates)}
    missing = [name for name in promised if name not in identified]
    if not promised:
        return ()
    name, identified_count = f"estimates identified of {len(promised)}", len(promised) - len(missing)
    remedy = "measure more points, or check the unusable ones"
    outcome = Outcome.DOUBTFUL if identified_count else Outcome.NO_RESULT
    detail = f"missing: {', '.join(map(quantity_label, missing))}" if missing else ""
    return (CheckResult(name, float(identified_count), "1", float(len(promised)), None, remedy, outcome, detail),)


def usability_checks(points: Sequence[Any], planned: int) -> tuple[CheckResult, ...]:
    """Return the checks common to all protocols: each entry has a point, and each point is usable."""
    flags = [point_quality(point) for point in points]
    usable = sum(flag.usable for flag in flags)
    causes = Counter(
        fault.name for flag in flags if not flag.usable for fault in flag & ~Quality.FACTS if fault.name is not None
    )
    detail = ", ".join(f"{n} {name.lower().replace('_', ' ')}" for name, n in causes.most_common())
    if missing := planned - len(points):
        detail = f"{detail}, {missing} without a point".removeprefix(", ")
    remedy = remedy_for(flag for flag in flags if not flag.usable)
    if usable:
        first = CheckResult(
            f"usable points of {planned}", float(usable), "1", float(planned), None, remedy, detail=detail
        )
    else:
        first = CheckResult(f"no usable point of {planned}", 0.0, "", 1.0, None, remedy, Outcome.NO_RESULT, detail)
    counts = ((sum(flag in each for each in flags), *texts) for flag, texts in QUESTIONABLE.items())
    return first, *(CheckResult(name, float(count), "1", None, 0.0, remedy) for count, name, remedy in counts if count)


QUESTIONABLE = {
    Quality.CALIBRATION_EXPIRED: (
        "points with an expired calibration",
        "calibrate the instrument that the log names, and add its certificate ('tactor-bench certificate add') or enter the sensor's dates on the page Bench",
    ),
    Quality.LEVEL_EXCEEDED: ("points in which an abort level was exceeded", "see the log for the level and its value"),
}
"""Name and remedy of the check of usable points with a flag."""
