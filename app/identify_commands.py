"""What `tactor-bench identify`, `compare` and `calibration` do."""

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from app import calibrations
from app.answer import Answer, Column, Table, deliver
from app.calibrations import CalibrationError, Calibrations
from app.commands import version
from app.config import AmplifierTable
from app.exits import UsageError
from app.identifying import Identified, identify
from app.observing import ObservingError
from app.units import UnitError, to_number
from app.words import uncertain
from model.amplifier import AmplifierMap
from model.identification.estimates import Calibration, changes
from model.identification.names import quantity
from model.quantity import ParameterError
from protocols.layout import ENTRY
from protocols.quality import usable
from protocols.runreader import Run, RunError


def identify_runs(options: argparse.Namespace) -> int:
    """`tactor-bench identify RUN...`."""
    if options.method == "chain" and (options.free or options.fixed or options.robust):
        raise UsageError("--free, --fix and --robust are for the joint fit; the chain's steps are the paper's")
    free = [name.strip() for name in options.free.split(",") if name.strip()] if options.free else None
    fixed = dict(_fixed(text) for text in options.fixed)
    try:
        found = identify(
            options.runs,
            options.method,
            free,
            fixed,
            "cauchy" if options.robust else "linear",
            _amplifier(options.runs),
        )
    except (ObservingError, ParameterError, ValueError) as error:
        raise UsageError(str(error)) from None
    notes = [*found.notes]
    if options.accept:
        notes.append(_accept(found, options))
    return deliver(_answer(found, notes), options)


def compare_runs(options: argparse.Namespace) -> int:
    """`tactor-bench compare A B`."""
    try:
        with Run(options.first) as a, Run(options.second) as b:
            return deliver(_comparison(a, b), options)
    except (RunError, ValueError) as error:
        raise UsageError(str(error)) from None


def calibration(options: argparse.Namespace) -> int:
    """`tactor-bench calibration show|diff|use SPECIMEN`."""
    try:
        known = calibrations.read(options.folder, options.specimen)
        match options.what:
            case "show":
                return deliver(_shown(known.get(options.version), known), options)
            case "diff":
                return deliver(_difference(known.get(options.first), known.get(options.second)), options)
            case _:
                chosen = known.get(options.version)
                calibrations.write(options.folder, options.specimen, replace(known, active=chosen.version))
                return deliver(_shown(chosen, replace(known, active=chosen.version)), options)
    except CalibrationError as error:
        raise UsageError(f"specimen {options.specimen}: {error}") from None


def _fixed(text: str) -> tuple[str, float]:
    name, equals, value = text.partition("=")
    if not equals:
        raise UsageError(f"--fix {text}: write NAME=VALUE, for example --fix k2=8.7e-3")
    try:
        return name.strip(), to_number(value.strip(), quantity(name.strip()).unit)
    except (UnitError, ParameterError) as error:
        raise UsageError(f"--fix {text}: {error}") from None


def _amplifier(paths: Sequence[Path]) -> AmplifierMap:
    """The amplifier as it was in these runs: its map is copied into every run file."""
    maps = []
    for path in paths:
        try:
            with Run(path) as run:
                maps.append(AmplifierTable.of(run.configuration).map)
        except RunError as error:
            raise UsageError(str(error)) from None
    if any(each != maps[0] for each in maps):
        raise UsageError("these runs were made with differently configured amplifiers: identify them by themselves")
    return maps[0]


def _accept(found: Identified, options: argparse.Namespace) -> str:
    folder = options.runs[0].parent
    try:
        known = calibrations.read(folder, found.specimen)
        number = max((each.version for each in known.versions), default=0) + 1
        accepted = Calibration(
            specimen=found.specimen,
            version=number,
            estimates=found.estimates,
            covariance=tuple(tuple(row) for row in np.asarray(found.covariance).tolist()),
            method=found.method,
            runs=tuple(path.name for path in options.runs),
            code=version(),
            accepted_at=datetime.now(UTC).isoformat(timespec="seconds"),
            accepted_by=options.by,
            simulated=found.campaign.simulated,
            fixed=dict(found.fixed),
            note=options.note,
        )
        path = calibrations.write(folder, found.specimen, Calibrations((*known.versions, accepted), number))
    except (CalibrationError, ParameterError) as error:
        raise UsageError(str(error)) from None
    return f"accepted as version {number} of {found.specimen}, now active, in {path}"


