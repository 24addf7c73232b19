"""What an identification found, as tables and sentences."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from app.answer import Answer, Column, Table
from app.fit_answer import findings
from app.identifying import Identified
from app.words import uncertain
from protocols.plain import plain

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
