"""Uncertainty budget of an identification as tables: sources of each uncertainty, and prior values."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import floor, isfinite, log10
from typing import Any

import numpy as np

from app.common import Column, Table
from app.identification.specimen_identification import IdentificationResult
from app.identification.specimen_sheet import sheet_unit
from model import QUANTITIES, EstimatedQuantity, format_with_uncertainty
from model.identification import (
    ErrorTarget,
    FrequencyResponseObservation,
    MassResonanceObservation,
    StaticLoadingObservation,
    UncertaintyBudget,
    VoltageStepsObservation,
    describe_cause,
    format_size,
    observed_values,
    parameter_spec,
)

MIN_SHARE = 0.01
"""Smallest share of the squared total uncertainty of a named source."""

OTHERS = "others"
"""Sources with smaller shares, together."""

SEEN_SIGMAS = 3.0
"""Smallest size of a described nonideality, in its standard uncertainties."""

CONTRADICTION_SIGMAS = 3.0
"""Smallest questionable correction of a prior value, in its standard uncertainties."""

MAX_REMAINING_SHARE = 0.99
"""Largest share of a prior value's uncertainty left by the runs for a test of the value."""
UNSTATED: tuple[tuple[ErrorTarget, tuple[type, ...], str], ...] = (
    (
        "displacement",
        (StaticLoadingObservation, VoltageStepsObservation, FrequencyResponseObservation),
        "gain of the sensor (gain_relative_uncertainty of [sensor])",
    ),
    ("delay", (FrequencyResponseObservation,), "delay of the sensor (delay_uncertainty_s of [sensor])"),
    (
        "volts",
        (VoltageStepsObservation, FrequencyResponseObservation),
        "slopes of the amplifier (slope_relative_uncertainty of [amplifier])",
    ),
    ("load", (StaticLoadingObservation,), "weights"),
    ("mass", (MassResonanceObservation,), "added masses (mass_offset of the specimen sheet)"),
)
"""Errors of instruments, the runs they act on, and where their uncertainty is stated."""


@dataclass(frozen=True, slots=True)
class BudgetBar:
    """Uncertainty of one parameter as a stacked bar."""

    name: str
    total: float | None
    """Relative to the value; None for a value of 0."""
    statistical: float | None
    shares: tuple[tuple[str, float], ...]
    """Sources with their shares of the squared total, the largest first; the smallest together as `others`."""

    @property
    def size_text(self) -> str:
        """Total and statistical uncertainty in percent of the value, both to two digits of the larger."""
        total, statistical = format_relative(self.total, self.statistical)
        return f"{total}, statistical {statistical}" if statistical else total


def format_relative(total: float | None, statistical: float | None) -> tuple[str, str]:
    """Format total and statistical uncertainty, relative, in percent and to two digits of the total; empty where one is unknown."""
    if total is None or not isfinite(total):
        return "", ""
    digits = max(0, 1 - floor(log10(100 * total))) if total > 0 else 1
    return f"{100 * total:.{digits}f} %", "" if statistical is None else f"{100 * statistical:.{digits}f} %"


def budget_bars(identification: IdentificationResult) -> tuple[BudgetBar, ...]:
    """Return the bars of the identified parameters; none where there is no source but noise."""
    budget = identification.budget
    if budget is None or len(budget.sources) < 2:
        return ()
    values = {e.name: e.value for e in identification.identified}
    return tuple(
        BudgetBar(
            name,
            abs(float(budget.total[i]) / values[name]) if values[name] else None,
            abs(float(budget.statistical[i]) / values[name]) if values[name] else None,
            _named_shares(budget, i, 0.0),
        )
        for name, i in identification.budget_rows.items()
    )


def largest_sources(bars: Sequence[BudgetBar]) -> tuple[str, ...]:
    """Return the sources in the bars, that with the largest sum of shares first, `others` last."""
    sums: dict[str, float] = {}
    for source, share in (each for bar in bars for each in bar.shares):
        sums[source] = sums.get(source, 0.0) + share
    return tuple(sorted(sums, key=lambda source: (source == OTHERS, -sums[source])))