def _answer(found: Identified, notes: Sequence[str]) -> Answer:
    simulated = ", SIMULATED" if found.campaign.simulated else ""
    method = {"joint": "joint fit of all runs", "chain": "the paper's chain"}[found.method]
    tables = [_parameters(f"Specimen {found.specimen}: {method}{simulated}", found.estimates)]
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
    told = [
        f"{found.verdict}.",
        *(f"not identifiable from these runs: {words}" for words in found.unidentified),
        *notes,
    ]
    fixed = {name: value for name, value in found.fixed.items() if value is not None}
    more: dict[str, Any] = {
        "method": found.method,
        "simulated": found.campaign.simulated,
        "unidentified": list(found.unidentified),
    }
    more |= {"covariance": np.asarray(found.covariance).tolist(), "verdict": found.verdict}
    return Answer("identify", fixed, tuple(tables), tuple(told), more=more)


def _parameters(title: str, estimates: Sequence[Any]) -> Table:
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


def _shown(one: Calibration, known: Calibrations) -> Answer:
    simulated = ", SIMULATED" if one.simulated else ""
    active = "active" if one.version == known.active else f"version {known.active} is active"
    title = f"Specimen {one.specimen}, version {one.version} ({active}){simulated}"
    notes = [
        f"{one.method}, accepted {one.accepted_at} by {one.accepted_by or 'nobody named'}, program {one.code}",
        f"from {', '.join(one.runs)}",
    ]
    return Answer(
        "calibration show",
        {name: value for name, value in one.fixed.items() if value is not None},
        (_parameters(title, one.estimates),),
        (*notes, *([one.note] if one.note else [])),
        more={"version": one.version, "active": known.active, "record": one.as_record()},
    )


def _difference(before: Calibration, after: Calibration) -> Answer:
    every = changes(before, after)
    table = Table(
        "changes",
        f"Specimen {after.specimen}: version {before.version} to {after.version}",
        (
            Column("name", "", [c.name for c in every], "parameter"),
            Column("before", "", [c.before for c in every]),
            Column("after", "", [c.after for c in every]),
            Column("unit", "", [c.unit for c in every]),
            Column("standard_errors", "", [c.standard_errors for c in every], "in standard errors", form="+.1f"),
        ),
    )
    return Answer("calibration diff", {}, (table,))


def _comparison(a: Run, b: Run) -> Answer:
    if a.protocol != b.protocol:
        raise ValueError(f"{a.path.name} is a {a.protocol} and {b.path.name} a {b.protocol}: compare runs of one kind")
    from protocols.registry import PROTOCOLS

    kind = PROTOCOLS.get(a.protocol)
    if kind is None:
        raise ValueError(f"{a.path.name} is a run of '{a.protocol}', a protocol that is not known here")
    x, y = kind.axes
    units, left, right = a.units(), _usable(a), _usable(b)
    shared = [entry for entry in left if entry in right]
    if not shared:
        raise ValueError("these runs have no usable point of the same entry in common")
    rows: dict[str, list[float | None]] = {"x": [], "first": [], "second": [], "difference": [], "errors": []}
    for entry in shared:
        one, two = left[entry], right[entry]
        error = math.hypot(one.get(f"{y}_errors", 0.0), two.get(f"{y}_errors", 0.0))
        change = two[y] - one[y]
        values = (one[x], one[y], two[y], change, change / error if error > 0 else None)
        for name, value in zip(rows, values, strict=True):
            rows[name].append(value)
    shown = {"m": "µm"}.get(units[y], "")
    table = Table(
        "points",
        f"{kind.title}: {b.path.name} less {a.path.name}",
        (
            Column(x, units[x].removesuffix("1"), rows["x"]),
            Column(f"{y} first", units[y], rows["first"], shown=shown),
            Column(f"{y} second", units[y], rows["second"], shown=shown),
            Column("difference", units[y], rows["difference"], shown=shown, form="+.3g"),
            Column("standard errors", "", rows["errors"], form="+.1f"),
        ),
    )
    told = [v for v in rows["errors"] if v is not None]
    words = f"{len(shared)} points in common"
    if told:
        chi = sum(v * v for v in told)
        words += f"; chi-square of the differences {chi:.1f} for {len(told)} points, statistical errors only"
    return Answer("compare", {}, (table,), (words,))


def _usable(run: Run) -> dict[int, dict[str, float]]:
    """The usable points by entry, one-valued columns only."""
    columns = run.points()
    rows: dict[int, dict[str, float]] = {}
    for at in np.flatnonzero(usable(columns["quality"])):
        rows[int(columns[ENTRY][at])] = {
            name: float(values[at]) for name, values in columns.items() if values.ndim == 1
        }
    return rows
