"""What `tactor-bench identify` and `calibration` do."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from app import calibrations
from app.answer import Answer, Column, Table, deliver, tracked
from app.calibrations import CalibrationError, Calibrations
from app.commands import version
from app.config import AmplifierTable, ConfigError
from app.corrected import Correction
from app.exits import UsageError
from app.fit_answer import findings, plans, profiled, proposed
from app.identify_parser import WORST
from app.identifying import Identified, identify
from app.observing import ObservingError
from app.units import UnitError, to_number
from app.words import uncertain
from model.amplifier import AmplifierMap
from model.identification.estimates import Calibration, changes
from model.identification.fitted import JointFit
from model.identification.names import quantity
from model.quantity import ParameterError
from protocols.plain import plain
from protocols.runreader import Run, RunError

ADEQUATE = {True: "adequate", False: "NOT ADEQUATE", None: "adequacy unknown"}


WRONG_FIRST = "next best: find out why the runs do not follow the model; another run would only be surer of a wrong one"
SIMULATED_SHAPES = ", as many as the simulated tactor has"


def identify_runs(options: argparse.Namespace) -> int:
    """`tactor-bench identify RUN...`."""
    if options.method == "chain" and (options.free or options.fixed or options.robust):
        raise UsageError("--free, --fix and --robust are for the joint fit; the chain's steps are the paper's")
    if options.method == "chain" and (options.profile or options.next):
        raise UsageError("--profile and --next are for the joint fit: the chain has no common covariance to ask")
    if not 0 < options.coverage < 1:
        raise UsageError(f"--coverage {options.coverage:g}: it must lie between 0 and 1, e.g. 0.95")
    free = [name.strip() for name in options.free.split(",") if name.strip()] if options.free else None
    fixed = dict(_fixed(text) for text in options.fixed)
    corrected = _correction(options)
    try:
        notes = [words for path in options.runs if corrected and (words := corrected.words(path))]
        found = identify(
            options.runs,
            options.method,
            free,
            fixed,
            "cauchy" if options.robust else "linear",
            corrected.amplifier.map if corrected and corrected.amplifier else _amplifier(options.runs),
            opened=corrected.opened if corrected else Run,
            told=lambda paths: tracked(paths, "reducing anew" if corrected else "reading runs"),
            n=options.shapes,
        )
        answer = _answer(found)
        if found.fit is not None:
            answer = _with_plans(answer, found, found.fit, options)
    except (ObservingError, RunError, ParameterError, ValueError) as error:
        raise UsageError(str(error)) from None
    notes.append(f"fitted with {found.shapes} shape functions" + (SIMULATED_SHAPES if found.campaign.simulated else ""))
    if options.accept:
        notes.append(_accept(found, options, corrected))
    return deliver(replace(answer, notes=(*answer.notes, *notes)), options)


def _correction(options: argparse.Namespace) -> Correction | None:
    if not options.bench:
        return None
    if options.bench == "sim":
        raise UsageError("--bench sim: give the corrected bench file itself")
    try:
        return Correction.of(Path(options.bench))
    except ConfigError as error:
        raise UsageError(str(error)) from None


def _with_plans(answer: Answer, found: Identified, fit: JointFit, options: argparse.Namespace) -> Answer:
    """The answer with what else was asked of a joint fit, and the one line of what to measure next."""
    tables, notes = list(answer.tables), list(answer.notes)
    if options.profile:
        tables.append(profiled(fit, options.profile, options.coverage))
    if fit.parameters:
        wanted = None if options.next in (None, WORST) else options.next
        proposals = proposed(fit, wanted)
        if options.next:
            tables.append(plans(proposals))
        wrong = found.adequacy is not None and found.adequacy.adequate is False
        notes.append(WRONG_FIRST if wrong else f"next best: {proposals[0].words}")
    return replace(answer, tables=tuple(tables), notes=tuple(notes))


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


def _accept(found: Identified, options: argparse.Namespace, corrected: Correction | None) -> str:
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
            reduced=corrected.as_record() if corrected else {},
        )
        path = calibrations.write(folder, found.specimen, Calibrations((*known.versions, accepted), number))
    except (CalibrationError, ParameterError) as error:
        raise UsageError(str(error)) from None
    return f"accepted as version {number} of {found.specimen}, now active, in {path}"


def _answer(found: Identified) -> Answer:
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
        (*notes, *_reduced(one), *([one.note] if one.note else []), *_versions(known)),
        more={"version": one.version, "active": known.active, "record": one.as_record()},
    )


def _versions(known: Calibrations) -> list[str]:
    """All versions in a line, where there are several."""
    if len(known.versions) < 2:
        return []
    each = (
        f"{c.version} ({c.accepted_at[:10]}{', ' + c.accepted_by if c.accepted_by else ''}"
        f"{', active' if c.version == known.active else ''})"
        for c in known.versions
    )
    return [f"versions: {'; '.join(each)}"]


def _reduced(one: Calibration) -> list[str]:
    """Which corrected calibration of the instruments a version rests on."""
    if not one.reduced:
        return []
    sensor, amplifier = one.reduced["sensor"], one.reduced["amplifier"]
    words = [f"raw samples reduced anew with {one.reduced['bench']} (SHA-256 {one.reduced['sha256'][:16]}...)"]
    if sensor:
        when = sensor["calibrated"] or "nobody tells when"
        words.append(f"{sensor['name']} {sensor['serial']}, {sensor['gain_m_per_v']:.6g} m/V, calibrated {when}")
    if amplifier:
        words.append(
            f"{amplifier['name']} {amplifier['serial']}, {amplifier['slope_below']:g} and {amplifier['slope_above']:g} V/V"
        )
    return ["; ".join(words)]


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