def budget_tables(identification: IdentificationResult) -> Iterator[Table]:
    """Yield the sources of the uncertainty of each identified parameter, and the prior values."""
    budget, dimensions = identification.budget, identification.dimensions
    if budget is not None and len(budget.sources) > 1:
        at = [*identification.budget_rows.values()]
        yield Table(
            "uncertainties",
            "Where the uncertainties come from: shares of the squared total",
            (
                Column("name", "", [budget.names[i] for i in at], "parameter"),
                Column("statistical", "%", [_relative(identification, i, budget.statistical[i]) for i in at], format_spec=".2g"),
                Column("systematic", "%", [_relative(identification, i, budget.systematic[i]) for i in at], format_spec=".2g"),
                Column("total", "%", [_relative(identification, i, budget.total[i]) for i in at], format_spec=".2g"),
                Column("shares", "", [format_shares(budget, i) for i in at], "sources"),
            ),
        )  # fmt: skip
    yield from prior_tables(dimensions, identification.estimates)


def nonideality_tables(identification: IdentificationResult) -> Iterator[Table]:
    """Yield the table of nonidealities that were expected, with their meaning; none without any."""
    nonidealities, priors = identification.nonidealities, identification.priors
    assumed = {e.name for e in identification.assumed}
    if nonidealities:
        yield Table(
            "nonidealities",
            "Effects outside the beam model, fitted with it",
            (
                Column("name", "", [e.name for e in nonidealities], displayed=False),
                Column("effect", "", [shown_name(e.name) for e in nonidealities]),
                Column("expected", "", [format_size(*priors[e.name], e.unit) for e in nonidealities]),
                Column("found", "", [format_size(e.value, e.standard_error, e.unit) for e in nonidealities]),
                Column(
                    "words",
                    "",
                    [
                        _meaning(identification, e) or ("assumed" if e.name in assumed else "not seen")
                        for e in nonidealities
                    ],
                    "meaning",
                ),
                Column("value", "", [e.value for e in nonidealities], displayed=False),
                Column("standard_error", "", [e.standard_error for e in nonidealities], displayed=False),
                Column("unit", "", [e.unit for e in nonidealities], displayed=False),
            ),
        )


def nonideality_lines(identification: IdentificationResult) -> tuple[str, ...]:
    """Return the nonidealities that were seen, with their meaning, as text."""
    return tuple(filter(None, (_meaning(identification, e) for e in identification.nonidealities)))


def _meaning(identification: IdentificationResult, estimate: EstimatedQuantity) -> str:
    """Return the meaning of a nonideality; empty if it is not significant."""
    fit, expected = identification.joint_fit, identification.priors[estimate.name][0]
    if fit is None or abs(estimate.value - expected) <= SEEN_SIGMAS * estimate.standard_error:
        return ""
    return describe_cause(fit, estimate.name, estimate.value, estimate.standard_error)


def prior_tables(priors: Mapping[str, tuple[float, float]], estimates: Sequence[EstimatedQuantity]) -> Iterator[Table]:
    """Yield the table of prior values with their values after the fit; none without priors."""
    estimated = {e.name: e for e in estimates}
    names = [name for name in priors if name in estimated]
    if names:
        yield Table(
            "known",
            "Prior values, and values with the runs",
            (
                Column("name", "", names, "parameter"),
                Column("before", "", [_format(n, *priors[n]) for n in names]),
                Column("after", "", [_format(n, estimated[n].value, estimated[n].standard_error) for n in names]),
                Column("shown_unit", "", [sheet_unit(n)[1] for n in names], "unit"),
                Column(
                    "moved",
                    "",
                    [(estimated[n].value - priors[n][0]) / priors[n][1] for n in names],
                    "moved (uncertainties)",
                    format_spec="+z.1f",
                ),
                Column("known_value", "", [priors[n][0] for n in names], displayed=False),
                Column("known_uncertainty", "", [priors[n][1] for n in names], displayed=False),
                Column("value", "", [estimated[n].value for n in names], displayed=False),
                Column("standard_error", "", [estimated[n].standard_error for n in names], displayed=False),
                Column("unit", "", [estimated[n].unit for n in names], displayed=False),
            ),
        )


