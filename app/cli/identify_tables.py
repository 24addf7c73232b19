"""What follows a joint fit, as tables: is the model adequate, what to measure next, how far a parameter can move.

What an identification found, as tables and sentences.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from app.cli.output import Answer, Column, Table, tracked
from app.common.formatting import uncertain
from app.identification.identify import Identified
from model.identification.adequacy import Adequacy
from model.identification.experiment_design import Expected, Proposal, candidates, next_best
from model.identification.fit_result import JointFit, chance
from model.identification.observations import Campaign, MassResonance, MembraneSag, observed
from model.identification.parameters import quantity
from model.identification.profile_likelihood import Profile, profile
from model.parameter_spec import ParameterError
from protocols.base.jsonable import plain

MOST = 10
"""Findings a person is shown."""


def findings(told: Adequacy) -> Iterator[Table]:
    """The first ways in which the runs do not follow the model; nothing where they do."""
    if not told.findings:
        return
    first, more = told.findings[:MOST], len(told.findings) - MOST
    yield Table(
        "findings",
        "How the runs depart from the model" + (f" (the first {MOST}; {more} more with --json)" if more > 0 else ""),
        (
            Column("kind", "", [f.kind for f in first]),
            Column("words", "", [f.words for f in first], "what is seen"),
            Column("probability", "", [chance(f.probability).removeprefix("p = ") for f in first], "by chance"),
        ),
    )


def proposed(fit: JointFit, parameter: str | None) -> tuple[Proposal, ...]:
    """What could be measured next, the best first, for one parameter or the one known worst.

    Raises:
        ParameterError: the parameter was not free.
    """
    return next_best(fit, candidates(fit, expected(fit.campaign)), parameter)


def expected(campaign: Campaign) -> Expected:
    """What further runs can be expected to do: what those that were done did, half of them better."""
    shares: list[float] = []
    for run in campaign.runs:
        if not isinstance(run, MassResonance | MembraneSag):
            values, errors = observed(run)
            shares += (np.abs(errors) / np.abs(values)).tolist()
    resonances = [e for run in campaign.of(MassResonance) for e in run.errors_hz[run.use]]
    usual = Expected(common=tuple(campaign.common.values()))
    relative = float(np.median(shares)) if shares else usual.relative
    return replace(
        usual,
        relative=relative,
        floor_m=usual.floor_m * relative / usual.relative,
        resonance_hz=float(np.median(resonances)) if resonances else usual.resonance_hz,
    )


def plans(every: Sequence[Proposal]) -> Table:
    """All proposals for one parameter."""
    best = every[0]
    return Table(
        "next",
        f"What to measure next for {best.parameter}, the most a minute first",
        (
            Column("run", "", [p.candidate.run.label for p in every]),
            Column("minutes", "min", [p.candidate.minutes for p in every], form=".3g"),
            Column("before", "%", [_known(p.before) for p in every], "error now", form=".2g"),
            Column("after", "%", [_known(p.after) for p in every], "error then", form=".2g"),
            Column(
                "less",
                "%",
                [100 * (1 - (p.after / p.before) ** (1 / p.candidate.minutes)) for p in every],
                "less a minute",
                form=".2g",
            ),
        ),
    )


def _known(share: float) -> float | str:
    return "not identified" if share > 1 else 100 * share


def profiled(fit: JointFit, names: Sequence[str], coverage: float) -> Table:
    """Profile intervals of parameters.

    Raises:
        ParameterError: one was not free.
    """
    for name in names:
        if name not in fit.parameters:
            raise ParameterError(
                f"--profile {name}: it was not free in this fit; choose from {', '.join(fit.parameters)}"
            )
    found: list[Profile] = [profile(fit, name, coverage) for name in tracked(names, "profiles")]
    errors = dict(zip(fit.names, (fit.stretch * fit.covariance.diagonal() ** 0.5).tolist(), strict=True))
    values = dict(zip(fit.names, fit.theta.tolist(), strict=True))
    return Table(
        "profiles",
        f"{100 * coverage:g} % intervals by profile: how far each can move while all others give way",
        (
            Column("name", "", [p.name for p in found], "parameter"),
            Column("low", "", [_end(p.low) for p in found], "from"),
            Column("value", "", [values[p.name] for p in found], form=".6g"),
            Column("high", "", [_end(p.high) for p in found], "to"),
            Column("unit", "", [quantity(p.name, fit.campaign).unit for p in found]),
            Column(
                "lopsided",
                "",
                [_lopsided(p, values[p.name], errors[p.name]) for p in found],
                "against the standard error",
            ),
        ),
    )


def _end(value: float | None) -> Any:
    return "open" if value is None else f"{value:.6g}"


def _lopsided(told: Profile, value: float, error: float) -> str:
    """Its two arms in standard errors."""
    arms = ["open" if end is None else f"{(end - value) / error:+.2f}" for end in (told.low, told.high)]
    return f"{arms[0]}, {arms[1]} standard errors"


ADEQUATE = {True: "adequate", False: "NOT ADEQUATE", None: "adequacy unknown"}


def answer_of(found: Identified) -> Answer:
    """Parameters with their errors, how well each run is explained, and what is wrong with the model."""
    simulated = ", SIMULATED" if found.campaign.simulated else ""
    method = {"joint": "joint fit of all runs", "chain": "the paper's chain"}[found.method]
    tables = [parameters(f"Specimen {found.specimen}: {method}{simulated}", found.estimates)]
    if found.misfits:
        runs = found.misfits
        tables.append(
            Table(
                "runs",
                "How well each run is explained",
                (
                    Column("run", "", [r.label for r in runs]),
                    Column("residuals", "", [r.points for r in runs]),
                    Column("chi_square", "", [r.chi_square for r in runs], "chi-square", form=".4g"),
                    Column("probability", "", [r.probability for r in runs], form=".2g"),
                    Column("outliers", "", [r.outliers for r in runs], "beyond 4 errors"),
                ),
            )
        )
    if found.validation:
        curves = found.validation
        tables.append(
            Table(
                "validation",
                "How well each curve is predicted",
                (
                    Column("run", "", [v.label for v in curves]),
                    Column("r", "", [v.r for v in curves], "Pearson's r", form=".5f"),
                    Column("p", "", [v.p for v in curves], form=".2g"),
                    Column("points", "", [v.points for v in curves]),
                ),
            )
        )
    told = [f"{found.verdict}.", *(f"not identifiable from these runs: {words}" for words in found.unidentified)]
    more: dict[str, Any] = {}
    if found.adequacy is not None:
        tables += findings(found.adequacy)
        told.insert(0, f"{ADEQUATE[found.adequacy.adequate]}: {found.adequacy.words}.")
        more = {"adequate": found.adequacy.adequate, "adequacy": found.adequacy.words}
        more["every_finding"] = [plain(finding) for finding in found.adequacy.findings]
    told += found.notes
    fixed = {name: value for name, value in found.fixed.items() if value is not None}
    more |= {
        "method": found.method,
        "simulated": found.campaign.simulated,
        "unidentified": list(found.unidentified),
    }
    more |= {"covariance": np.asarray(found.covariance).tolist(), "verdict": found.verdict}
    return Answer("identify", fixed, tuple(tables), tuple(told), more=more)


def parameters(title: str, estimates: Sequence[Any]) -> Table:
    """Estimates, one a row: value with error and unit, relative error, and the runs they are from."""
    return Table(
        "parameters",
        title,
        (
            Column("name", "", [e.name for e in estimates], "parameter"),
            Column("estimate", "", [uncertain(e.value, e.standard_error, "1") for e in estimates], "value"),
            Column("unit", "", [e.unit for e in estimates]),
            Column("relative", "%", [_relative(e) for e in estimates], "error", "%", form=".2g"),
            Column("value", "", [e.value for e in estimates], told=False),
            Column("standard_error", "", [e.standard_error for e in estimates], told=False),
            Column("source", "", [", ".join(e.source) for e in estimates], "from"),
        ),
    )


def _relative(estimate: Any) -> float | None:
    return abs(estimate.standard_error / estimate.value) if estimate.value else None
