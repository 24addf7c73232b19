"""Result of an identification as tables: estimates, misfits, adequacy, profiles, proposals."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from app.cli.output import CommandResult
from app.common import Column, Table, track
from app.identification import (
    ADEQUACY_TEXT,
    IdentificationResult,
    assumed_line,
    budget_record,
    budget_tables,
    contradictions,
    dimensions_line,
    held_parameters,
    mounting_line,
    mounting_tables,
    nonideality_tables,
    short_run_name,
    steps_line,
    unstated_errors,
)
from model import ParameterError, format_value, format_with_uncertainty
from model.identification import (
    Adequacy,
    DecayPoleObservation,
    ExpectedPrecision,
    Explanation,
    ExtensionStep,
    FrequencyResponseObservation,
    JointFit,
    MassResonanceObservation,
    MembraneSagObservation,
    ObservationSet,
    ProfileInterval,
    Proposal,
    default_candidates,
    format_p_value,
    observed_values,
    parameter_spec,
    profile_interval,
    rank_candidates,
)
from protocols.base import to_jsonable

FAR_SIGMAS = 2.0
"""Smallest difference between chain and joint fit, in total uncertainties, that a sentence states."""
MAX_FINDINGS = 10
"""Findings that are displayed."""


def adequacy_tables(adequacy: Adequacy) -> Iterator[Table]:
    """Yield the tables of causes of a misfit, and of the first discrepancies between runs and model, if there are any."""
    if adequacy.diagnosis is not None and (explanations := adequacy.diagnosis.explanations):
        likeliest = adequacy.diagnosis.likeliest
        yield Table(
            "causes",
            f"Possible causes: {adequacy.diagnosis.tried} were compared",
            (
                Column("cause", "", [e.cause.title for e in explanations]),
                Column("words", "", [e.cause_text for e in explanations], "meaning"),
                Column(
                    "chi_square",
                    "",
                    [e.chi_square for e in explanations],
                    "chi-square with the cause",
                    format_spec=".5g",
                ),
                Column("degrees_of_freedom", "", [e.degrees_of_freedom for e in explanations], "degrees of freedom"),
                Column("log_odds", "", [e.log_odds for e in explanations], "ln odds", format_spec=".3g"),
                Column("check", "", [e.check for e in explanations], "decisive check"),
                Column("likely", "", ["yes" if e in likeliest else "no" for e in explanations], "likely"),
            ),
        )
    if not adequacy.findings:
        return
    first, more = adequacy.findings[:MAX_FINDINGS], len(adequacy.findings) - MAX_FINDINGS
    yield Table(
        "findings",
        "Discrepancies between runs and model"
        + (f" (the first {MAX_FINDINGS}; {more} more with --json)" if more > 0 else ""),
        (
            Column("kind", "", [f.kind for f in first]),
            Column("words", "", [f.text for f in first], "discrepancy"),
            Column("probability", "", [format_p_value(f.probability).removeprefix("p = ") for f in first], "by chance"),
        ),
    )


def also_hint(likeliest: Sequence[Explanation]) -> str:
    """Return how to repeat the fit with the likeliest cause; empty if it is no parameter."""
    first = likeliest[0].cause
    if not first.proposable:
        return ""
    return f"fit with the first cause: identify --also {first.name}; with a prior value: --prior '{first.name}=VALUE+-ERROR'"


def steps_table(first: JointFit, steps: Sequence[ExtensionStep]) -> Table:
    """Return the steps of a stepwise fit: added effect, chi-square with it, and the parameters that it moved."""
    fits = [first, *(step.fit for step in steps)]
    moved = [
        ", ".join(
            f"{s.name} {s.before:.4g} to {format_with_uncertainty(s.after, s.standard_error)}"
            for s in step.explanation.shifts
        )
        for step in steps
    ]
    return Table(
        "steps",
        "Nonidealities added in turn, each proposed by the test of the fit before it",
        (
            Column("step", "", list(range(len(fits)))),
            Column("added", "", ["", *(step.name for step in steps)]),
            Column("words", "", ["", *(step.explanation.cause_text for step in steps)], "meaning"),
            Column("chi_square", "", [fit.chi_square for fit in fits], "chi-square", format_spec=".5g"),
            Column("degrees_of_freedom", "", [fit.degrees_of_freedom for fit in fits], "degrees of freedom"),
            Column("adequate", "", ["no", *(ADEQUACY_TEXT[step.adequacy.adequate] for step in steps)]),
            Column("moved", "", ["", *moved]),
        ),
    )


def rank_proposals(fit: JointFit, parameter: str | None) -> tuple[Proposal, ...]:
    """Rank the next measurements, the best first, for one parameter or the one with the largest error.

    Raises:
        ParameterError: the parameter was not free.
    """
    return rank_candidates(fit, default_candidates(fit, expected_precision(fit.observations)), parameter)


def expected_precision(observations: ObservationSet) -> ExpectedPrecision:
    """Return the precision to expect of further runs: the median of the existing ones."""
    shares: list[float] = []
    for run in observations.runs:
        swept = isinstance(run, FrequencyResponseObservation) and run.swept
        if not swept and not isinstance(run, MassResonanceObservation | MembraneSagObservation | DecayPoleObservation):
            values, errors = observed_values(run)
            shares += (np.abs(errors) / np.abs(values)).tolist()
    resonances = [e for run in observations.of_type(MassResonanceObservation) for e in run.errors_hz[run.usable]]
    instruments = tuple(error for error in observations.shared_errors.values() if not error.source)
    usual = ExpectedPrecision(shared_errors=instruments)
    relative = float(np.median(shares)) if shares else usual.relative_error
    return replace(
        usual,
        relative_error=relative,
        floor_m=usual.floor_m * relative / usual.relative_error,
        resonance_hz=float(np.median(resonances)) if resonances else usual.resonance_hz,
    )


def proposals_table(proposals: Sequence[Proposal]) -> Table:
    """Return the table of all proposals for one parameter."""
    best = proposals[0]
    return Table(
        "next",
        f"Next measurements for {best.parameter}, in order of the gain per minute",
        (
            Column("run", "", [p.candidate.run.label for p in proposals]),
            Column("minutes", "min", [p.candidate.minutes for p in proposals], format_spec=".3g"),
            Column("before", "%", [_format_share(p.error_before) for p in proposals], "error now", format_spec=".2g"),
            Column("after", "%", [_format_share(p.error_after) for p in proposals], "error then", format_spec=".2g"),
            Column(
                "less",
                "%",
                [100 * (1 - (p.error_after / p.error_before) ** (1 / p.candidate.minutes)) for p in proposals],
                "gain per minute",
                format_spec=".2g",
            ),
        ),
    )


def _format_share(share: float) -> float | str:
    return "not identified" if share > 1 else 100 * share


def profile_table(fit: JointFit, names: Sequence[str], coverage: float) -> Table:
    """Return the profile intervals of parameters.

    Raises:
        ParameterError: one was not free.
    """
    for name in names:
        if name not in fit.free_parameters:
            raise ParameterError(
                f"--profile {name}: this parameter was not free in the fit; choose from {', '.join(fit.free_parameters)}"
            )
    intervals: list[ProfileInterval] = [profile_interval(fit, name, coverage) for name in track(names, "profiles")]
    errors = dict(zip(fit.names, (fit.enlarged_covariance.diagonal() ** 0.5).tolist(), strict=True))
    values = dict(zip(fit.names, fit.theta.tolist(), strict=True))
    return Table(
        "profiles",
        f"{100 * coverage:g} % intervals by profile likelihood, all other parameters fitted anew",
        (
            Column("name", "", [p.name for p in intervals], "parameter"),
            Column("low", "", [_format_limit(p.low) for p in intervals], "from"),
            Column("value", "", [values[p.name] for p in intervals], format_spec=".6g"),
            Column("high", "", [_format_limit(p.high) for p in intervals], "to"),
            Column("unit", "", [parameter_spec(p.name, fit.observations).unit for p in intervals]),
            Column(
                "lopsided",
                "",
                [_format_arms(p, values[p.name], errors[p.name]) for p in intervals],
                "ratio to the standard error",
            ),
        ),
    )


def _format_limit(value: float | None) -> Any:
    return "open" if value is None else f"{value:.6g}"


def _format_arms(profile_: ProfileInterval, value: float, error: float) -> str:
    """Return the two arms of the interval in standard errors."""
    arms = ["open" if end is None else f"{(end - value) / error:+.2f}" for end in (profile_.low, profile_.high)]
    return f"{arms[0]}, {arms[1]} standard errors"


def identification_command_result(identification: IdentificationResult) -> CommandResult:
    """Return parameters with their errors, the misfit of each run, and the adequacy of the model."""
    unstated = unstated_errors(identification)
    heading = [
        assumed_line(identification),
        dimensions_line(identification, f"'tactor-bench specimen new {identification.specimen}' writes one"),
        held_parameters(identification, "--prior gives a value its uncertainty"),
        f"exact for want of a stated uncertainty: {', '.join(unstated)}." if unstated else "",
        mounting_line(identification),
    ]
    return CommandResult(
        "identify",
        {name: value for name, value in identification.fixed.items() if value is not None},
        tuple(_identification_tables(identification)),
        tuple(_identification_notes(identification)),
        extra={
            **_adequacy_record(identification),
            "method": identification.method,
            "simulated": identification.observations.simulated,
            "unidentified": list(identification.unidentified),
            "covariance_names": [e.name for e in identification.estimates],
            "covariance": np.asarray(identification.covariance).tolist(),
            "verdict": identification.verdict,
            "budget": budget_record(identification.budget),
            "unstated": list(unstated),
            "contradictions": list(contradictions(identification)),
            "dimensions": "" if identification.sheet is None else identification.sheet.description,
        },
        heading=tuple(filter(None, heading)),
    )


def _identification_tables(identification: IdentificationResult) -> Iterator[Table]:
    """Yield estimates, uncertainty budget, misfits, validation, nonidealities, steps and discrepancies, where there are any."""
    simulated = ", SIMULATED" if identification.observations.simulated else ""
    method = {"joint": "joint fit of all runs", "chain": "the paper's chain"}[identification.method]
    title = f"Specimen {identification.specimen}: {method}{simulated}"
    yield estimate_table(title, identification.identified, identification.statistical_errors)
    yield from budget_tables(identification)
    if runs := identification.misfits:
        yield Table(
            "runs",
            "How well each run is explained",
            (
                Column("run", "", [r.label for r in runs]),
                Column("residuals", "", [len(r.values) for r in runs]),
                Column("chi_square", "", [r.chi_square for r in runs], "chi-square", format_spec=".4g"),
                Column("probability", "", [r.p_value for r in runs], format_spec=".2g"),
                Column("outliers", "", [len(r.outliers) for r in runs], "beyond 4 errors"),
                Column("error_scale", "", [r.error_scale for r in runs], "errors enlarged", format_spec=".3g"),
            ),
        )
    if curves := identification.validation:
        yield Table(
            "validation",
            "How well each curve is predicted",
            (
                Column("run", "", [v.label for v in curves]),
                Column("r", "", [v.r for v in curves], "Pearson's r", format_spec=".5f"),
                Column("p", "", [v.p for v in curves], format_spec=".2g"),
                Column("points", "", [v.points for v in curves]),
            ),
        )
    if differences := identification.joint_differences:
        yield Table(
            "joint",
            "How far the chain is from the joint fit, and why",
            (
                Column("name", "", [d.name for d in differences], "parameter"),
                Column("difference", "%", [100 * d.share for d in differences], format_spec="+.2g"),
                Column(
                    "sigmas",
                    "",
                    [d.sigmas for d in differences],
                    "in total uncertainties of the joint fit",
                    format_spec="+.2g",
                ),
                Column("reasons", "", [d.reasons for d in differences], "left out by the chain, or held"),
            ),
        )
    yield from nonideality_tables(identification)
    yield from mounting_tables(identification)
    if identification.first_fit is not None and identification.steps:
        yield steps_table(identification.first_fit, identification.steps)
    if identification.adequacy is not None:
        yield from adequacy_tables(identification.adequacy)


def _identification_notes(identification: IdentificationResult) -> Iterator[str]:
    adequacy = identification.adequacy
    if adequacy is not None:
        yield f"{ADEQUACY_TEXT[adequacy.adequate]}: {adequacy.message}."
        if identification.steps:
            yield steps_line(identification, also="identify --also", plain="--plain")
    yield from (f"{text}." for text in contradictions(identification))
    yield f"{identification.verdict}."
    yield from (f"not identifiable from these runs: {text}" for text in identification.unidentified)
    if adequacy is not None:
        if adequacy.diagnosis is not None and (likeliest := adequacy.diagnosis.likeliest) and also_hint(likeliest):
            yield also_hint(likeliest)
        yield from (f"{error.text}." for error in adequacy.undecidable)
    for d in identification.joint_differences:
        if abs(d.sigmas) > FAR_SIGMAS:
            yield f"{d.name} of the chain is {100 * d.share:+.2g} % off the joint fit, {abs(d.sigmas):.2g} of its total uncertainties: {d.reasons}."
    yield from identification.notes


def _adequacy_record(identification: IdentificationResult) -> dict[str, Any]:
    """Return the adequacy of a joint fit for JSON; empty without a joint fit."""
    adequacy = identification.adequacy
    if adequacy is None:
        return {}
    return {
        "adequate": adequacy.adequate,
        "adequacy": adequacy.message,
        "every_finding": [to_jsonable(finding) for finding in adequacy.findings],
        **({"proposed": [step.name for step in identification.steps]} if identification.steps else {}),
    }


def estimate_table(title: str, estimates: Sequence[Any], statistical: Mapping[str, float] | None = None) -> Table:
    """Return a table of estimates: value with total uncertainty and unit, relative uncertainties, and source runs.

    Args:
        title: of the table.
        estimates: the parameters.
        statistical: part of the uncertainty by the scatter of the points, by name; None or {} if unknown.
    """
    relative_errors = [abs(e.standard_error / e.value) if e.value else None for e in estimates]
    parts = [(statistical or {}).get(e.name) for e in estimates]
    scatter = (
        Column(
            "relative_statistical",
            "%",
            [part and abs(part / e.value) if e.value else None for part, e in zip(parts, estimates, strict=True)],
            "statistical",
            "%",
            format_spec=".2g",
        ),
        Column("statistical_error", "", parts, displayed=False),
    )
    return Table(
        "parameters",
        title,
        (
            Column("name", "", [e.name for e in estimates], "parameter"),
            Column("estimate", "", list(map(format_value, estimates)), "value"),
            Column("unit", "", [e.unit for e in estimates], displayed=False),
            Column("relative", "%", relative_errors, "total" if statistical else "error", "%", format_spec=".2g"),
            Column("value", "", [e.value for e in estimates], displayed=False),
            Column("standard_error", "", [e.standard_error for e in estimates], displayed=False),
            *(scatter if statistical else ()),
            Column("source", "", [", ".join(e.source) for e in estimates], displayed=False),
            Column(
                "determined_by",
                "",
                [", ".join(dict.fromkeys(map(short_run_name, e.source))) for e in estimates],
                "determined by",
            ),
        ),
    )