def _format(name: str, value: float, uncertainty: float) -> str:
    factor, _ = sheet_unit(name)
    return format_with_uncertainty(factor * value, factor * uncertainty)


def _relative(identification: IdentificationResult, at: int, uncertainty: float) -> float | None:
    value = identification.estimates[at].value
    return 100 * abs(float(uncertainty) / value) if value else None


def format_shares(budget: UncertaintyBudget, at: int) -> str:
    """Format the sources of one parameter's uncertainty, the largest first: `h_Al 71 %, L 20 %, noise 8 %`."""
    return ", ".join(f"{source} {100 * share:.0f} %" for source, share in _named_shares(budget, at))


def _named_shares(budget: UncertaintyBudget, at: int, least_rest: float = MIN_SHARE) -> tuple[tuple[str, float], ...]:
    shares = sorted(zip(budget.shares[:, at].tolist(), budget.sources, strict=True), reverse=True)
    named = [(shown_name(source), share) for share, source in shares if share >= MIN_SHARE]
    rest = sum(share for share, _ in shares if share < MIN_SHARE)
    return (*named, *([(OTHERS, rest)] if rest > least_rest else []))


def shown_name(name: str) -> str:
    """Return the symbol of a parameter that has one, as in the sheet and the options, else its name: `k2`, `flexibility of the clamp`."""
    quantity = QUANTITIES.get(name)
    return name if quantity is None or quantity.symbol else quantity.name


def budget_record(budget: UncertaintyBudget | None) -> dict[str, Any] | None:
    """Return a budget for JSON: by parameter and source, the standard uncertainty that it contributes, with totals."""
    if budget is None:
        return None
    return {
        name: {
            "unit": parameter_spec(name).unit,
            "statistical": float(budget.statistical[i]),
            "systematic": float(budget.systematic[i]),
            "total": float(budget.total[i]),
            "components": dict(zip(budget.sources, budget.components[:, i].tolist(), strict=True)),
        }
        for i, name in enumerate(budget.names)
    }


def unstated_errors(identification: IdentificationResult) -> tuple[str, ...]:
    """Return the quantities that count as exact for want of an uncertainty, with the place to state it."""
    runs, missing = identification.observations.runs, []
    for acts_on, kinds, text in UNSTATED:
        concerned = [run for run in runs if isinstance(run, kinds)]
        if acts_on == "delay":
            concerned = [run for run in concerned if np.iscomplexobj(observed_values(run)[0])]
        if acts_on == "mass" and "mass_offset" in identification.priors:
            continue
        stated = ({e.acts_on for e in run.shared_errors if not e.source} for run in concerned)
        if any(acts_on not in targets for targets in stated):
            missing.append(text)
    return tuple(missing)


def contradictions(identification: IdentificationResult) -> tuple[str, ...]:
    """Return the prior values contradicted by the runs, as text."""
    estimates, texts, fit = {e.name: e for e in identification.estimates}, [], identification.joint_fit
    for name, (value, uncertainty) in identification.priors.items():
        after = estimates.get(name)
        if after is None or fit is None or fit.degrees_of_freedom <= 0:
            continue
        at = fit.names.index(name)
        error = float(fit.covariance[at, at]) ** 0.5  # of a right model
        if not error < MAX_REMAINING_SHARE * uncertainty:
            continue
        sigmas = (after.value - value) / (uncertainty**2 - error**2) ** 0.5
        if abs(sigmas) > CONTRADICTION_SIGMAS:
            unit = f" {sheet_unit(name)[1]}".rstrip()
            texts.append(
                f"the runs contradict {name}: {_format(name, value, uncertainty)}{unit} was known, "
                f"{_format(name, after.value, after.standard_error)}{unit} fits, {abs(sigmas):.1f} standard uncertainties away: measure it again"
            )
    return tuple(texts)
