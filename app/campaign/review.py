"""Review of a campaign's run before it is accepted: its values beside limits, the result before, the paper and other specimens."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from app.archive import Catalogue, LoadedRun, RunSummary, load_run, read_run_summary
from app.common import CheckRow, Severity, check_row, number_text, pluralize
from model import (
    AmplifierMap,
    EstimatedQuantity,
    Membrane,
    Tactor,
    current_name,
    format_value,
    quantity_label,
    shown_unit,
)
from protocols.base import Quality

MAX_OTHERS = 3
"""Other specimens whose value is written out; of more, the range."""


@dataclass(frozen=True, slots=True)
class ReviewRow:
    """One quantity of a result as texts; empty where there is nothing to compare with."""

    name: str
    value: str
    """With its statistical standard error."""
    limits: str = ""
    passed: bool = True
    before: str = ""
    """Value of the earlier result, and the change."""
    paper: str = ""
    others: str = ""
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class QualityIndicator:
    """A quality indicator of a run: usable points, flags, checks or coherence."""

    text: str
    severity: Severity


@dataclass(frozen=True, slots=True)
class ResultReview:
    """A run with all that its values are compared with."""

    run: LoadedRun
    rows: tuple[ReviewRow, ...]
    indicators: tuple[QualityIndicator, ...]
    before: str = ""
    """Name of the earlier result's file; empty without one."""


def review_run(path: Path, before: Path | None, amplifier: AmplifierMap) -> ResultReview:
    """Read a run, the result before it, and the results of other specimens in the same folder.

    Raises:
        RunReadError: the run cannot be read.
    """
    run = load_run(path, with_traces=False)
    earlier = read_run_summary(before, before.name) if before is not None and before != path else None
    return ResultReview(
        run,
        review_rows(run, earlier, _other_results(path.parent, run), paper_values(amplifier)),
        quality_indicators(run),
        earlier.name if earlier is not None else "",
    )


def review_rows(
    run: LoadedRun, earlier: RunSummary | None, others: Sequence[RunSummary], paper: Mapping[str, float]
) -> tuple[ReviewRow, ...]:
    """Return a row for every estimate, and one for every check that is not of an estimate; failed checks come first."""
    earlier_estimates = {} if earlier is None else {e.name: e for e in earlier.record.estimates}
    checks = {current_name(check.name): check for check in run.record.verdict.checks}
    rows = []
    for estimate in run.record.estimates:
        row = ReviewRow(
            quantity_label(estimate.name),
            format_value(estimate),
            before=_compare(estimate, earlier_estimates.get(estimate.name)),
            paper=_paper_text(estimate, paper),
            others=_others_text(estimate, others),
        )
        check = checks.pop(estimate.name, None)
        rows.append(row if check is None else _with_limits(row, check_row(check)))
    rows += [
        _with_limits(ReviewRow(check.name, f"{check.figure} {check.unit}".strip()), check)
        for check in map(check_row, checks.values())
    ]
    return tuple(sorted(rows, key=lambda row: row.passed))


def _with_limits(row: ReviewRow, check: CheckRow) -> ReviewRow:
    limits = f"{check.limits} {check.unit}".strip()
    return replace(row, limits=limits, passed=check.passed, remedy=check.remedy)


def quality_indicators(run: LoadedRun) -> tuple[QualityIndicator, ...]:
    """Return the quality indicators of a run: usable points, flags, checks, coherence."""
    flags = [Quality(point.quality) for point in run.points]
    usable = sum(flag.usable for flag in flags)
    severity = Severity.SUCCESS if usable == len(flags) else Severity.WARNING if usable else Severity.ERROR
    indicators = [QualityIndicator(f"{usable} of {pluralize(len(flags), 'point')} usable", severity)] if flags else []
    facts = Quality.SIMULATED | Quality.IMPORTED
    counts = Counter((one.name or "").lower().replace("_", " ") for flag in flags for one in flag & ~facts)
    indicators += [QualityIndicator(f"{count} {name}", Severity.WARNING) for name, count in counts.items()]
    if checks := run.record.verdict.checks:
        passed = len(checks) - len(run.record.verdict.failed_checks)
        severity = Severity.SUCCESS if passed == len(checks) else Severity.ERROR
        indicators.append(QualityIndicator(f"{passed} of {pluralize(len(checks), 'check')} passed", severity))
    coherence = [
        float(p.coherence) for p, flag in zip(run.points, flags, strict=True) if flag.usable and hasattr(p, "coherence")
    ]
    if coherence:
        indicators.append(QualityIndicator(f"lowest coherence {min(coherence):.3f}", Severity.INFO))
    return tuple(indicators)


def paper_values(amplifier: AmplifierMap) -> dict[str, float]:
    """Return the model's values with the paper's Table I for the estimates of a free tactor and a membrane, by name, SI."""
    from model.response import load_compliance, poles, voltage_gain  # slow to load

    tactor = Tactor()
    pole = poles(tactor)[0]
    damping = -float(pole.real) / float(abs(pole))
    gain = abs(float(voltage_gain(tactor)))
    values = {
        "natural_frequency": float(abs(pole)) / (2 * math.pi),
        "damped_frequency": float(pole.imag) / (2 * math.pi),
        "damping_ratio": damping,
        "quality_factor": 0.5 / damping,
        "E_m": Membrane().E_m,
    }
    for side, slope in (("above", amplifier.slope_above), ("below", amplifier.slope_below)):
        values[f"static_gain_{side}_rest"] = gain * slope
    values["compliance"] = float(load_compliance(tactor))
    return values


def _paper_text(estimate: EstimatedQuantity, paper: Mapping[str, float]) -> str:
    value = paper.get(estimate.name.partition(",")[0])
    if value is None:
        return ""
    factor, unit = shown_unit(estimate.unit, estimate.name)
    return f"{factor * value:.5g} {unit} ({_percent(estimate.value, value)})"


def _compare(estimate: EstimatedQuantity, earlier: EstimatedQuantity | None) -> str:
    if earlier is None or earlier.unit != estimate.unit:
        return ""
    change = f" ({_percent(estimate.value, earlier.value)})" if earlier.value else ""
    return f"{format_value(earlier)}{change}"


def _percent(value: float, reference: float) -> str:
    """Return the deviation from a reference: `+1.25 %`, `0.00 %`."""
    percent = round(100 * (value / reference - 1), 2)
    return f"{percent:+.2f} %".replace("-", "−") if percent else "0.00 %"


def _others_text(estimate: EstimatedQuantity, others: Iterable[RunSummary]) -> str:
    factor, unit = shown_unit(estimate.unit, estimate.name)
    values = {
        run.specimen: factor * each.value
        for run in others
        for each in run.record.estimates
        if (each.name, each.unit) == (estimate.name, estimate.unit)
    }
    if not values:
        return ""
    if len(values) > MAX_OTHERS:
        return f"{len(values)} from {number_text(min(values.values()), 4)} to {number_text(max(values.values()), 4)} {unit}".strip()
    return ", ".join(f"{name} {number_text(value, 4)}" for name, value in values.items()) + f" {unit}".rstrip()


def _other_results(folder: Path, run: LoadedRun) -> list[RunSummary]:
    """Return the newest result of every other specimen by the same protocol, as far as the catalogue knows the folder."""
    newest: dict[str, RunSummary] = {}
    for each in Catalogue(folder).entries():  # newest first
        same = each.protocol == run.record.protocol and bool(each.simulated) is run.record.simulated and each.has_result
        if same and each.specimen != run.record.specimen:
            newest.setdefault(each.specimen, each)
    return list(newest.values())
