"""What `tactor-bench identify` does, and accepting what it found."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from app import calibrations
from app.answer import Answer, deliver, tracked
from app.calibrations import CalibrationError, Calibrations
from app.config import ConfigError
from app.config_tables import AmplifierTable
from app.corrected import Correction
from app.exits import UsageError
from app.fit_answer import plans, profiled, proposed
from app.identified_answer import answer_of
from app.identifying import Identified, identify
from app.observing import ObservingError
from app.units import UnitError, to_number
from app.version import version
from model.amplifier import AmplifierMap
from model.identification.estimates import Calibration
from model.identification.fitted import JointFit
from model.identification.names import quantity
from model.identification.setting import Setting
from model.quantity import ParameterError
from protocols.runreader import Run, RunError

WRONG_FIRST = "next best: find out why the runs do not follow the model; another run would only be surer of a wrong one"
SIMULATED_SHAPES = ", as many as the simulated tactor has"


def identify_runs(options: argparse.Namespace) -> int:
    """`tactor-bench identify RUN...`."""
    if options.method == "chain" and (options.free or options.fixed or options.robust):
        raise UsageError("--free, --fix and --robust are for the joint fit; the chain's steps are the paper's")
    if options.method == "chain" and (options.profile or options.next is not None):
        raise UsageError("--profile and --next are for the joint fit: the chain has no common covariance to ask")
    if not 0 < options.coverage < 1:
        raise UsageError(f"--coverage {options.coverage:g}: it must lie between 0 and 1, e.g. 0.95")
    free = tuple(name.strip() for name in (options.free or "").split(",") if name.strip())
    fixed = dict(_fixed(text) for text in options.fixed)
    corrected = _correction(options)
    try:
        notes = [words for path in options.runs if corrected and (words := corrected.words(path))]
        setting = Setting(
            free=free or None,
            fixed=fixed,
            loss="cauchy" if options.robust else "linear",
            amplifier=corrected.amplifier.map if corrected and corrected.amplifier else _amplifier(options.runs),
        )
        found = identify(
            options.runs,
            options.method,
            setting,
            options.shapes,
            opened=corrected.opened if corrected else Run,
            told=lambda paths: tracked(paths, "reducing anew" if corrected else "reading runs"),
        )
        answer = answer_of(found)
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
        proposals = proposed(fit, options.next or None)
        if options.next is not None:
            tables.append(plans(proposals))
        wrong = found.adequacy is not None and found.adequacy.adequate is False
        notes.append(WRONG_FIRST if wrong else f"next best: {proposals[0].words}")
    return replace(answer, tables=tuple(tables), notes=tuple(notes))


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
